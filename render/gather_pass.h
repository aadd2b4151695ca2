/* One pass over the light: what leaves some or all vertices, with light summed up as far as the levels say. */
#ifndef RENDER_GATHER_PASS_H
#define RENDER_GATHER_PASS_H

#include "render/gather_device.h"
#include "render/gather_stock.h"

struct gather_pass {
    const struct gather_device *device;
    struct gather_stock *stock; /* extended as the levels need it */
    const struct levels *levels;
    const struct reach_bundles *vertices; /* NULL: all */
};

/* What leaves, into light[vertex][3] of the vertices asked for, which is cleared first; `counts` go on. */
int gather_pass_run(const struct gather_pass *pass, struct progress *progress, float (*light)[3],
                    struct gather_counts *counts, struct nacre_error *error);

#endif
