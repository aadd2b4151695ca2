/* What the passes of a gather share: receivers, lit samples, what they are summed up to, and lattices of posts, each made
 * when the first pass asks for it. */
#ifndef RENDER_GATHER_STOCK_H
#define RENDER_GATHER_STOCK_H

#include "render/gather.h"
#include "render/gather_surface.h"
#include "render/levels.h"
#include "render/posts.h"
#include "render/reach.h"
#include "render/sources.h"

/* A lattice of posts, or the vertices. */
struct gather_stage {
    const struct receiver *receivers;
    size_t count;
    struct reach_bundles bundles;
    struct posts posts; /* of the next coarser lattice, once there is one */
};

struct gather_stock {
    const struct gather *gather;
    struct gather_surface *surface; /* the gather's, or the own one */
    struct gather_surface own;
    struct receivers receivers; /* the surface's */
    struct source_set samples;
    struct source_set by_kernel; /* the same, for passes that take them all */
    struct sources sources;
    struct gather_stage stages[LEVELS_MAXIMUM + 1]; /* vertices, then posts from fine to coarse */
    int stage_count;                                /* at least 1, if there are receivers */
};

int gather_stock_make(struct gather_stock *stock, const struct gather *gather,
                      struct nacre_error *error);

/* Make what passes of these levels need. */
int gather_stock_extend(struct gather_stock *stock, const struct levels *levels,
                        struct nacre_error *error);
void gather_stock_finish(struct gather_stock *stock);

#endif
