/* The devices that a station file names, opened. */
#ifndef RIG_DEVICES_H
#define RIG_DEVICES_H

#include "base/clock.h"
#include "rig/camera.h"
#include "rig/station.h"
#include "rig/trigger.h"

/* Open the camera or the trigger of a station that has a real one: a virtual one belongs to a virtual station and is
 * refused. `clock` is the system's monotonic one and outlives the device; nothing of `station` is kept. */
int devices_open_camera(const struct station *station, struct clock *clock, struct camera **camera,
                        struct nacre_error *error);
int devices_open_trigger(const struct station *station, struct clock *clock,
                         struct trigger **trigger, struct nacre_error *error);

#endif
