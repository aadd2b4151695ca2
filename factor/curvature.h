/* The far part of the normal matrices that hals steps with, summed over cells of points: see curvature.cl. */
#ifndef FACTOR_CURVATURE_H
#define FACTOR_CURVATURE_H

#include "factor/layout.h"

enum { CURVATURE_CELL = 4 /* as CELL in curvature.cl */ };

/* As struct cells in curvature.cl. */
struct cells {
    cl_int columns, rows, reach, blocks, stride, pad, wide;
};

struct curvature {
    const struct layout *layout;
    struct cells cells;
    int near;        /* entries so far from the centre, in x or y, are not in the far part */
    int tile, pairs; /* side of a corner and accumulators of one matrix, as in curvature.cl */
    struct {
        cl_mem weights, masses; /* see curvature.cl */
    } channels[RESPONSES_CHANNELS];
    cl_mem pooled, gathered, far; /* of the factor gathered last */
    cl_kernel pool, gather;
};

/* Find the weights of a placed problem's kernels. Keeps `layout` and the program's kernels `pool` and `gather_far`.
 * curvature_finish, also after a failure. */
int curvature_begin(struct curvature *v, const struct layout *layout, cl_program program, int near,
                    int tile, int pairs, struct nacre_error *error);
void curvature_finish(struct curvature *v); /* a zeroed one is allowed */

/* Bytes on the device that curvature_begin takes. */
double curvature_bytes(const struct problem *problem, int near, int pairs);

/* Fill `far` for the step of F with H = factor, or (outgoing) of H with F = factor. */
int curvature_gather(struct curvature *v, int channel, cl_mem factor, bool outgoing,
                     struct nacre_error *error);

#endif
