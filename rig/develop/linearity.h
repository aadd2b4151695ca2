/* Whether each pixel answers in proportion to light: a linear regression over the exposures of the white frames. */
#ifndef RIG_DEVELOP_LINEARITY_H
#define RIG_DEVELOP_LINEARITY_H

#include "nacre/error.h"
#include "rig/develop/hdr.h"
#include "rig/session.h"

#include <stdbool.h>
#include <stddef.h>

/* Weighted sums of the regression raw - pedestal = offset + slope * seconds, per pixel. Zero-initialised it is empty;
 * linearity_finish frees. */
struct linearity {
    size_t pixels;
    /* [pixels][6]: weight, times, squares of times, values, values times times, squares of values */
    double *sums;
    unsigned *count;
    /* Different exposure times seen, the first 16 of them, and over all pixels for each the sum of what values have
     * too much, of what they should be, and of their variances. */
    size_t exposure_count;
    double seconds[16], residual[16], expected[16], variance[16];
};

struct linearity_report {
    /* Pixels that answer far less than nearly all of their neighbours of the same colour; whose values lie off their
     * line, or vary in the black frames, more than noise explains. */
    size_t dead, nonlinear, noisy;
    /* Largest mean departure of an exposure from proportion, relative; only exposures that tell it to 1 % count. NaN
     * where less than two do. */
    double deviation;
};

int linearity_init(struct linearity *linearity, size_t pixels, struct nacre_error *error);
void linearity_finish(struct linearity *linearity);

/* Add a white frame whose merged radiance is known. Exposures near saturation are left out by the radiance, not by
 * the sample. */
void linearity_add(struct linearity *linearity, const struct pattern_frames *frames,
                   const struct noise_model *noise, const float *radiance);

/* Slope in raw units a second and offset in raw units of a pixel; both NaN where fewer than two different exposures
 * were usable. Writes chi squared and its degrees of freedom. */
void linearity_line(const struct linearity *linearity, size_t pixel, double *slope, double *offset,
                    double *chi_squared, int *freedom);

/* Mark in defect[height][width] the pixels that cannot be trusted. `white` is their mean white radiance, black and
 * predicted (may be NULL) the variance of a single black frame as measured and as foretold. Marked are: dead pixels;
 * pixels off their line by more than 1 in a million linear ones would be, once what all pixels share (a lamp that
 * flickers) is divided out; pixels whose black frames vary more than 5 times as much as foretold. */
int linearity_judge(const struct linearity *linearity, const float *white, const float *black,
                    const float *predicted, int width, int height, enum bayer bayer, bool *defect,
                    struct linearity_report *report, struct nacre_error *error);

#endif
