/* The light that leaves the level parts of a surface, by convolution in the texture: what gather.h says, where a kernel per
 * term makes it sum_t H_t (g_t * (F_t light)).
 *
 * Light is handed to the lattice nodes that are within a surface point of it along both axes by bilinear weights, which is
 * the same as reading kernels bilinearly between surface points: on nodes, on a level surface, what leaves is exact but for
 * rounding. */
#ifndef RENDER_CONVOLVE_H
#define RENDER_CONVOLVE_H

#include "base/progress.h"
#include "render/convolve_patches.h"
#include "render/convolve_plan.h"
#include "render/sources.h"

struct convolve {
    const struct mapping *mapping;
    const struct appearance *appearance;
    const struct receivers *receivers;
    const struct source_set *samples;
    const struct convolve_patches *patches;
};

/* What the colours of light and material let be shared. */
struct convolve_light {
    bool suits;      /* a kernel for each term, and light that is finite */
    bool one_color;  /* all light has one colour, and all colours the same F */
    float color[3];  /* that */
    bool one_kernel; /* and the kernels are the same for all of them */
    struct convolve_planes planes;
};

struct convolve_light convolve_light(const struct appearance *appearance,
                                     const struct source_set *samples);

/* light[receiver][3] of those in patches, on lattices of `fine` nodes to a surface point along each axis. */
int convolve_run(const struct convolve *convolve, const struct convolve_light *how, int fine,
                 struct progress *progress, float (*light)[3], struct nacre_error *error);

#endif
