/* The projector's lamp: how bright it is at which time. */
#ifndef RIG_VIRTUAL_LAMP_H
#define RIG_VIRTUAL_LAMP_H

#include "rig/virtual/settings.h"

#include <stdint.h>

/* What the lamp's wandering, and its flicker, add to a mean brightness of 1 over the time from begin_ns to end_ns: a
 * function of the seed and the station's time alone. */
double lamp_drift(const struct virtual_lamp *lamp, int seed, int64_t begin_ns, int64_t end_ns);
double lamp_flicker(const struct virtual_lamp *lamp, int seed, int64_t begin_ns, int64_t end_ns);

#endif
