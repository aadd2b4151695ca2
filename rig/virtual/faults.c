/* Drawing what goes wrong with a frame: each kind by a number of its own, so that none changes the others' frames. */
#include "rig/virtual/faults.h"

#include "rig/virtual/sensor.h"

static bool happens(uint64_t key, enum frame_fault fault, double rate)
{
    return (double)(sensor_key(key, (uint64_t)fault) >> 11) * 0x1p-53 < rate;
}

enum frame_fault faults_draw(const struct effects *effects, const struct virtual_settings *settings,
                             uint64_t key)
{
    if (effects_has(effects, EFFECT_DROPPED_FRAMES) &&
        happens(key, FRAME_DROPPED, settings->camera.dropped_frames)) {
        return FRAME_DROPPED;
    }
    if (effects_has(effects, EFFECT_LATE_FRAMES) &&
        happens(key, FRAME_LATE, settings->camera.late_frames)) {
        return FRAME_LATE;
    }
    if (effects_has(effects, EFFECT_STRAY_TRIGGER) &&
        happens(key, FRAME_STRAY, settings->trigger.stray)) {
        return FRAME_STRAY;
    }
    return FRAME_SOUND;
}
