/* The trigger seam: what starts (and with trigger-width cameras ends) an exposure. */
#ifndef RIG_TRIGGER_H
#define RIG_TRIGGER_H

#include "nacre/error.h"

#include <stdbool.h>
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

/* What a trigger measured of a pulse that it timed itself; zero where it did not. */
struct trigger_pulse {
    int64_t rise_ns, width_ns; /* on the station's clock */
    int64_t doubt_ns;          /* the width may be wrong by this */
    bool realtime;             /* timed with priority over other programs */
};

/* A concrete trigger embeds this as its first member. */
struct trigger {
    const struct trigger_ops *ops;
    struct trigger_pulse pulse; /* the last one */
};

#endif
