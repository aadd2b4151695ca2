/* Whether each pixel answers in proportion to light: a linear regression over the exposures of the white frames. */
#ifndef RIG_DEVELOP_LINEARITY_H
#define RIG_DEVELOP_LINEARITY_H

#include "nacre/error.h"
#include "rig/develop/hdr.h"
#include "rig/develop/pixel_map.h"
#include "rig/session.h"

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
    size_t dead, hot, nonlinear, noisy; /* pixels of each class */
    /* Largest mean departure of an exposure from proportion, relative; only exposures that tell it to 1 % count. NaN
     * where less than two do. */
    double deviation;
};

/* What the frames say of the pixels. Arrays are [height][width]. */
struct linearity_evidence {
    const struct linearity *white, *black; /* regressions; `black` may be empty */
    const struct noise_model *noise;
    double longest_seconds;  /* the longest exposure */
    const float *mean_white; /* radiance */
    /* Of a single black frame, as measured and as foretold; NULL: too few frames to tell. */
    const float *black_variance, *foretold_variance;
};

int linearity_init(struct linearity *linearity, size_t pixels, struct nacre_error *error);
void linearity_finish(struct linearity *linearity);

/* Add a white or black frame whose merged radiance is known. Exposures near saturation are left out by the radiance, not by
 * the sample. */
void linearity_add(struct linearity *linearity, const struct pattern_frames *frames,
                   const struct noise_model *noise, const float *radiance);

/* Slope in raw units a second and offset in raw units of a pixel; both NaN where fewer than two different exposures
 * were usable. Writes chi squared and its degrees of freedom. */
void linearity_line(const struct linearity *linearity, size_t pixel, double *slope, double *offset,
                    double *chi_squared, int *freedom);

/* Find each pixel's class; slopes and offsets are noted in the map. Of size and Bayer order of the map:
 * - dead: below a quarter of the lower quartile of its neighbours of the same colour, in the lit area; not in the two
 *   outermost rows and columns of the frame;
 * - hot: what it counts in the dark beyond the light that its neighbours and its white foretell makes its noise in the
 *   longest exposure sqrt(2) times as large as a good pixel's, or more, and 5 standard errors say that it is there;
 * - not linear: off its line by more than 1 in a million linear pixels would be, once what all share (a lamp that
 *   flickers) is divided out; or its line in the dark begins beside its neighbours' by more than the noise of a sample;
 * - noisy: its black frames vary more than 25 times as much as foretold. */
int linearity_judge(const struct linearity_evidence *evidence, struct pixel_map *map,
                    struct linearity_report *report, struct nacre_error *error);

#endif
