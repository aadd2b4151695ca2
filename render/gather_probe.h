/* How far a gather that sums light up is off, measured on some of the vertices.
 *
 * Vertices are drawn in groups that lie close together, half of the draws by what leaves them and half evenly, and
 * gathered once more sample by sample. As every group's chance is known, the mean square of the differences over all
 * vertices follows without bias, and from the draws' scatter how sure that is. */
#ifndef RENDER_GATHER_PROBE_H
#define RENDER_GATHER_PROBE_H

#include "nacre/error.h"
#include "render/reach.h"
#include "render/receivers.h"

#include <stddef.h>
#include <stdint.h>

enum { GATHER_PROBES = 48 };

struct gather_probe {
    size_t draws;
    size_t *groups;               /* [draws], by the bundle of the mesh that they are in */
    double *chances;              /* [draws] */
    double power;                 /* of what leaves all vertices, squared */
    struct reach_bundles bundles; /* all receivers of the drawn vertices */
};

/* Draw groups, light[vertex][3] being what leaves. */
int gather_probe_make(struct gather_probe *probe, const struct receivers *receivers,
                      const struct reach_bundles *bundles, float (*light)[3],
                      struct nacre_error *error);
void gather_probe_finish(struct gather_probe *probe);

/* The root mean square over all vertices and channels by which light is off over its own: not above this but once in
 * some hundred times. exact[vertex][3] is right where vertices are drawn. */
double gather_probe_error(const struct gather_probe *probe, const struct receivers *receivers,
                          const struct reach_bundles *bundles, float (*light)[3],
                          float (*exact)[3]);

#endif
