/* The virtual station: camera, projector, trigger and clock of a simulated rig behind the seams of the real ones. */
#ifndef RIG_VIRTUAL_VIRTUAL_H
#define RIG_VIRTUAL_VIRTUAL_H

#include "base/clock.h"
#include "rig/camera.h"
#include "rig/plan.h"
#include "rig/projector.h"
#include "rig/session.h"
#include "rig/station.h"
#include "rig/trigger.h"
#include "rig/virtual/effects.h"

struct virtual_station;

/* Build the station that station->simulated describes. Its time is simulated: it passes only in exposures and waits.
 * Keeps what it needs of `station`. */
int virtual_station_new(const struct station *station, struct virtual_station **simulated,
                        struct nacre_error *error);

/* The devices; they belong to the virtual station, and their close does nothing. */
struct camera *virtual_station_camera(struct virtual_station *simulated);
struct projector *virtual_station_projector(struct virtual_station *simulated);
struct trigger *virtual_station_trigger(struct virtual_station *simulated);
struct clock *virtual_station_clock(struct virtual_station *simulated);

/* What is simulated, and the work done for it so far. */
const struct effects *virtual_station_effects(const struct virtual_station *simulated);

/* Lay the white diffuse layer on the sample or take it off (what the operator does at a real station). */
void virtual_station_set_white_layer(struct virtual_station *simulated, int on);

/* Say which pattern comes next: the noise of its frames depends on it and not on what was shown before, so that a
 * resumed scan equals an undisturbed one. */
void virtual_station_begin_pattern(struct virtual_station *simulated, struct pattern pattern);

/* Let time and the camera's count go on from these frames, the last that an earlier run took: what depends on time, as a
 * lamp's light, is then what it would be without the break. */
void virtual_station_go_on(struct virtual_station *simulated, const struct pattern_frames *before);

/* From now on `show` returns, and tells, the refresh that takes a pattern; it is on the glass its latency later. So does a
 * real projector whose latency is not known yet. */
int virtual_station_tell_refreshes(struct virtual_station *simulated, struct nacre_error *error);

void virtual_station_free(struct virtual_station *simulated); /* NULL is allowed */

#endif
