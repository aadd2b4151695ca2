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
    double *
        sums; /* [pixels][6]: weight, times, squares of times, values, values times times, squares of values */
    unsigned *count;
    size_t exposure_count; /* different exposure times seen, the first 16 of them */
    double seconds[16], residual[16],
        expected[16]; /* each: time, sum of (value - expected), sum of expected */
};

struct linearity_report {
    size_t dead;      /* pixels that answer far less than nearly all of their neighbours of the same colour */
    size_t nonlinear; /* pixels whose values lie off their line more than noise explains */
    size_t noisy;     /* pixels that vary in the black frames more than noise explains */
    double
        deviation; /* largest mean departure of an exposure from proportion, relative; NaN below two exposures */
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
