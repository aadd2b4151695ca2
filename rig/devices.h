/* The devices that a station file names, opened. */
#ifndef RIG_DEVICES_H
#define RIG_DEVICES_H

#include "base/clock.h"
#include "rig/camera.h"
#include "rig/projector.h"
#include "rig/station.h"
#include "rig/trigger.h"

/* All four live on the same clock. */
struct devices {
    struct camera *camera;
    struct projector *projector;
    struct trigger *trigger;
    struct clock *clock;
};

/* Open one device, or all, of a station that has real ones: a virtual one belongs to a virtual station and is refused.
 * `clock` is the system's monotonic one and outlives the devices; nothing of `station` is kept. */
int devices_open(const struct station *station, struct clock *clock, struct devices *devices,
                 struct nacre_error *error);
void devices_close(struct devices *devices); /* those that are open */
int devices_open_camera(const struct station *station, struct clock *clock, struct camera **camera,
                        struct nacre_error *error);
int devices_open_projector(const struct station *station, struct clock *clock,
                           struct projector **projector, struct nacre_error *error);
int devices_open_trigger(const struct station *station, struct clock *clock,
                         struct trigger **trigger, struct nacre_error *error);

#endif
