/* Mean and variance per pixel over many frames, in one pass (Welford). */
#ifndef RIG_DEVELOP_MOMENTS_H
#define RIG_DEVELOP_MOMENTS_H

#include "nacre/error.h"

#include <stddef.h>
#include <stdint.h>

/* Zero-initialised it is empty; moments_finish frees. */
struct moments {
    size_t pixels;
    uint32_t *count; /* of values that were not NaN */
    double *mean;
    double *square; /* sum of squared deviations from the mean */
};

int moments_init(struct moments *moments, size_t pixels, struct nacre_error *error);
void moments_finish(struct moments *moments);

/* Add a frame; NaN values are left out. */
void moments_add(struct moments *moments, const float *values);

/* NaN where no value was added. */
double moments_mean(const struct moments *moments, size_t pixel);

/* Of a single value, unbiased; NaN below two values. */
double moments_variance(const struct moments *moments, size_t pixel);

#endif
