/* The projector's colour wheel: what an exposure gets of each colour. */
#ifndef RIG_VIRTUAL_WHEEL_H
#define RIG_VIRTUAL_WHEEL_H

#include "rig/virtual/settings.h"

#include <stdbool.h>
#include <stdint.h>

enum { WHEEL_SEGMENTS = 16 };

/* Zero-initialised it has no segments. */
struct wheel {
    double period_ns;
    double phase; /* in turns */
    int count;
    double ends[WHEEL_SEGMENTS];     /* of the segments, in turns; the last is 1 */
    double light[WHEEL_SEGMENTS][3]; /* relative to its mean over a turn */
};

/* Of settings that settings_check.h has passed. */
void wheel_init(const struct virtual_wheel *settings, double wheel_hz, struct wheel *wheel);

/* The light of each channel in an exposure over that of as long a time of white: exactly the overlap of exposure and
 * segments. False where the exposure is whole turns, to a nanosecond, and so all are 1. */
bool wheel_gains(const struct wheel *wheel, int64_t begin_ns, int64_t exposure_ns, double gains[3]);

#endif
