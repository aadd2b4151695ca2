/* The black level: what camera and projector show where nothing is lit, and taking it off (paper section 4.2). */
#include "rig/develop/black.h"

#include <math.h>
#include <stdlib.h>

enum { PREDICTED_FRAMES = 8 };

const char *const black_mode_names[] = {"subtract", "clip", NULL};

double normal_quantile(double confidence)
{
    double low = -40;
    double high = 40;
    while (high - low > 1e-12) {
        double middle = (low + high) / 2;
        if (0.5 * erfc(-middle / sqrt(2)) < confidence) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return (low + high) / 2;
}

static double pooled_variance(const struct moments *frames, const struct moments *predicted,
                              size_t pixel)
{
    double own = moments_variance(frames, pixel);
    double freedom = isnan(own) ? 0 : (double)frames->count[pixel] - 1;
    double foretold = moments_mean(predicted, pixel);
    return (freedom * (isnan(own) ? 0 : own) + PREDICTED_FRAMES * foretold) /
           (freedom + PREDICTED_FRAMES);
}

int black_level_init(struct black_level *black, const struct moments *frames,
                     const struct moments *predicted, enum black_mode mode, double confidence,
                     struct nacre_error *error)
{
    double deviate = normal_quantile(confidence);
    *black = (struct black_level){.pixels = frames->pixels,
                                  .mean = malloc(frames->pixels * sizeof *black->mean),
                                  .limit = malloc(frames->pixels * sizeof *black->limit)};
    if (!black->mean || !black->limit) {
        black_level_finish(black);
        return nacre_fail_memory(error, "the black level");
    }
    for (size_t i = 0; i < frames->pixels; i++) {
        double mean = moments_mean(frames, i);
        black->mean[i] = (float)mean;
        black->limit[i] =
            mode == BLACK_SUBTRACT
                ? -INFINITY
                : (float)(mean + deviate * sqrt(pooled_variance(frames, predicted, i)));
    }
    return NACRE_OK;
}

void black_level_finish(struct black_level *black)
{
    if (black) {
        free(black->mean);
        free(black->limit);
        *black = (struct black_level){0};
    }
}

void black_level_subtract(const struct black_level *black, float *radiance)
{
    for (size_t i = 0; i < black->pixels; i++) {
        radiance[i] = radiance[i] < black->limit[i] ? 0 : radiance[i] - black->mean[i];
    }
}
