/* The white frames made a flat field: what a surface of known reflectance shows in each pixel.
 *
 * Dividing by it takes out camera vignetting, the colour filters' and the projector's white (white balance) and the
 * lamp's strength, and gives absolute R_d. It is the paper's way: the projector's fall-off E is divided out at x_o, where
 * the light leaves, though it acts at x_i; an error of E(x_i) / E(x_o) stays. */
#ifndef RIG_DEVELOP_FLAT_H
#define RIG_DEVELOP_FLAT_H

#include "nacre/error.h"
#include "rig/bayer.h"

#include <stdbool.h>
#include <stddef.h>

struct flat {
    int width, height;
    enum bayer bayer;
    int channels;          /* 3, or 1 of a camera without colour filters */
    double reflectance[3]; /* of the white layer, by channel */
    double levels[3];      /* 90th percentile of the white radiance, by channel */
    float *white;          /* [height][width], raw units a second; NaN at defect pixels */
    bool *lit;             /* [height][width]: enough white to divide by */
};

/* The 90th percentile of the measured pixels of each colour; 0 where there is none. */
int flat_levels(const float *white, int width, int height, enum bayer bayer, double levels[3],
                struct nacre_error *error);

/* From mean white radiance and the pixels not to be trusted. `reflectance` is R G B of the white layer. */
int flat_init(struct flat *flat, const float *white, const bool *defect, int width, int height,
              enum bayer bayer, const double reflectance[3], struct nacre_error *error);
void flat_finish(struct flat *flat);

#endif
