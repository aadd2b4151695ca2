/* The updates as one would write them in C with OpenMP in an afternoon: what the kernels are compared with. */
#ifndef TESTS_BENCH_PEER_H
#define TESTS_BENCH_PEER_H

#include <stdbool.h>
#include <stdint.h>

/* One channel. */
struct peer {
    int width, height, window, terms;
    const float *responses; /* [height][width][K][K] */
    const uint32_t *ids;    /* [height][width]: the cluster of each point */
    const float *kernels;   /* [clusters][K][K] */
    float *f, *h;           /* [height][width][terms] */
};

/* One update of F, or of H. */
void peer_update(struct peer *peer, bool of_h);

#endif
