/* The mean relative error of factors on a few points of the sample: cheap enough to watch while iterating. */
#ifndef FACTOR_PROBE_H
#define FACTOR_PROBE_H

#include "factor/factors.h"

struct probe {
    const struct responses *responses;
    size_t count;   /* points */
    size_t *points; /* [count]: y * width + x, rising */
    float *
        windows; /* [count][channels][K][K], scaled units; NaN where not measured or outside the sample */
    double *norms;                      /* [count]: of the windows, squared */
    double *misses;                     /* [count]: of the difference, squared; work space */
    double *beyond;                     /* [count]: of what was measured beyond them, squared */
    int largest;                        /* exponent: norms are squares in units of 2^largest */
    float *lines;                       /* [count][K]; work space */
    double weights[RESPONSES_CHANNELS]; /* that make the channels' squares comparable */
};

/* Choose at most `most` measured points, spread over the sample, and keep what was measured there. With no more points
 * than that the error is that of all. Keeps `responses`. probe_finish, also after a failure. */
int probe_begin(struct probe *probe, const struct responses *responses, size_t most, uint64_t seed,
                struct nacre_error *error);

/* The mean of ||measured - factored|| / ||measured|| over the points that are not dark; 0 where all are. */
double probe_measure(const struct probe *probe, const struct problem *problem,
                     const struct factors *factors);

void probe_finish(struct probe *probe); /* a zeroed one is allowed */

#endif
