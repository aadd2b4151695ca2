/* The devices of a station, real or virtual, open. */
#ifndef CMD_STAND_H
#define CMD_STAND_H

#include "rig/devices.h"
#include "rig/virtual/virtual.h"

struct stand {
    struct virtual_station *simulated; /* NULL: the devices are real */
    struct clock system;
    struct devices devices;
};

/* Open the devices that `station` names, which a virtual station and a real one do each in its way. *stand must stay
 * where it is while it is open. */
int stand_open(const struct station *station, struct stand *stand, struct nacre_error *error);
void stand_close(struct stand *stand); /* zeroed, or one that did not open: nothing happens */

#endif
