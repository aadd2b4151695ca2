/* Mean and variance per pixel over many frames, in one pass (Welford). */
#include "rig/develop/moments.h"

#include <math.h>
#include <stdlib.h>

int moments_init(struct moments *moments, size_t pixels, struct nacre_error *error)
{
    *moments = (struct moments){.pixels = pixels,
                                .count = calloc(pixels, sizeof *moments->count),
                                .mean = calloc(pixels, sizeof *moments->mean),
                                .square = calloc(pixels, sizeof *moments->square)};
    if (!moments->count || !moments->mean || !moments->square) {
        moments_finish(moments);
        return nacre_fail_memory(error, "statistics of frames");
    }
    return NACRE_OK;
}

void moments_finish(struct moments *moments)
{
    if (moments) {
        free(moments->count);
        free(moments->mean);
        free(moments->square);
        *moments = (struct moments){0};
    }
}

void moments_add(struct moments *moments, const float *values)
{
    for (size_t i = 0; i < moments->pixels; i++) {
        if (!isnan(values[i])) {
            double before = values[i] - moments->mean[i];
            moments->count[i]++;
            moments->mean[i] += before / moments->count[i];
            moments->square[i] += before * (values[i] - moments->mean[i]);
        }
    }
}

double moments_mean(const struct moments *moments, size_t pixel)
{
    return moments->count[pixel] ? moments->mean[pixel] : NAN;
}

double moments_variance(const struct moments *moments, size_t pixel)
{
    return moments->count[pixel] > 1 ? moments->square[pixel] / (moments->count[pixel] - 1) : NAN;
}
