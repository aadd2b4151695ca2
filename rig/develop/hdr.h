/* Merging the raw exposures of a pattern into one radiance per pixel. */
#ifndef RIG_DEVELOP_HDR_H
#define RIG_DEVELOP_HDR_H

#include "rig/session.h"

#include <stddef.h>

/* What the sensor adds to the light. */
struct noise_model {
    double pedestal;   /* raw value without light */
    double read_noise; /* standard deviation, raw units */
    double electrons;  /* photo-electrons in one raw unit; 0: no shot noise */
};

/* Whether a raw value says only "at least this": the top value and, as a guard, the one below it. */
static inline int hdr_is_saturated(unsigned raw, int bits)
{
    return raw + 1 >= (1U << bits) - 1;
}

/* radiance[height][width] in raw units a second with the pedestal subtracted: the mean of the exposures weighted by the
 * inverse of their noise. The noise is that of the radiance as estimated from all exposures, not of each sample, which
 * would weigh samples that came out low by chance more and so read low. For the same reason an exposure is left out
 * where the estimate comes near saturation, not where the sample happens to reach it. NaN where every exposure is
 * saturated; returns how many. variance[height][width], of the merged value, may be NULL. */
size_t hdr_merge(const struct pattern_frames *frames, const struct noise_model *noise,
                 float *radiance, float *variance);

#endif
