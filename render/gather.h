/* The light that leaves each vertex of a translucent surface: paper section 6.
 *
 * pi L(x_o) = sum over samples x_i of flux(x_i) R_d(x_i, x_o) / point^2. F is read at the surface point on which x_i
 * lies, H between surface points at x_o. The offset x_o - x_i, at which the kernels are read between surface points,
 * has the direction that the mapping shows at x_o and the length of the distance in space, so that cuts in the texture
 * coordinates do not show. Where x_i is not within a window of x_o in the texture, F is read at x_o minus the offset. */
#ifndef RENDER_GATHER_H
#define RENDER_GATHER_H

#include "base/opencl.h"
#include "base/progress.h"
#include "render/appearance.h"
#include "render/mapping.h"
#include "render/mesh.h"
#include "render/samples.h"

#include <stdbool.h>
#include <stdint.h>

enum gather_way {
    GATHER_SOONEST,
    GATHER_SUMMED, /* even where that is not sooner, and nothing convolved: for checks of summing up */
    GATHER_CONVOLVED /* all that can be, even where that is not sooner: for checks of convolution */
};

struct gather_surface;

struct gather {
    const struct mesh *mesh;
    const struct mapping *mapping;
    const struct appearance *appearance;
    const struct light_samples *samples;
    bool same_side; /* only light that falls on the side where it leaves */
    /* Light is summed up where that is sooner and changes what leaves by at most this share: root mean square over all
     * vertices, measured on some (gather_probe.h). 0: every sample by itself. */
    double tolerance;
    enum gather_way way;
    struct gather_surface *surface; /* of this object, mapping and appearance; NULL: not kept */
};

struct gather_counts {
    uint64_t receivers, samples;
    uint64_t
        points; /* pairs looked at of a vertex and a sample or a surface point, also for checks */
    uint64_t squares,
        posts; /* pairs of a post and a square, and posts; 0 where samples were taken one by one */
    uint64_t convolved; /* receivers that were served by convolution (convolve.h) */
    double error;       /* that summing up and convolving make, as the tolerance has it, measured */
    double prepare_seconds, choose_seconds, launch_seconds;
};

/* Add the smooth part of what leaves each vertex to radiosity[vertex][3], on the OpenCL device. */
int gather_run(const struct gather *gather, const struct opencl *opencl, struct progress *progress,
               float (*radiosity)[3], struct gather_counts *counts, struct nacre_error *error);

/* The same sum over every sample in double precision, plainly: what gather_run is checked against. */
int gather_reference(const struct gather *gather, float (*radiosity)[3], struct nacre_error *error);

#endif
