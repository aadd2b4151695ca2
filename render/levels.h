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

#include <stdbool.h>

enum { LEVELS_MAXIMUM = 4 };

/* Where a ring sets in, having risen since LEVELS_RISE times as near, and where the next one has taken over, in surface
 * points; 0 and HUGE_VAL where it is the first and the last. The ring of samples may have no width. */
struct ring {
    double begin, end;
};

#define LEVELS_RISE 0.2

/* Kernels for squares: no light comes from nearer than `inner` or from `outer` on. */
struct level {
    double inner, outer;
    float *table; /* as basis.table, of the ring */
};

struct levels {
    struct ring samples, points;
    bool merges; /* points are used */
    /* As appearance.kernels, as far as samples and points need them: they are windowed where they are read. Light of a
     * surface point, of variance v (points^2) along each axis, has kernel near + v bends. */
    int near_side;
    const float *near;
    float *near_owned; /* where it is not the appearance's */
    float *bends;
    int count;                            /* of squares */
    struct level squares[LEVELS_MAXIMUM]; /* of 2^(index + 1) points */
    double estimate;                      /* of the error that summing up makes, over all light */
};

/* Choose rings so that the estimated error is at most `tolerance`; 0: every sample by itself. */
int levels_make(struct levels *levels, const struct appearance *appearance, double tolerance,
                struct nacre_error *error);

/* Of one material: whether all rings are the same. */
bool levels_equal(const struct levels *a, const struct levels *b);
void levels_finish(struct levels *levels);

#endif
