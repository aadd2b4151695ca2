/* The white frames made a flat field: what a surface of known reflectance shows in each pixel. */
#include "rig/develop/flat.h"

#include <math.h>
#include <stdlib.h>

/* Below this share of the colour's level a pixel sees mostly what is not the sample. */
static const double lit_share = 0.02;

static int compare_floats(const void *a, const void *b)
{
    float x = *(const float *)a;
    float y = *(const float *)b;
    return (x > y) - (x < y);
}

int flat_levels(const float *white, int width, int height, enum bayer bayer, double levels[3],
                struct nacre_error *error)
{
    float *values = malloc((size_t)width * (size_t)height * sizeof *values);
    if (!values) {
        return nacre_fail_memory(error, "the white frame's levels");
    }
    for (int channel = 0; channel < 3; channel++) {
        size_t count = 0;
        for (int y = 0; y < height; y++) {
            for (int x = 0; x < width; x++) {
                float value = white[(size_t)y * (size_t)width + (size_t)x];
                if (bayer_channel(bayer, x, y) == channel && !isnan(value)) {
                    values[count++] = value;
                }
            }
        }
        qsort(values, count, sizeof *values, compare_floats);
        levels[channel] = count ? values[count * 9 / 10] : 0;
    }
    free(values);
    return NACRE_OK;
}

int flat_init(struct flat *flat, const float *white, const bool *defect, int width, int height,
              enum bayer bayer, const double reflectance[3], struct nacre_error *error)
{
    size_t pixels = (size_t)width * (size_t)height;
    *flat = (struct flat){.width = width,
                          .height = height,
                          .bayer = bayer,
                          .channels = bayer == BAYER_MONO ? 1 : 3,
                          .white = malloc(pixels * sizeof *flat->white),
                          .lit = malloc(pixels * sizeof *flat->lit)};
    int status = NACRE_OK;
    if (!flat->white || !flat->lit) {
        status = nacre_fail_memory(error, "the flat field");
        goto out;
    }
    for (int c = 0; c < 3; c++) {
        flat->reflectance[c] = reflectance[bayer == BAYER_MONO ? 1 : c];
    }
    for (size_t i = 0; i < pixels; i++) {
        flat->white[i] = defect[i] ? NAN : white[i];
    }
    status = flat_levels(flat->white, width, height, bayer, flat->levels, error);
    for (size_t i = 0; i < pixels; i++) {
        int x = (int)(i % (size_t)width);
        int y = (int)(i / (size_t)width);
        flat->lit[i] = flat->white[i] > lit_share * flat->levels[bayer_channel(bayer, x, y)];
    }
out:
    if (status != NACRE_OK) {
        flat_finish(flat);
    }
    return status;
}

void flat_finish(struct flat *flat)
{
    if (flat) {
        free(flat->white);
        free(flat->lit);
        *flat = (struct flat){0};
    }
}
