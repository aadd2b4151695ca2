/* One pass over the light: what leaves some or all vertices, with light summed up as far as the levels say. */
#ifndef RENDER_GATHER_PASS_H
#define RENDER_GATHER_PASS_H

#include "render/gather_device.h"
#include "render/levels.h"
#include "render/reach.h"

struct gather_pass {
    const struct gather *gather;
    const struct gather_device *device;
    const struct receivers *receivers;   /* all of the mesh's */
    const struct reach_bundles *bundles; /* of those that are asked for */
    const struct source_set *samples;    /* the lit ones */
    const struct levels *levels;
};

/* What leaves, into light[vertex][3] of the receivers asked for, which is cleared first; `counts` go on. */
int gather_pass_run(const struct gather_pass *pass, struct progress *progress, float (*light)[3],
                    struct gather_counts *counts, struct nacre_error *error);

#endif
