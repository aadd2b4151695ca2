/* The part of a gather that is done by convolution, where that is sooner and near enough. */
#ifndef RENDER_GATHER_CONVOLVED_H
#define RENDER_GATHER_CONVOLVED_H

#include "render/convolve.h"
#include "render/convolve_cost.h"
#include "render/gather_cost.h"
#include "render/gather_probe.h"
#include "render/gather_stock.h"

struct gather_convolved {
    const struct gather_stock *stock;
    struct convolve_patches patches; /* the surface's, but for those that are left out */
    struct convolve_light how;
    int fine;
    float (*light)[3];             /* [receivers] */
    struct convolve_served served; /* none: nothing is convolved */
    struct reach_bundles rest;     /* of the others */
    struct gather_cost without;    /* what the gather costs without */
};

/* Convolve, if that pays beside what the gather costs without it; with GATHER_CONVOLVED wherever it can be done. */
int gather_convolved_make(struct gather_convolved *convolved, const struct gather_stock *stock,
                          struct gather_cost cost, struct progress *progress,
                          struct nacre_error *error);
void gather_convolved_finish(struct gather_convolved *convolved);

/* Whether receiver i is served. */
static inline bool gather_convolved_serves(const struct gather_convolved *convolved, size_t i)
{
    return convolved->served.count > 0 && convolved->patches.misfit[i] <= convolved->served.limit;
}

/* Take a finer lattice, or serve fewer receivers, until what is off on the probe's vertices is within the tolerance: *off.
 * `light` is work space. Afterwards `rest` are those that are not served. */
int gather_convolved_check(struct gather_convolved *convolved, const struct gather_probe *probe,
                           struct progress *progress, float (*exact)[3], float (*light)[3],
                           double *off, struct nacre_error *error);

/* Write what leaves the vertices that are served over light[vertex][3]. */
void gather_convolved_put(const struct gather_convolved *convolved, float (*light)[3]);

#endif
