/* The virtual station: its devices behind the seams, and the time that passes in them. */
#include "rig/virtual/virtual.h"

#include "rig/virtual/faults.h"
#include "rig/virtual/light.h"
#include "rig/virtual/sensor.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A stray pulse comes at least that long before the trigger's. */
static const int64_t STRAY_NS = 10000000;

struct virtual_camera {
    struct camera base;
    struct virtual_station *station;
};

struct virtual_projector {
    struct projector base;
    struct virtual_station *station;
};

struct virtual_trigger {
    struct trigger base;
    struct virtual_station *station;
};

struct virtual_clock {
    struct clock base;
    int64_t time_ns;
};

struct virtual_station {
    struct virtual_camera camera;
    struct virtual_projector projector;
    struct virtual_trigger trigger;
    struct virtual_clock clock;
    struct station settings; /* numbers only: what it has on the heap belongs to the caller */
    struct light *light;
    uint16_t *raw; /* the last frame */
    bool tells_refreshes;
    int64_t change_ns;  /* when the pattern that is shown was on the glass; told refreshes only */
    uint8_t *levels[2]; /* the pattern before and the one shown; told refreshes only */
    uint16_t *before;   /* a frame of the former */
    uint64_t key;       /* of the pattern, for the noise */
    uint64_t tries;     /* to expose it */
    int64_t exposure_ns, trigger_ns;
    bool armed, triggered;
    uint32_t sequence;
};

static int64_t clock_read(struct clock *clock)
{
    return ((struct virtual_clock *)clock)->time_ns;
}

static void clock_advance(struct clock *clock, int64_t time_ns)
{
    struct virtual_clock *own = (struct virtual_clock *)clock;
    own->time_ns = time_ns > own->time_ns ? time_ns : own->time_ns;
}

static int64_t milliseconds(double ms)
{
    return llround(ms * 1e6);
}

/* A pattern is taken at the next refresh. */
static int projector_show(struct projector *projector, const uint8_t *levels, int64_t *flip_ns,
                          struct nacre_error *error)
{
    struct virtual_station *station = ((struct virtual_projector *)projector)->station;
    int64_t period_ns = projector->period_ns;
    int64_t refresh_ns = (station->clock.time_ns + period_ns - 1) / period_ns * period_ns;
    int64_t latency_ns = effects_has(light_effects(station->light), EFFECT_LATENCY)
                             ? milliseconds(station->settings.simulated.projector.latency_ms)
                             : 0;
    (void)error; /* this projector cannot fail */
    light_show(station->light, levels);
    if (station->tells_refreshes) {
        size_t points = (size_t)projector->width * (size_t)projector->height;
        memcpy(station->levels[0], station->levels[1], points);
        memcpy(station->levels[1], levels, points);
        station->change_ns = refresh_ns + latency_ns;
    }
    *flip_ns = station->tells_refreshes ? refresh_ns : refresh_ns + latency_ns;
    clock_advance(&station->clock.base, *flip_ns);
    return NACRE_OK;
}

static int trigger_fire(struct trigger *trigger, int64_t exposure_ns, int64_t *trigger_ns,
                        struct nacre_error *error)
{
    struct virtual_station *station = ((struct virtual_trigger *)trigger)->station;
    (void)exposure_ns; /* the camera times its exposure itself */
    (void)error;       /* this trigger cannot fail */
    *trigger_ns = station->clock.time_ns;
    station->trigger_ns = *trigger_ns;
    station->triggered = station->armed;
    return NACRE_OK;
}

static int camera_arm(struct camera *camera, int64_t exposure_ns, struct nacre_error *error)
{
    struct virtual_station *station = ((struct virtual_camera *)camera)->station;
    if (exposure_ns <= 0) {
        return nacre_fail(error, "camera virtual: cannot expose for %" PRId64 " ns", exposure_ns);
    }
    station->exposure_ns = exposure_ns;
    station->armed = true;
    station->triggered = false;
    station->tries++;
    return NACRE_OK;
}

/* What happens to the frame that was triggered. */
static enum frame_fault draw_fault(const struct virtual_station *station)
{
    uint64_t key = sensor_key(station->key, (uint64_t)station->exposure_ns);
    return faults_draw(light_effects(station->light), &station->settings.simulated,
                       sensor_key(key, station->tries));
}

/* When the exposure of a faulty frame begins. */
static int64_t begin_of(const struct virtual_station *station, enum frame_fault fault)
{
    if (fault == FRAME_LATE) {
        return station->trigger_ns + milliseconds(station->settings.simulated.camera.late_ms);
    }
    if (fault == FRAME_STRAY) {
        int64_t half_ns = station->exposure_ns / 2;
        return station->trigger_ns - (half_ns > STRAY_NS ? half_ns : STRAY_NS);
    }
    return station->trigger_ns;
}

/* When an exposure has been read out. */
static int64_t ready_of(const struct virtual_station *station, int64_t begin_ns,
                        int64_t exposure_ns)
{
    bool reads_out = effects_has(light_effects(station->light), EFFECT_READOUT);
    return begin_ns + exposure_ns +
           (reads_out ? milliseconds(station->settings.simulated.camera.readout_ms) : 0);
}

static int fail_without_frame(struct virtual_station *station, int64_t timeout_ns,
                              struct nacre_error *error)
{
    clock_advance(&station->clock.base, station->clock.time_ns + timeout_ns);
    return nacre_fail(error, "camera virtual: no frame within %" PRId64 " ms",
                      timeout_ns / 1000000);
}

/* A frame in which the pattern before gives way to the one that is shown now. */
static int expose_change(struct virtual_station *station, const struct light_exposure *exposure,
                         struct nacre_error *error)
{
    const struct camera *camera = &station->camera.base;
    size_t pixels = (size_t)camera->width * (size_t)camera->height;
    double before =
        (double)(station->change_ns - exposure->begin_ns) / (double)exposure->exposure_ns;
    before = before < 1 ? before : 1;
    light_show(station->light, station->levels[0]);
    int status = light_expose(station->light, exposure, station->raw, error);
    for (size_t i = 0; i < pixels; i++) {
        station->before[i] = station->raw[i];
    }
    light_show(station->light, station->levels[1]);
    if (status == NACRE_OK) {
        status = light_expose(station->light, exposure, station->raw, error);
    }
    for (size_t i = 0; i < pixels; i++) {
        station->raw[i] =
            (uint16_t)lround(before * station->before[i] + (1 - before) * station->raw[i]);
    }
    return status;
}

static int camera_take(struct camera *camera, int64_t timeout_ns, struct camera_frame *frame,
                       struct nacre_error *error)
{
    struct virtual_station *station = ((struct virtual_camera *)camera)->station;
    enum frame_fault fault = draw_fault(station);
    struct light_exposure exposure = {.begin_ns = begin_of(station, fault),
                                      .exposure_ns = station->exposure_ns,
                                      .key =
                                          sensor_key(station->key, (uint64_t)station->exposure_ns)};
    int64_t ready_ns = ready_of(station, exposure.begin_ns, exposure.exposure_ns);
    if (!station->triggered || ready_ns > station->clock.time_ns + timeout_ns) {
        return fail_without_frame(station, timeout_ns, error);
    }
    station->armed = false;
    station->triggered = false;
    station->sequence++;
    if (fault == FRAME_DROPPED) {
        return fail_without_frame(station, timeout_ns, error);
    }
    int status = station->tells_refreshes && exposure.begin_ns < station->change_ns
                     ? expose_change(station, &exposure, error)
                     : light_expose(station->light, &exposure, station->raw, error);
    if (status != NACRE_OK) {
        return status;
    }
    clock_advance(&station->clock.base, ready_ns);
    *frame = (struct camera_frame){
        .raw = station->raw, .frame_ns = exposure.begin_ns, .sequence = station->sequence - 1};
    return NACRE_OK;
}

/* The devices belong to the station, which frees them. */
static void projector_close(struct projector *projector)
{
    (void)projector;
}

static void trigger_close(struct trigger *trigger)
{
    (void)trigger;
}

static void camera_close(struct camera *camera)
{
    (void)camera;
}

static void connect(struct virtual_station *station)
{
    static const struct camera_ops camera_ops = {"virtual", camera_arm, camera_take, camera_close};
    static const struct projector_ops projector_ops = {
        .name = "virtual", .show = projector_show, .close = projector_close};
    static const struct trigger_ops trigger_ops = {"virtual", trigger_fire, trigger_close};
    static const struct clock_ops clock_ops = {"virtual", clock_read, clock_advance};
    const struct station *settings = &station->settings;
    station->camera = (struct virtual_camera){.base = {.ops = &camera_ops,
                                                       .width = settings->camera.width,
                                                       .height = settings->camera.height,
                                                       .bits = settings->camera.bits,
                                                       .bayer = (enum bayer)settings->camera.bayer},
                                              .station = station};
    station->projector = (struct virtual_projector){
        .base = {.ops = &projector_ops,
                 .width = settings->sample.width,
                 .height = settings->sample.height,
                 .period_ns = llround(1e9 / settings->projector.wheel_hz)},
        .station = station};
    station->trigger = (struct virtual_trigger){.base = {.ops = &trigger_ops}, .station = station};
    station->clock = (struct virtual_clock){.base = {.ops = &clock_ops}};
}

int virtual_station_new(const struct station *station, struct virtual_station **simulated,
                        struct nacre_error *error)
{
    int status = NACRE_OK;
    struct virtual_station *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "the virtual station");
        goto out;
    }
    made->settings = *station;
    made->key = (uint64_t)station->simulated.seed;
    connect(made);
    made->raw =
        calloc((size_t)station->camera.width * (size_t)station->camera.height, sizeof *made->raw);
    if (!made->raw) {
        status = nacre_fail_memory(error, "the virtual station");
        goto out;
    }
    status = light_new(station, &made->light, error);
out:
    if (status != NACRE_OK) {
        virtual_station_free(made);
        made = NULL;
    }
    *simulated = made;
    return status;
}

struct camera *virtual_station_camera(struct virtual_station *simulated)
{
    return &simulated->camera.base;
}

struct projector *virtual_station_projector(struct virtual_station *simulated)
{
    return &simulated->projector.base;
}

struct trigger *virtual_station_trigger(struct virtual_station *simulated)
{
    return &simulated->trigger.base;
}

struct clock *virtual_station_clock(struct virtual_station *simulated)
{
    return &simulated->clock.base;
}

const struct effects *virtual_station_effects(const struct virtual_station *simulated)
{
    return light_effects(simulated->light);
}

void virtual_station_set_white_layer(struct virtual_station *simulated, int on)
{
    light_lay_white_layer(simulated->light, on != 0);
}

void virtual_station_begin_pattern(struct virtual_station *simulated, struct pattern pattern)
{
    uint64_t seed = (uint64_t)simulated->settings.simulated.seed;
    simulated->key = sensor_key(sensor_key(seed, (uint64_t)pattern.kind), (uint64_t)pattern.number);
    simulated->tries = 0;
}

void virtual_station_go_on(struct virtual_station *simulated, const struct pattern_frames *before)
{
    const struct exposure *last = &before->exposures[before->count - 1];
    clock_advance(&simulated->clock.base, last->trigger_ns);
    clock_advance(&simulated->clock.base, ready_of(simulated, last->frame_ns, last->exposure_ns));
    simulated->sequence = last->sequence + 1;
}

int virtual_station_tell_refreshes(struct virtual_station *simulated, struct nacre_error *error)
{
    const struct projector *projector = &simulated->projector.base;
    const struct camera *camera = &simulated->camera.base;
    size_t points = (size_t)projector->width * (size_t)projector->height;
    size_t pixels = (size_t)camera->width * (size_t)camera->height;
    simulated->levels[0] = calloc(points, 1);
    simulated->levels[1] = calloc(points, 1);
    simulated->before = calloc(pixels, sizeof *simulated->before);
    if (!simulated->levels[0] || !simulated->levels[1] || !simulated->before) {
        return nacre_fail_memory(error, "the virtual station");
    }
    simulated->tells_refreshes = true;
    return NACRE_OK;
}

void virtual_station_free(struct virtual_station *simulated)
{
    if (!simulated) {
        return;
    }
    light_free(simulated->light);
    free(simulated->levels[0]);
    free(simulated->levels[1]);
    free(simulated->before);
    free(simulated->raw);
    free(simulated);
}
