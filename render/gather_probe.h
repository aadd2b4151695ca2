/* How far a gather that sums light up is off, measured on some of the vertices.
 *
 * Groups of vertices that lie close together are drawn, half of them by how much light falls around and half evenly.
 * They are gathered both ways. As every group's chance is known, the mean squares over all vertices follow, and from the
 * draws' scatter how sure their ratio is. */
#ifndef RENDER_GATHER_PROBE_H
#define RENDER_GATHER_PROBE_H

#include "render/gather_stock.h"

#include <stddef.h>

enum { GATHER_PROBES = 40 };

struct gather_probe {
    const struct gather_stock *stock;
    size_t draws;
    size_t *groups;               /* [draws], by the bundle of the mesh that they are in */
    double *chances;              /* [draws] */
    struct reach_bundles bundles; /* all receivers of the drawn vertices */
};

int gather_probe_make(struct gather_probe *probe, const struct gather_stock *stock,
                      struct nacre_error *error);
void gather_probe_finish(struct gather_probe *probe);

/* The root mean square over all vertices and channels by which light[vertex][3] is off, over that of exact[vertex][3]: at
 * most this, by three standard errors, where what is off is spread over a tenth of the surface or more: 40 groups can miss
 * what is off in a few small places. Both are right where vertices are drawn. HUGE_VAL where no light was seen. */
double gather_probe_error(const struct gather_probe *probe, float (*light)[3], float (*exact)[3]);

#endif
