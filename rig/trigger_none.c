/* The trigger that is none. */
#include "rig/trigger_none.h"

#include <stdlib.h>

struct none_trigger {
    struct trigger base;
    struct clock *clock;
};

static int fire(struct trigger *base, int64_t exposure_ns, int64_t *trigger_ns,
                struct nacre_error *error)
{
    (void)exposure_ns; /* the camera's own */
    (void)error;       /* nothing can fail */
    *trigger_ns = clock_now_ns(((struct none_trigger *)base)->clock);
    return NACRE_OK;
}

static void trigger_close(struct trigger *base)
{
    free(base);
}

int trigger_none_new(struct clock *clock, struct trigger **trigger, struct nacre_error *error)
{
    static const struct trigger_ops ops = {.name = "none", .fire = fire, .close = trigger_close};
    struct none_trigger *made = calloc(1, sizeof *made);
    if (!made) {
        return nacre_fail_memory(error, "a trigger");
    }
    *made = (struct none_trigger){.base = {.ops = &ops}, .clock = clock};
    *trigger = &made->base;
    return NACRE_OK;
}
