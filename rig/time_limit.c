/* Whether there is time for one more pattern before a run must be over. */
#include "rig/time_limit.h"

bool time_limit_allows(const struct time_limit *limit, int64_t passed_ns, int64_t exposure_ns)
{
    return limit->within_ns == 0 ||
           passed_ns + exposure_ns + limit->overhead_ns <= limit->within_ns;
}

void time_limit_learn(struct time_limit *limit, int64_t took_ns, int64_t exposure_ns)
{
    int64_t overhead_ns = took_ns - exposure_ns;
    if (overhead_ns > limit->overhead_ns) {
        limit->overhead_ns = overhead_ns;
    }
}
