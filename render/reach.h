/* Which runs of sources each bundle of receivers may get light from. */
#ifndef RENDER_REACH_H
#define RENDER_REACH_H

#include "nacre/error.h"
#include "render/bundles.h"
#include "render/receivers.h"
#include "render/sources.h"

#include <stdbool.h>

enum { REACH_LANES = 16 };

/* Receivers by 16, close together: bundle i has order[16 i ...]; the last is filled up with its last receiver. */
struct reach_bundles {
    size_t count;
    uint32_t *order; /* [count][16] */
    struct bundle_box *boxes;
};

/* For each bundle runs[starts[i] .. starts[i + 1]]; run k is sources 16 k ... */
struct reach {
    uint32_t *starts, *runs;
};

int reach_bundle(struct reach_bundles *bundles, const struct receiver *receivers, size_t count,
                 struct nacre_error *error);

/* Bundles of some receivers only; those `apart` or more from each other share none. */
int reach_bundle_some(struct reach_bundles *bundles, const struct receiver *receivers,
                      const struct reach_bundles *all, const bool *wanted, double apart,
                      struct nacre_error *error);
void reach_bundles_finish(struct reach_bundles *bundles);

/* Runs that are from `inner` to `outer` mm away, or partly so. */
int reach_make(struct reach *reach, const struct reach_bundles *bundles,
               const struct source_set *sources, double inner, double outer,
               struct nacre_error *error);
void reach_finish(struct reach *reach);

#endif
