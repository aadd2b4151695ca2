/* The projector seam: what the sequencer needs of any projector. */
#ifndef RIG_PROJECTOR_H
#define RIG_PROJECTOR_H

#include "nacre/error.h"

#include <stdint.h>

struct projector;

struct projector_ops {
    const char *name;
    /* Put `levels` (uint8_t[height][width], 0 black to 255 white, one value a projector pixel, on
     * all colours) on the glass and wait until it is there. Writes when it appeared, on the
     * station's clock. On failure what is shown is unknown. */
    int (*show)(struct projector *projector, const uint8_t *levels, int64_t *flip_ns,
                struct nacre_error *error);
    /* Blank the projector and free everything, the projector too. */
    void (*close)(struct projector *projector);
    /* Whether what was shown last still is, as far as can be known; asked after a pattern's
     * exposures. May be NULL. */
    int (*confirm)(struct projector *projector, struct nacre_error *error);
};

/* A concrete projector embeds this as its first member. */
struct projector {
    const struct projector_ops *ops;
    int width, height; /* pixels of the sample's region: one is one surface point */
    int64_t period_ns; /* of one refresh, a turn of the colour wheel; exposures are whole multiples
                          of it */
};

#endif
