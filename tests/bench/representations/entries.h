/* The entries of a sample with their weights, distance by distance: what the reference fits go through. */
#ifndef TESTS_BENCH_REPRESENTATIONS_ENTRIES_H
#define TESTS_BENCH_REPRESENTATIONS_ENTRIES_H

#include "sample.h"

#include "factor/factorize.h"

struct entries {
    int width, height, channels, window;
    int count;    /* distances */
    int *dx, *dy; /* x_o - x_i */
    double *targets,
        *weights; /* [channels][count][height][width of x_i]; weight 0 where not known */
    double rest;  /* what the folding left out of half the sum of squares: nothing can lower it */
};

/* Entries of `measured`, laid out as in struct sample. Weights are W^2: of W = 1 / ||R_i||, or 1 / sqrt(g) with g the mean
 * response and 1e-5 of its maximum. Folded, one of each two distances d and -d is left, with the weighted mean of
 * R(x_i, x_o) and R(x_o, x_i): for models in which both are the same. entries_finish. */
void entries_make(const struct sample *sample, const float *measured, enum factor_weight weight,
                  bool folded, struct entries *entries);

/* Of x_i in the order of the plane, the part for which x_o = x_i + shift lies in the plane too. It holds some x_o at the
 * other side of the sample; their weights are 0. */
struct span {
    size_t start; /* of the distance's targets and weights */
    ptrdiff_t shift;
    size_t first, end;
};
struct span entries_span(const struct entries *entries, int channel, int distance);

void entries_finish(struct entries *entries);

#endif
