/* The white layer during a scan: asking the person for it, and looking whether it was done. */
#ifndef RIG_SEQUENCE_LAYER_H
#define RIG_SEQUENCE_LAYER_H

#include "rig/layer_check.h"
#include "rig/sequence.h"

/* Zero-initialise, then set the first members; sequence_layer_finish frees. */
struct sequence_layer {
    const struct sequence_operator *person;
    struct clock *clock;
    bool checked; /* look at check frames: `check` was begun */
    struct layer_check check;

    bool known, on;
    int64_t person_ns; /* waited for the person */
    size_t insisted;   /* changes that were not seen */
};

/* Have the layer laid on or taken off, where it is not so already. */
int sequence_layer_set(struct sequence_layer *layer, bool on, struct nacre_error *error);

/* Have the layer laid on and look whether dots are where the frame of `source` that `check` remembers has them.
 * *worst_px is by how much they moved; more than layer_moved_px is refused. Insisting does not help. */
int sequence_layer_verify(struct sequence_layer *layer, const char *source, double *worst_px,
                          struct nacre_error *error);

void sequence_layer_finish(struct sequence_layer *layer);

#endif
