/* The clock seam: all time that decides anything is read here, so that tests and the virtual station can lend their
 * own. */
#ifndef BASE_CLOCK_H
#define BASE_CLOCK_H

#include <stdint.h>

struct clock;

struct clock_ops {
    const char *name;
    /* Nanoseconds since some fixed moment; never goes back. */
    int64_t (*now_ns)(struct clock *clock);
    /* Return at `time_ns` or as soon after as can be; at once if it has passed. */
    void (*sleep_until_ns)(struct clock *clock, int64_t time_ns);
};

/* A concrete clock embeds this as its first member. */
struct clock {
    const struct clock_ops *ops;
};

/* CLOCK_MONOTONIC. Needs no clean-up. */
struct clock clock_monotonic(void);

static inline int64_t clock_now_ns(struct clock *clock)
{
    return clock->ops->now_ns(clock);
}

static inline void clock_sleep_until_ns(struct clock *clock, int64_t time_ns)
{
    clock->ops->sleep_until_ns(clock, time_ns);
}

#endif
