/* The plan of effects: what the station and sample files call for and do not forbid. */
#include "rig/virtual/effects.h"

#include "rig/station.h"
#include "rig/virtual/sample.h"

#include <string.h>

static bool called_for(const struct station *station, const struct sample *sample,
                       enum effect_id id)
{
    const struct virtual_settings *all = &station->simulated;
    const struct virtual_projector_settings *projector = &all->projector;
    const struct virtual_camera_settings *camera = &all->camera;
    switch (id) {
    case EFFECT_LATENCY:
        return projector->latency_ms > 0;
    case EFFECT_WHEEL:
        return projector->wheel.segment_count > 0;
    case EFFECT_BLACK_LEVEL:
        return projector->contrast > 1;
    case EFFECT_PROJECTOR_VIGNETTING:
        return projector->vignetting > 0;
    case EFFECT_LAMP_DRIFT:
        return projector->lamp.drift > 0;
    case EFFECT_LAMP_FLICKER:
        return projector->lamp.flicker > 0;
    case EFFECT_MISALIGNMENT:
        return projector->shift_points[0] != 0 || projector->shift_points[1] != 0;
    case EFFECT_PROJECTOR_DEFOCUS:
        return projector->defocus_points > 0;
    case EFFECT_LOCAL:
        return sample && sample->surface.roughness > 0;
    case EFFECT_DUST:
        return sample && sample->dust.per_cm2 > 0;
    case EFFECT_TILT:
        return all->tilt_deg[0] != 0 || all->tilt_deg[1] != 0;
    case EFFECT_DISTORTION:
        return camera->distortion[0] != 0 || camera->distortion[1] != 0;
    case EFFECT_CAMERA_DEFOCUS:
        return camera->defocus_px > 0;
    case EFFECT_CAMERA_VIGNETTING:
        return camera->vignetting > 0;
    case EFFECT_NONUNIFORMITY:
        return camera->nonuniformity > 0;
    case EFFECT_DEAD_PIXELS:
        return camera->dead_pixels > 0;
    case EFFECT_DARK_CURRENT:
        return camera->dark_per_s > 0;
    case EFFECT_HOT_PIXELS:
        return camera->hot_pixels > 0 && camera->hot_per_s > 0;
    case EFFECT_SHOT_NOISE:
        return station->camera.electrons > 0;
    case EFFECT_READ_NOISE:
        return station->camera.read_noise > 0;
    case EFFECT_READOUT:
        return camera->readout_ms > 0;
    case EFFECT_DROPPED_FRAMES:
        return camera->dropped_frames > 0;
    case EFFECT_LATE_FRAMES:
        return camera->late_frames > 0;
    case EFFECT_STRAY_TRIGGER:
        return all->trigger.stray > 0;
    case EFFECTS:
        break;
    }
    return false;
}

bool effects_station_forbids(const struct station *station, enum effect_id id)
{
    for (size_t i = 0; i < station->without_count; i++) {
        if (strcmp(station->without[i], effect_names[id]) == 0) {
            return true;
        }
    }
    return false;
}

bool effects_sample_forbids(const struct sample *sample, enum effect_id id)
{
    return sample && sample_forbids(sample, effect_names[id]);
}

void effects_plan(const struct station *station, const struct sample *sample,
                  struct effects *effects)
{
    *effects = (struct effects){0};
    for (int i = 0; i < EFFECTS; i++) {
        enum effect_id id = (enum effect_id)i;
        effects->simulated[i] = called_for(station, sample, id) &&
                                !effects_station_forbids(station, id) &&
                                !effects_sample_forbids(sample, id);
    }
}
