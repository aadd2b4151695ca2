/* The kernels g(d): one homogeneous response for each cluster (paper, section 5.2). */
#ifndef FACTOR_KERNELS_H
#define FACTOR_KERNELS_H

#include "factor/responses.h"

enum kernels_kind {
    KERNELS_AVERAGE, /* the mean response of the cluster's points */
    KERNELS_MAXIMUM, /* its largest value, entry by entry */
};

/* Write kernels[clusters][channels][K][K] in the responses' scaled units from the measured entries inside the sample;
 * ids[height][width] are the points' clusters. An entry of which a cluster has no measurement is that of all points
 * together, as is the whole kernel of a cluster which is empty or dark; of a channel that is dark everywhere kernels are
 * 1. Then epsilon times each kernel's maximum is added, so that all are above 0. */
int kernels_compute(const struct responses *responses, const uint32_t *ids, int clusters,
                    enum kernels_kind kind, double epsilon, float *kernels,
                    struct nacre_error *error);

#endif
