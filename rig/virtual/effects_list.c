/* Listing the effects of a station, with the lines that call for them. */
#include "rig/virtual/effects_list.h"

#include "rig/virtual/effects.h"
#include "rig/virtual/medium.h"
#include "rig/virtual/wheel.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

/* What is there whether a file calls for it or not, and the light transport. */
enum { FIXED_EFFECTS = 5 };

/* Nanoseconds on one 2 to 3 GHz core (tests/bench/bench_station.c): for each voxel of a lit picture, surface point and
 * neighbour, or raw pixel. */
static const double VOXEL_NS = 230;
static const double POINT_NS = 3;
static const double SPREAD_NS = 0.4;
static const double GATHER_NS = 4;
static const double QUANTISE_NS = 4;
static const double NOISE_NS = 40;
static const double COLOR_NS = 1;
static const double DARK_NS = 0.5;

/* How each effect is simulated, and what the file does not say where it is not. */
static const struct {
    const char *model, *absent;
} descriptions[EFFECTS] = {
    [EFFECT_LATENCY] = {"patterns are on the glass later than the refresh", "no latency_ms"},
    [EFFECT_WHEEL] = {"light of each colour by the overlap of exposure and segments",
                      "no wheel: light is white always"},
    [EFFECT_BLACK_LEVEL] = {"black has white's light over the contrast",
                            "no contrast: black is dark"},
    [EFFECT_PROJECTOR_VIGNETTING] =
        {"light falls off with the square of the distance from the middle",
         "no vignetting of the projector"},
    [EFFECT_LAMP_DRIFT] = {"one factor an exposure, by the station's time", "no drift of the lamp"},
    [EFFECT_LAMP_FLICKER] = {"one factor an exposure, by the station's time",
                             "no flicker of the lamp"},
    [EFFECT_MISALIGNMENT] =
        {"surface points lie where the pixels fall, on the sample and for the camera",
         "no shift_points: pixels are the surface points"},
    [EFFECT_PROJECTOR_DEFOCUS] = {"each pixel is spread over a disc",
                                  "no defocus_points: the projector is sharp"},
    [EFFECT_LOCAL] = {"facets of the surface mirror light towards the camera",
                      "no surface: polished, it mirrors past the camera"},
    [EFFECT_DUST] = {"specks shade light on its way in and out", "no dust"},
    [EFFECT_TILT] = {"in the homography, and in the light that falls on a point",
                     "no tilt_deg: the stage is level"},
    [EFFECT_DISTORTION] = {"in the footprints of the pixels", "no distortion of the lens"},
    [EFFECT_CAMERA_DEFOCUS] = {"in the footprints of the pixels",
                               "no defocus_px: the camera is sharp"},
    [EFFECT_CAMERA_VIGNETTING] = {"in the sensitivity of the pixels",
                                  "no vignetting of the camera"},
    [EFFECT_NONUNIFORMITY] = {"in the sensitivity of the pixels",
                              "no nonuniformity: all pixels are alike"},
    [EFFECT_DEAD_PIXELS] = {"in the sensitivity of the pixels", "no dead_pixels"},
    [EFFECT_DARK_CURRENT] = {"added to the light, with its shot noise", "no dark_per_s"},
    [EFFECT_HOT_PIXELS] = {"those pixels are exposed once more", "no hot_pixels"},
    [EFFECT_SHOT_NOISE] = {"Poisson numbers, normal ones above a mean of 50",
                           "no electrons of the camera"},
    [EFFECT_READ_NOISE] = {"normal numbers", "no read_noise of the camera"},
    [EFFECT_READOUT] = {"frames come later than their exposure's end", "no readout_ms"},
    [EFFECT_DROPPED_FRAMES] = {"frames are counted and do not come", "no dropped_frames"},
    [EFFECT_LATE_FRAMES] = {"exposures begin late", "no late_frames"},
    [EFFECT_STRAY_TRIGGER] = {"exposures begin before their trigger", "no stray of the trigger"},
};

struct list {
    const struct station *station;
    const struct sample *sample;
    const struct plan *plan;
    struct effects planned;
    double points, pixels;
    double frames; /* of a pattern */
    struct effect *effects;
    size_t count;
};

/* What speaks of an effect in the files. */
struct evidence {
    int line;
    bool in_sample;
    double seconds;
};

__attribute__((format(printf, 4, 5))) static void add(struct list *list, const char *name,
                                                      bool simulated, const char *format, ...)
{
    struct effect *effect = &list->effects[list->count++];
    va_list arguments;
    va_start(arguments, format);
    (void)snprintf(effect->name, sizeof effect->name, "%s", name); /* a cut name still helps */
    /* NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): va_start is above */
    (void)vsnprintf(effect->reason, sizeof effect->reason, format, arguments);
    va_end(arguments);
    effect->simulated = simulated;
}

static struct evidence find_projector(const struct list *list, enum effect_id id)
{
    const struct virtual_projector_settings *projector = &list->station->simulated.projector;
    double side = 2 * ceil(0.5 * projector->defocus_points) + 1;
    double pattern_s = list->points * 1e-9 / list->frames;
    switch (id) {
    case EFFECT_LATENCY:
        return (struct evidence){projector->latency_line, false, 0};
    case EFFECT_WHEEL:
        return (struct evidence){projector->wheel.segments_line, false,
                                 list->pixels * COLOR_NS * 1e-9};
    case EFFECT_BLACK_LEVEL:
        return (struct evidence){projector->contrast_line, false, 0};
    case EFFECT_PROJECTOR_VIGNETTING:
        return (struct evidence){projector->vignetting_line, false, pattern_s * POINT_NS};
    case EFFECT_LAMP_DRIFT:
        return (struct evidence){projector->lamp.drift_line, false, 0};
    case EFFECT_LAMP_FLICKER:
        return (struct evidence){projector->lamp.flicker_line, false, 0};
    case EFFECT_MISALIGNMENT:
        return (struct evidence){projector->shift_line, false, 0};
    default:
        return (struct evidence){projector->defocus_line, false,
                                 pattern_s * side * side * SPREAD_NS};
    }
}

static struct evidence find_stage(const struct list *list, enum effect_id id)
{
    const struct sample *sample = list->sample;
    double pattern_s = list->points * 3 * POINT_NS * 1e-9 / list->frames;
    switch (id) {
    case EFFECT_LOCAL:
        return (struct evidence){sample ? sample->surface.line : 0, true, pattern_s};
    case EFFECT_DUST:
        return (struct evidence){sample ? sample->dust.line : 0, true, 2 * pattern_s};
    default:
        return (struct evidence){list->station->simulated.tilt_line, false, 0};
    }
}

static struct evidence find_camera(const struct list *list, enum effect_id id)
{
    const struct virtual_camera_settings *camera = &list->station->simulated.camera;
    const struct station_camera *sensor = &list->station->camera;
    double pixel_s = list->pixels * 1e-9;
    switch (id) {
    case EFFECT_DISTORTION:
        return (struct evidence){camera->distortion_line, false, 0};
    case EFFECT_CAMERA_DEFOCUS:
        return (struct evidence){camera->defocus_line, false,
                                 pixel_s * GATHER_NS * camera->defocus_px / list->frames};
    case EFFECT_CAMERA_VIGNETTING:
        return (struct evidence){camera->vignetting_line, false, 0};
    case EFFECT_NONUNIFORMITY:
        return (struct evidence){camera->nonuniformity_line, false, 0};
    case EFFECT_DEAD_PIXELS:
        return (struct evidence){camera->dead_line, false, 0};
    case EFFECT_DARK_CURRENT:
        return (struct evidence){camera->dark_line, false, pixel_s * DARK_NS};
    case EFFECT_HOT_PIXELS:
        return (struct evidence){camera->hot_line, false, pixel_s * NOISE_NS * camera->hot_pixels};
    case EFFECT_SHOT_NOISE:
        return (struct evidence){sensor->electrons_line, false, pixel_s * NOISE_NS};
    case EFFECT_READ_NOISE:
        return (struct evidence){sensor->read_noise_line, false,
                                 list->planned.simulated[EFFECT_SHOT_NOISE] ? 0
                                                                            : pixel_s * NOISE_NS};
    case EFFECT_READOUT:
        return (struct evidence){camera->readout_line, false, 0};
    case EFFECT_DROPPED_FRAMES:
        return (struct evidence){camera->dropped_line, false, 0};
    case EFFECT_LATE_FRAMES:
        return (struct evidence){camera->late_line, false, 0};
    default:
        return (struct evidence){list->station->simulated.trigger.stray_line, false, 0};
    }
}

/* Whether the wheel has nothing to do as no exposure of the plan cuts a turn. */
static bool exposures_are_whole_turns(const struct list *list)
{
    struct wheel wheel;
    double gains[3];
    wheel_init(&list->station->simulated.projector.wheel, list->station->projector.wheel_hz,
               &wheel);
    for (size_t i = 0; list->plan && i < list->plan->exposure_count; i++) {
        int64_t exposure_ns = llround(list->plan->exposure_turns[i] * wheel.period_ns);
        if (wheel_gains(&wheel, 0, exposure_ns, gains)) {
            return false;
        }
    }
    return list->plan;
}

static void add_effect(struct list *list, enum effect_id id)
{
    struct evidence found = id <= EFFECT_PROJECTOR_DEFOCUS ? find_projector(list, id)
                            : id <= EFFECT_TILT            ? find_stage(list, id)
                                                           : find_camera(list, id);
    struct effect *effect = &list->effects[list->count];
    const char *name = effect_names[id];
    effect->line = found.line;
    effect->in_sample = found.in_sample;
    if (effects_station_forbids(list->station, id)) {
        add(list, name, false, "without forbids it");
        effect->line = list->station->without_line;
        effect->in_sample = false;
    } else if (effects_sample_forbids(list->sample, id)) {
        add(list, name, false, "without forbids it");
        effect->line = list->sample->without_line;
        effect->in_sample = true;
    } else if (!list->planned.simulated[id]) {
        add(list, name, false, "%s", descriptions[id].absent);
        effect->line = 0;
    } else if (id == EFFECT_WHEEL && exposures_are_whole_turns(list)) {
        add(list, name, false, "every exposure is whole turns: all segments pass equally often");
    } else {
        add(list, name, true, "%s", descriptions[id].model);
        effect->seconds = found.seconds;
    }
}

static void add_transport(struct list *list)
{
    const struct virtual_settings *simulated = &list->station->simulated;
    struct effect *effect = &list->effects[list->count];
    effect->line = simulated->sample_line;
    if (list->sample) {
        double voxels = medium_expected_cells(list->sample);
        add(list, "light transport", true, "diffusion on %.0f voxels, once a pattern", voxels);
        effect->seconds = voxels * VOXEL_NS * 1e-9 / list->frames;
    } else {
        add(list, "light transport", false, "no sample: a white board lies on the stage");
    }
}

/* What every camera has. */
static void add_camera(struct list *list)
{
    const struct station_camera *camera = &list->station->camera;
    const struct virtual_camera_settings *lens = &list->station->simulated.camera;
    struct effect *effect = &list->effects[list->count];
    add(list, "off-axis view", true, "homography of %g degrees", lens->elevation_deg);
    effect->line = lens->elevation_line;
    effect->seconds = list->pixels * GATHER_NS * 1e-9 / list->frames;
    effect = &list->effects[list->count];
    if (camera->bayer == BAYER_MONO) {
        add(list, "colour filters", false, "the camera is monochrome");
    } else {
        add(list, "colour filters", true, "%s", bayer_names[camera->bayer]);
        effect->line = lens->response_line;
    }
    effect = &list->effects[list->count];
    add(list, "quantisation and saturation", true, "%d bits", camera->bits);
    effect->seconds = list->pixels * QUANTISE_NS * 1e-9;
}

int effects_list(const struct station *station, const struct sample *sample,
                 const struct plan *plan, struct effect **effects, size_t *count,
                 struct nacre_error *error)
{
    struct list list = {.station = station,
                        .sample = sample,
                        .plan = plan,
                        .points = (double)station->sample.width * station->sample.height,
                        .pixels = (double)station->camera.width * station->camera.height,
                        .frames = plan ? (double)plan->exposure_count : 1};
    effects_plan(station, sample, &list.planned);
    list.effects = calloc(EFFECTS + FIXED_EFFECTS, sizeof *list.effects);
    if (!list.effects) {
        return nacre_fail_memory(error, "the list of effects");
    }
    for (int i = 0; i < EFFECTS; i++) {
        add_effect(&list, (enum effect_id)i);
        if (i == EFFECT_PROJECTOR_DEFOCUS) {
            add_transport(&list);
        } else if (i == EFFECT_TILT) {
            add_camera(&list);
        }
    }
    *effects = list.effects;
    *count = list.count;
    return NACRE_OK;
}
