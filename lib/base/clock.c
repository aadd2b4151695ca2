/* The system's monotonic clock behind the clock seam. */
#include "base/clock.h"

#include <errno.h>
#include <time.h>

static int64_t now_ns(struct clock *clock)
{
    struct timespec now;
    (void)clock;
    (void)clock_gettime(CLOCK_MONOTONIC, &now); /* cannot fail for a clock that exists */
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static void sleep_until_ns(struct clock *clock, int64_t time_ns)
{
    struct timespec until = {.tv_sec = time_ns / 1000000000, .tv_nsec = time_ns % 1000000000};
    (void)clock;
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) == EINTR) {
    }
}

struct clock clock_monotonic(void)
{
    static const struct clock_ops ops = {
        .name = "monotonic", .now_ns = now_ns, .sleep_until_ns = sleep_until_ns};
    return (struct clock){.ops = &ops};
}
