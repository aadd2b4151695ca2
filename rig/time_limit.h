/* Whether there is time for one more pattern before a run must be over. */
#ifndef RIG_TIME_LIMIT_H
#define RIG_TIME_LIMIT_H

#include <stdbool.h>
#include <stdint.h>

/* Zero-initialised there is no limit. */
struct time_limit {
    int64_t within_ns;   /* from the beginning of the run; 0: no limit */
    int64_t overhead_ns; /* the most that a pattern has taken so far beyond its exposures */
};

/* Whether a pattern of so much exposure, begun so long after the run's beginning, is foreseen to be done in time: it takes its
 * exposures and what the slowest pattern so far took beyond its own, retakes included. */
bool time_limit_allows(const struct time_limit *limit, int64_t passed_ns, int64_t exposure_ns);

/* Take note of a pattern that took so long. */
void time_limit_learn(struct time_limit *limit, int64_t took_ns, int64_t exposure_ns);

#endif
