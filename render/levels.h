/* How far away light is taken sample by sample, by surface points of the material, and by squares of 2, 4, 8 and 16 of
 * them, and the kernels as each of these sees them.
 *
 * Each kernel is cut into rings by smooth windows that sum to 1, so that nothing jumps where one ring goes over to the
 * next. A ring's kernels are corrected, to second order in the size of what is summed up, for what summing up changes:
 * light spread over a square as it is centred, and receivers' sums smoothed as they are interpolated (posts.h). */
#ifndef RENDER_LEVELS_H
#define RENDER_LEVELS_H

#include "nacre/error.h"
#include "render/appearance.h"

enum { LEVELS_MAXIMUM = 4 };

/* Kernels of one ring: no light comes from nearer than `inner` or from `outer` on, in surface points. */
struct level {
    double inner, outer;
    int side; /* of the tables */
    const float *table;
    float *owned; /* the table, where it is not the appearance's */
};

struct levels {
    /* As appearance.kernels. Light of a surface point, of variance v (points^2) along each axis, has kernel
     * points.table + v bends. */
    struct level samples, points;
    float *bends;
    bool merges;                          /* points are used */
    int count;                            /* of squares */
    struct level squares[LEVELS_MAXIMUM]; /* of 2^(index + 1) points; as basis.table */
    double estimate;                      /* of the error that summing up makes, over all light */
};

/* Choose rings so that the estimated error is at most `tolerance`; 0: every sample by itself. */
int levels_make(struct levels *levels, const struct appearance *appearance, double tolerance,
                struct nacre_error *error);
void levels_finish(struct levels *levels);

#endif
