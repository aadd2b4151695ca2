/* What a virtual station simulates, what it leaves out, why, and at what cost: for people. */
#ifndef RIG_VIRTUAL_EFFECTS_LIST_H
#define RIG_VIRTUAL_EFFECTS_LIST_H

#include "rig/plan.h"
#include "rig/station.h"
#include "rig/virtual/explain.h"
#include "rig/virtual/sample.h"

/* Every effect of the station with what lies on it, in the order of light's way; `seconds` are those of a frame, on one
 * core, of a pattern's share in it where the effect is computed once a pattern. `sample` may be NULL: a white board.
 * *effects is heap memory. */
int effects_list(const struct station *station, const struct sample *sample,
                 const struct plan *plan, struct effect **effects, size_t *count,
                 struct nacre_error *error);

#endif
