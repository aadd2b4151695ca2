/* Responses of a homogeneous slab in closed form. */
#include "rig/virtual/closed.h"

#include "rig/virtual/fresnel.h"

#include <math.h>
#include <stdlib.h>

static const double PI = 3.14159265358979323846;

/* Wave numbers go up to where both the width of a point and the length over which a beam is first scattered have smoothed
 * the light: these parts of 1 / pitch and of the extinction. What is left out is below 1e-3 of the lit point's entry. */
static const double POINT_WAVES = 28;
static const double PATH_WAVES = 20;

double closed_decay_mm(const struct closed_slab *slab)
{
    double extinction = slab->scattering_per_mm + slab->absorption_per_mm;
    double beyond = 2 * fresnel_boundary_a(slab->index) / (3 * extinction);
    double across = PI / (slab->thickness_mm + 2 * beyond);
    return 1 / sqrt(3 * slab->absorption_per_mm * extinction + across * across);
}

/* What a wave of wave number sqrt(k2) gives back, over its irradiance, of light scattered more than once for the
 * radiance, at all for the exitance. phi - reach phi' = 0 at the top and phi + reach phi' = 0 at the bottom. */
static double wave(const struct closed_slab *slab, enum closed_quantity quantity, double a,
                   double k2)
{
    double s = slab->scattering_per_mm + slab->absorption_per_mm;
    double d = slab->thickness_mm;
    double diffusivity = 1 / (3 * s);
    double q = sqrt(3 * s * slab->absorption_per_mm + k2);
    if (fabs(q - s) < 1e-6 * s) {
        q = s * (1 + 1e-6); /* the forms below are 0 / 0 where q = s, and smooth around it */
    }
    double w = -slab->scattering_per_mm / (diffusivity * (s * s - q * q));
    double reach = 2 * a * diffusivity;
    double fade = exp(-q * d);
    double beam = exp(-s * d);
    double top = -w * (1 + reach * s);
    double bottom = -w * beam * (1 - reach * s);
    double near = 1 + reach * q;
    double far = fade * (1 - reach * q);
    double determinant = near * near - far * far;
    double u = (top * near - bottom * far) / determinant;
    double v = (bottom * near - top * far) / determinant;
    double through = fresnel_through_normal(slab->index);
    if (quantity == CLOSED_EXITANCE) {
        return through * (u + v * fade + w) / (2 * a);
    }
    double integral = u * (1 - exp(-(q + s) * d)) / (q + s) + v * (fade - beam) / (s - q) +
                      w * (1 - exp(-2 * s * d)) / (2 * s);
    double out = through / slab->index;
    return out * out / 4 * slab->scattering_per_mm * integral;
}

/* Light scattered once, which leaves where it came in. */
static double once(const struct closed_slab *slab)
{
    double s = slab->scattering_per_mm + slab->absorption_per_mm;
    double out = fresnel_through_normal(slab->index) / slab->index;
    return out * out / 8 * slab->scattering_per_mm / s * (1 - exp(-2 * s * slab->thickness_mm));
}

/* Sum the waves along x and y, which are alike: response[dy][dx] for 0 <= dx, dy < half. cosines[half][count]. */
static void sum_waves(const struct closed_slab *slab, enum closed_quantity quantity, double step,
                      int count, int half, const double *cosines, double *row, double *quarter)
{
    double a = fresnel_boundary_a(slab->index);
    for (int j = 0; j < count; j++) {
        double ky = (j + 0.5) * step;
        for (int dx = 0; dx < half; dx++) {
            row[dx] = 0;
        }
        for (int i = 0; i < count; i++) {
            double kx = (i + 0.5) * step;
            double given = wave(slab, quantity, a, kx * kx + ky * ky);
            for (int dx = 0; dx < half; dx++) {
                row[dx] += given * cosines[dx * count + i];
            }
        }
        for (int dy = 0; dy < half; dy++) {
            for (int dx = 0; dx < half; dx++) {
                quarter[dy * half + dx] += row[dx] * cosines[dy * count + j];
            }
        }
    }
}

/* The sum repeats itself after this length; what comes from there has fallen off by e^-14 or more. */
static double repeat_mm(const struct closed_slab *slab, int window)
{
    return window * slab->pitch_mm + 14 * closed_decay_mm(slab);
}

double closed_waves(const struct closed_slab *slab, int window)
{
    double extinction = slab->scattering_per_mm + slab->absorption_per_mm;
    double highest = POINT_WAVES / slab->pitch_mm + PATH_WAVES * extinction;
    return ceil(highest * repeat_mm(slab, window) / (2 * PI));
}

int closed_response(const struct closed_slab *slab, enum closed_quantity quantity, int window,
                    float *response, struct nacre_error *error)
{
    int half = window / 2 + 1;
    double pitch = slab->pitch_mm;
    double step = 2 * PI / repeat_mm(slab, window);
    double waves = closed_waves(slab, window);
    if (waves > 8192) {
        return nacre_fail(error,
                          "closed form: light goes too far for points of %g mm; enlarge "
                          "pitch_mm",
                          pitch);
    }
    int count = (int)waves;
    size_t cosine_count = (size_t)half * (size_t)count;
    size_t entries = (size_t)half * (size_t)half;
    double *memory = calloc(cosine_count + (size_t)half + entries, sizeof *memory);
    if (!memory) {
        return nacre_fail_memory(error, "the closed form");
    }
    double *row = memory + cosine_count;
    double *quarter = row + half;
    for (int dx = 0; dx < half; dx++) {
        for (int i = 0; i < count; i++) {
            double k = (i + 0.5) * step;
            double width = sin(k * pitch / 2) / (k * pitch / 2);
            memory[dx * count + i] = width * width * cos(k * pitch * dx) * pitch * step / PI;
        }
    }
    if (slab->scattering_per_mm > 0) {
        sum_waves(slab, quantity, step, count, half, memory, row, quarter);
        quarter[0] += quantity == CLOSED_RADIANCE ? once(slab) : 0;
    }
    for (int i = 0; i < window * window; i++) {
        int dx = abs(i % window - window / 2);
        int dy = abs(i / window - window / 2);
        response[i] = (float)fmax(quarter[dy * half + dx], 0);
    }
    free(memory);
    return NACRE_OK;
}
