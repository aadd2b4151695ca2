/* Black level, fall-off and defocus of the projector, each a pass of its own where it exists. */
#include "rig/virtual/projection.h"

#include "rig/virtual/optics.h"

#include <stdlib.h>
#include <string.h>

static int fill_falloff(const struct station *station, struct projection *projection,
                        struct nacre_error *error)
{
    int width = projection->width;
    int height = projection->height;
    size_t points = (size_t)width * (size_t)height;
    projection->falloff = calloc(points, sizeof *projection->falloff);
    if (!projection->falloff) {
        return nacre_fail_memory(error, "the virtual projector");
    }
    for (size_t i = 0; i < points; i++) {
        size_t column = i % (size_t)width;
        size_t row = i / (size_t)width;
        projection->falloff[i] =
            optics_falloff(station->simulated.projector.vignetting, (double)column + 0.5,
                           (double)row + 0.5, width, height);
    }
    return NACRE_OK;
}

int projection_init(const struct station *station, const struct effects *effects,
                    struct projection *projection, struct nacre_error *error)
{
    const struct virtual_projector_settings *settings = &station->simulated.projector;
    double black = effects_has(effects, EFFECT_BLACK_LEVEL) ? 1 / settings->contrast : 0;
    int status = NACRE_OK;
    *projection =
        (struct projection){.width = station->sample.width, .height = station->sample.height};
    for (int level = 0; level < 256; level++) {
        projection->light[level] = black + (1 - black) * level / 255;
    }
    projection->planes = calloc((size_t)projection->width * (size_t)projection->height,
                                2 * sizeof *projection->planes);
    if (!projection->planes) {
        status = nacre_fail_memory(error, "the virtual projector");
        goto out;
    }
    if (effects_has(effects, EFFECT_PROJECTOR_VIGNETTING)) {
        status = fill_falloff(station, projection, error);
    }
    if (status == NACRE_OK && effects_has(effects, EFFECT_PROJECTOR_DEFOCUS)) {
        status = spread_init(settings->defocus_points, &projection->spread, error);
    }
out:
    if (status != NACRE_OK) {
        projection_finish(projection);
    }
    return status;
}

void projection_finish(struct projection *projection)
{
    free(projection->falloff);
    free(projection->planes);
    spread_finish(&projection->spread);
    *projection = (struct projection){0};
}

static void draw_evenly(const struct projection *projection, const uint8_t *levels, size_t points,
                        float *plane)
{
    for (size_t i = 0; i < points; i++) {
        plane[i] = (float)projection->light[levels[i]];
    }
}

static void draw_falling_off(const struct projection *projection, const uint8_t *levels,
                             size_t points, float *plane)
{
    for (size_t i = 0; i < points; i++) {
        plane[i] = (float)(projection->falloff[i] * projection->light[levels[i]]);
    }
}

void projection_draw(struct projection *projection, struct effects *effects, const uint8_t *levels,
                     float *irradiance)
{
    int width = projection->width;
    int height = projection->height;
    size_t points = (size_t)width * (size_t)height;
    float *now = projection->planes;
    float *next = projection->planes + points;
    if (effects_has(effects, EFFECT_PROJECTOR_VIGNETTING)) {
        draw_falling_off(projection, levels, points, now);
        effects->work[EFFECT_PROJECTOR_VIGNETTING] += points;
    } else {
        draw_evenly(projection, levels, points, now);
    }
    if (effects_has(effects, EFFECT_BLACK_LEVEL)) {
        effects->work[EFFECT_BLACK_LEVEL] += points;
    }
    if (effects_has(effects, EFFECT_PROJECTOR_DEFOCUS)) {
        spread_apply(&projection->spread, width, height, now, next);
        now = next;
        effects->work[EFFECT_PROJECTOR_DEFOCUS] += points;
    }
    for (size_t c = 0; c < 3; c++) {
        memcpy(irradiance + c * points, now, points * sizeof *now);
    }
}
