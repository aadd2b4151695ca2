/* The trigger seam: what starts (and with trigger-width cameras ends) an exposure. */
#ifndef RIG_TRIGGER_H
#define RIG_TRIGGER_H

#include "nacre/error.h"

#include <stdint.h>

struct trigger;

struct trigger_ops {
    const char *name;
    /* Give one trigger pulse of exposure_ns. Writes the time of its rising edge on the station's
     * clock. */
    int (*fire)(struct trigger *trigger, int64_t exposure_ns, int64_t *trigger_ns,
                struct nacre_error *error);
    void (*close)(struct trigger *trigger);
};

/* A concrete trigger embeds this as its first member. */
struct trigger {
    const struct trigger_ops *ops;
};

#endif
