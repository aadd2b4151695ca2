/* Whether each pixel answers in proportion to light: a linear regression over the exposures of the white frames. */
#include "rig/develop/linearity.h"

#include "rig/develop/flat.h"

#include <math.h>
#include <stdlib.h>

enum { WEIGHT, TIMES, TIMES2, VALUES, VALUES_TIMES, VALUES2, SUMS };
enum { EXPOSURES = 16, REACH = 4 };

/* A pixel below this share of the median of its neighbours is dead. */
static const double dead_share = 0.25;
/* Whether the neighbours get light at all: their share of the colour's upper level. */
static const double lit_share = 0.1;
static const double noisy_ratio = 25; /* of variances */

int linearity_init(struct linearity *linearity, size_t pixels, struct nacre_error *error)
{
    *linearity = (struct linearity){.pixels = pixels,
                                    .sums = calloc(pixels, SUMS * sizeof *linearity->sums),
                                    .count = calloc(pixels, sizeof *linearity->count)};
    if (!linearity->sums || !linearity->count) {
        linearity_finish(linearity);
        return nacre_fail_memory(error, "the linear regression");
    }
    return NACRE_OK;
}

void linearity_finish(struct linearity *linearity)
{
    if (linearity) {
        free(linearity->sums);
        free(linearity->count);
        *linearity = (struct linearity){0};
    }
}

static size_t exposure_index(struct linearity *linearity, double seconds)
{
    size_t e = 0;
    while (e < linearity->exposure_count && linearity->seconds[e] != seconds) {
        e++;
    }
    if (e == linearity->exposure_count && e < EXPOSURES) {
        linearity->seconds[e] = seconds;
        linearity->exposure_count++;
    }
    return e;
}

void linearity_add(struct linearity *linearity, const struct pattern_frames *frames,
                   const struct noise_model *noise, const float *radiance)
{
    double floor_variance = noise->read_noise * noise->read_noise + 1.0 / 12;
    double shot = noise->electrons > 0 ? 1 / noise->electrons : 0;
    for (size_t e = 0; e < frames->count; e++) {
        const uint16_t *raw = frames->exposures[e].raw;
        double t = (double)frames->exposures[e].exposure_ns * 1e-9;
        double range = (double)((1 << frames->bits) - 2) - noise->pedestal;
        size_t index = exposure_index(linearity, t);
        double residual = 0;
        double expected = 0;
        double scatter = 0;
        for (size_t i = 0; i < linearity->pixels; i++) {
            double light = (double)radiance[i] * t;
            double variance = floor_variance + fmax(light, 0) * shot;
            if (isnan(radiance[i]) || light + 5 * sqrt(variance) > range) {
                continue;
            }
            double value = raw[i] - noise->pedestal;
            double weight = 1 / variance;
            double *sums = linearity->sums + SUMS * i;
            sums[WEIGHT] += weight;
            sums[TIMES] += weight * t;
            sums[TIMES2] += weight * t * t;
            sums[VALUES] += weight * value;
            sums[VALUES_TIMES] += weight * value * t;
            sums[VALUES2] += weight * value * value;
            linearity->count[i]++;
            residual += value - light;
            expected += light;
            scatter += variance;
        }
        if (index < EXPOSURES) {
            linearity->residual[index] += residual;
            linearity->expected[index] += expected;
            linearity->variance[index] += scatter;
        }
    }
}

void linearity_line(const struct linearity *linearity, size_t pixel, double *slope, double *offset,
                    double *chi_squared, int *freedom)
{
    const double *sums = linearity->sums + SUMS * pixel;
    double spread = sums[TIMES2] - sums[TIMES] * sums[TIMES] / sums[WEIGHT];
    *slope = *offset = *chi_squared = NAN;
    *freedom = 0;
    if (linearity->count[pixel] >= 2 && spread > 1e-9 * sums[TIMES2]) {
        double shared = sums[VALUES_TIMES] - sums[TIMES] * sums[VALUES] / sums[WEIGHT];
        double square = sums[VALUES2] - sums[VALUES] * sums[VALUES] / sums[WEIGHT];
        *slope = shared / spread;
        *offset = (sums[VALUES] - *slope * sums[TIMES]) / sums[WEIGHT];
        *chi_squared = fmax(square - *slope * shared, 0);
        *freedom = (int)linearity->count[pixel] - 2;
    }
}

/* What chi squared of `freedom` degrees passes once in a million times (Wilson and Hilferty). */
static double chi_squared_limit(int freedom)
{
    double k = freedom;
    double root = 1 - 2 / (9 * k) + 4.753 * sqrt(2 / (9 * k));
    return k * root * root * root;
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a;
    double y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Median of chi squared per degree of freedom over all pixels, at least 1; 1 where none has any. */
static int common_spread(const struct linearity *linearity, double *median,
                         struct nacre_error *error)
{
    size_t used = 0;
    double *spreads = malloc(linearity->pixels * sizeof *spreads);
    if (!spreads) {
        return nacre_fail_memory(error, "the linear regression");
    }
    for (size_t i = 0; i < linearity->pixels; i++) {
        double slope;
        double offset;
        double chi;
        int freedom;
        linearity_line(linearity, i, &slope, &offset, &chi, &freedom);
        if (freedom > 0) {
            spreads[used++] = chi / freedom;
        }
    }
    qsort(spreads, used, sizeof *spreads, compare_doubles);
    *median = used ? fmax(spreads[used / 2], 1) : 1;
    free(spreads);
    return NACRE_OK;
}

/* Lower quartile of the measured pixels of the same colour around (x, y), itself left out: dark as soon as the border of
 * the lit area is near, where a pixel may be dark by right. */
static double neighbour_level(const float *values, int width, int height, enum bayer bayer, int x,
                              int y)
{
    double around[(2 * REACH + 1) * (2 * REACH + 1)];
    size_t count = 0;
    for (int ny = y - REACH; ny <= y + REACH; ny++) {
        for (int nx = x - REACH; nx <= x + REACH; nx++) {
            if (nx < 0 || nx >= width || ny < 0 || ny >= height || (nx == x && ny == y) ||
                bayer_channel(bayer, nx, ny) != bayer_channel(bayer, x, y)) {
                continue;
            }
            float value = values[(size_t)ny * (size_t)width + (size_t)nx];
            if (!isnan(value)) {
                around[count++] = value;
            }
        }
    }
    qsort(around, count, sizeof *around, compare_doubles);
    return count ? around[count / 4] : 0;
}

static double largest_deviation(const struct linearity *linearity)
{
    double deviation = NAN;
    size_t used = 0;
    for (size_t e = 0; e < linearity->exposure_count; e++) {
        if (linearity->expected[e] > 100 * sqrt(linearity->variance[e]) &&
            linearity->expected[e] > 0) {
            double relative = fabs(linearity->residual[e]) / linearity->expected[e];
            deviation = isnan(deviation) ? relative : fmax(deviation, relative);
            used++;
        }
    }
    return used > 1 ? deviation : NAN;
}

int linearity_judge(const struct linearity *linearity, const float *white, const float *black,
                    const float *predicted, int width, int height, enum bayer bayer, bool *defect,
                    struct linearity_report *report, struct nacre_error *error)
{
    double common = 1;
    double levels[3];
    int status = common_spread(linearity, &common, error);
    if (status == NACRE_OK) {
        status = flat_levels(white, width, height, bayer, levels, error);
    }
    *report = (struct linearity_report){.deviation = largest_deviation(linearity)};
    for (size_t i = 0; status == NACRE_OK && i < linearity->pixels; i++) {
        int x = (int)(i % (size_t)width);
        int y = (int)(i / (size_t)width);
        double slope;
        double offset;
        double chi;
        int freedom;
        linearity_line(linearity, i, &slope, &offset, &chi, &freedom);
        double usual = neighbour_level(white, width, height, bayer, x, y);
        bool dead = usual > lit_share * levels[bayer_channel(bayer, x, y)] &&
                    !(white[i] >= dead_share * usual);
        bool bent = freedom > 0 && chi > common * chi_squared_limit(freedom);
        bool noisy = black && predicted && black[i] > noisy_ratio * predicted[i];
        report->dead += dead ? 1 : 0;
        report->nonlinear += bent && !dead ? 1 : 0;
        report->noisy += noisy && !dead && !bent ? 1 : 0;
        defect[i] = dead || bent || noisy;
    }
    return status;
}
