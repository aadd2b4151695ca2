/* How a patch is cut into blocks that are convolved one by one.
 *
 * Lattice node n lies at (n + 1/2) / fine surface points: with `fine` 1 on their middles. What leaves is worked out on
 * nodes, and read between them by cubic B-splines; kernels are sharpened beforehand by what the splines blur, which reaches
 * CONVOLVE_TAIL nodes farther. A block serves the receivers of some surface points, and its transform has room for all
 * light in their reach, so that nothing wraps around. Where tiles are mirrored, so are the kernels of the receivers on
 * them. */
#ifndef RENDER_CONVOLVE_PLAN_H
#define RENDER_CONVOLVE_PLAN_H

#include "render/appearance.h"
#include "render/convolve_patches.h"
#include "render/mapping.h"

/* The sharpening falls by 0.268 a node: to 4e-7. */
enum { CONVOLVE_TAIL = 10, CONVOLVE_AXIS_BLOCKS = 64, CONVOLVE_FINEST = 2 };

struct convolve_axis {
    int size;  /* of the transform */
    int count; /* of blocks */
    /* Block i serves surface points starts[i] ... starts[i + 1] - 1. */
    int starts[CONVOLVE_AXIS_BLOCKS + 1];
};

struct convolve_plan {
    int fine;  /* nodes to a surface point along each axis */
    int reach; /* nodes to either side that a sharpened kernel reaches */
    struct convolve_axis x, y;
    /* To be transformed: of all blocks there and, for each way in which kernels are mirrored, back. */
    double points;
};

/* Planes of light that are transformed, and of what leaves. */
struct convolve_planes {
    int in, out;
};

/* The quickest way to cut; points is HUGE_VAL where none is reasonable. */
void convolve_plan(struct convolve_plan *plan, const struct convolve_patch *patch,
                   const struct mapping *mapping, const struct appearance *appearance,
                   struct convolve_planes planes, int fine);

#endif
