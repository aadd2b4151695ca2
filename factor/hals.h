/* Block coordinate descent with extrapolation on an OpenCL device: the method "hals".
 *
 * Each step sets every point's row of a factor to the best non-negative one for the other factor held (the T x T normal
 * equations of the point, a few sweeps of coordinate descent: Cichocki and Phan 2009), then carries both factors on
 * along their last change (Ang and Gillis 2019). A step that would raise the objective is not taken: the next starts
 * from the last good factors with a shorter extrapolation. docs/factorization.md has the figures. */
#ifndef FACTOR_HALS_H
#define FACTOR_HALS_H

#include "factor/method.h"

#include "base/opencl.h"

/* More terms than this have normal equations too large for a device's registers and stack. */
enum { HALS_TERMS = 256 };

struct hals_options {
    int far; /* 0: exact normal matrices; 1: summed over cells of points away from the centre */
};

struct hals_options hals_options_default(void);

/* Compile the kernels, place the problem on the device and start from random factors. `options` may be NULL: default.
 * The method keeps `opencl`, which must outlive it. Refuses more than HALS_TERMS terms. */
int hals_new(const struct opencl *opencl, const struct problem *problem,
             const struct hals_options *options, struct method **method, struct nacre_error *error);

#endif
