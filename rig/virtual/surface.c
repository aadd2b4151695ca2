/* Facets that mirror and specks that cover, for each surface point. */
#include "rig/virtual/surface.h"

#include "rig/virtual/fresnel.h"
#include "rig/virtual/optics.h"
#include "rig/virtual/sensor.h"

#include <math.h>
#include <stdlib.h>

static const double PI = 3.14159265358979323846;

/* Places along a side of a point that dust covers or not. */
enum { PLACES = 8, KEY_DUST = 0x64757374 };

/* The part that is reflected outside, at a facet that light meets at that cosine: the same as inside, on the refracted
 * way. */
static double reflected_outside(double index, double cosine)
{
    return fresnel_inside(index, sqrt(1 - (1 - cosine * cosine) / (index * index)));
}

/* Walter et al.'s rational fit to Smith's shadowing. */
static double unshadowed(double roughness, double cosine)
{
    double a = cosine / (roughness * sqrt(fmax(1 - cosine * cosine, 1e-30)));
    return a >= 1.6 ? 1 : a * (3.535 + 2.181 * a) / (1 + a * (2.276 + 2.577 * a));
}

double surface_reflection(double roughness, double index, const double to_light[3],
                          const double to_camera[3])
{
    double half[3];
    double length = 0;
    double cosine = 0;
    for (int i = 0; i < 3; i++) {
        half[i] = to_light[i] + to_camera[i];
        length += half[i] * half[i];
    }
    for (int i = 0; i < 3; i++) {
        cosine += half[i] / sqrt(length) * to_camera[i];
    }
    double upright = half[2] * half[2] / length;
    double facets = exp((upright - 1) / (upright * roughness * roughness)) /
                    (PI * roughness * roughness * upright * upright);
    return PI * facets * reflected_outside(index, cosine) * unshadowed(roughness, to_light[2]) *
           unshadowed(roughness, to_camera[2]) / (4 * to_light[2] * to_camera[2]);
}

static int fill_local(const struct station *station, const struct sample *sample,
                      const struct effects *effects, struct surface *surface,
                      struct nacre_error *error)
{
    size_t points = (size_t)sample->width * (size_t)sample->height;
    surface->local = calloc(points, sizeof *surface->local);
    if (!surface->local) {
        return nacre_fail_memory(error, "the sample's surface");
    }
    for (size_t i = 0; i < points; i++) {
        size_t column = i % (size_t)sample->width;
        size_t row = i / (size_t)sample->width;
        double x = (double)column + 0.5;
        double y = (double)row + 0.5;
        double place_mm[3] = {x * sample->pitch_mm + sample->corner_mm[0],
                              y * sample->pitch_mm + sample->corner_mm[1], 0};
        const struct sample_material *material =
            &sample->materials[sample_material_at(sample, place_mm)];
        double to_light[3];
        double to_camera[3];
        optics_directions(station, effects, x, y, to_light, to_camera);
        surface->local[i] = (float)surface_reflection(sample->surface.roughness, material->index,
                                                      to_light, to_camera);
    }
    return NACRE_OK;
}

/* Cover the places of the points under a speck. */
static void cover(const struct sample *sample, const double middle_mm[2], double radius_mm,
                  unsigned char *covered)
{
    double place_mm = sample->pitch_mm / PLACES;
    long columns = (long)sample->width * PLACES;
    long rows = (long)sample->height * PLACES;
    long reach = (long)ceil(radius_mm / place_mm) + 1;
    long column = (long)floor(middle_mm[0] / place_mm);
    long row = (long)floor(middle_mm[1] / place_mm);
    /* A speck may be much larger than the sample. */
    long left = column > reach ? column - reach : 0;
    long top = row > reach ? row - reach : 0;
    for (long y = top; y <= row + reach && y < rows; y++) {
        for (long x = left; x <= column + reach && x < columns; x++) {
            double dx = ((double)x + 0.5) * place_mm - middle_mm[0];
            double dy = ((double)y + 0.5) * place_mm - middle_mm[1];
            if (dx * dx + dy * dy <= radius_mm * radius_mm) {
                covered[y * columns + x] = 1;
            }
        }
    }
}

static double draw(uint64_t key, uint64_t which)
{
    return (double)(sensor_key(key, which) >> 11) * 0x1p-53;
}

static int fill_clear(const struct sample *sample, struct surface *surface,
                      struct nacre_error *error)
{
    const struct sample_dust *dust = &sample->dust;
    int status = NACRE_OK;
    double width_mm = sample->width * sample->pitch_mm;
    double height_mm = sample->height * sample->pitch_mm;
    size_t points = (size_t)sample->width * (size_t)sample->height;
    uint64_t count = (uint64_t)llround(dust->per_cm2 * width_mm * height_mm / 100);
    unsigned char *covered = calloc(points, (size_t)PLACES * PLACES);
    surface->clear = calloc(points, sizeof *surface->clear);
    if (!covered || !surface->clear) {
        status = nacre_fail_memory(error, "the sample's surface");
        goto out;
    }
    for (uint64_t i = 0; i < count; i++) {
        uint64_t key = sensor_key(sensor_key((uint64_t)dust->seed, KEY_DUST), i);
        double middle_mm[2] = {draw(key, 0) * width_mm - sample->corner_mm[0],
                               draw(key, 1) * height_mm - sample->corner_mm[1]};
        /* Diameters from a half to one and a half of the mean. */
        cover(sample, middle_mm, dust->size_mm * (0.25 + 0.5 * draw(key, 2)), covered);
    }
    for (size_t i = 0; i < points; i++) {
        size_t x = i % (size_t)sample->width;
        size_t y = i / (size_t)sample->width;
        int free_places = 0;
        for (size_t k = 0; k < (size_t)PLACES * PLACES; k++) {
            size_t at = (y * PLACES + k / PLACES) * (size_t)sample->width * PLACES + x * PLACES +
                        k % PLACES;
            free_places += !covered[at];
        }
        surface->clear[i] = (float)free_places / (PLACES * PLACES);
    }
out:
    free(covered);
    return status;
}

int surface_init(const struct station *station, const struct sample *sample,
                 const struct effects *effects, struct surface *surface, struct nacre_error *error)
{
    int status = NACRE_OK;
    if (effects_has(effects, EFFECT_LOCAL)) {
        status = fill_local(station, sample, effects, surface, error);
    }
    if (status == NACRE_OK && effects_has(effects, EFFECT_DUST)) {
        status = fill_clear(sample, surface, error);
    }
    return status;
}

void surface_finish(struct surface *surface)
{
    free(surface->local);
    free(surface->clear);
    *surface = (struct surface){0};
}
