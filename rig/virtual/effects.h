/* Which effects a virtual station simulates: those that its station and sample files call for, and no others. */
#ifndef RIG_VIRTUAL_EFFECTS_H
#define RIG_VIRTUAL_EFFECTS_H

#include "nacre/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct plan;
struct sample;
struct station;

/* Of the station; what happens inside the sample is listed by explain.h. In the order of light's way. */
enum effect_id {
    EFFECT_LATENCY,
    EFFECT_WHEEL,
    EFFECT_BLACK_LEVEL,
    EFFECT_PROJECTOR_VIGNETTING,
    EFFECT_LAMP_DRIFT,
    EFFECT_LAMP_FLICKER,
    EFFECT_MISALIGNMENT,
    EFFECT_PROJECTOR_DEFOCUS,
    EFFECT_LOCAL,
    EFFECT_DUST,
    EFFECT_TILT,
    EFFECT_DISTORTION,
    EFFECT_CAMERA_DEFOCUS,
    EFFECT_CAMERA_VIGNETTING,
    EFFECT_NONUNIFORMITY,
    EFFECT_DEAD_PIXELS,
    EFFECT_DARK_CURRENT,
    EFFECT_HOT_PIXELS,
    EFFECT_SHOT_NOISE,
    EFFECT_READ_NOISE,
    EFFECT_READOUT,
    EFFECT_DROPPED_FRAMES,
    EFFECT_LATE_FRAMES,
    EFFECT_STRAY_TRIGGER,
    EFFECTS
};

/* What `without` calls them, NULL-terminated, in the order of the enum. */
extern const char *const effect_names[];

struct effects {
    bool simulated[EFFECTS];
    uint64_t work[EFFECTS]; /* points, pixels, entries or frames that the effect was computed for */
};

/* tests/virtual/effects_cost.py compiles single effects out, or all of them (EFFECTS), to show that an effect which is not
 * called for costs what one that does not exist costs. */
#ifdef EFFECTS_WITHOUT
#define EFFECTS_BUILT(id) ((EFFECTS_WITHOUT) != EFFECTS && (id) != (EFFECTS_WITHOUT))
#else
#define EFFECTS_BUILT(id) true
#endif

/* Whether to simulate it; asked once a pattern, exposure or station, never for each point or pixel. */
static inline bool effects_has(const struct effects *effects, enum effect_id id)
{
    return EFFECTS_BUILT(id) && effects->simulated[id];
}

/* The effects that the files call for and do not forbid. `sample` is what lies on the stage; NULL: a white board. */
void effects_plan(const struct station *station, const struct sample *sample,
                  struct effects *effects);

/* Whether the station's or the sample's file forbids it. */
bool effects_station_forbids(const struct station *station, enum effect_id id);
bool effects_sample_forbids(const struct sample *sample, enum effect_id id);

#endif
