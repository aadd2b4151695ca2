/* The virtual station: its devices behind the seams and the light between them. */
#include "rig/virtual/virtual.h"

#include "rig/virtual/optics.h"
#include "rig/virtual/sample.h"
#include "rig/virtual/sensor.h"
#include "rig/virtual/transport.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

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
    struct station settings; /* numbers only: its strings belong to the caller and are not used */
    struct transport *transport; /* NULL: the board under the layer is as white as the layer */
    struct optics optics;
    bool white_layer;
    bool lit;          /* `signal` is what the camera sees of `irradiance` */
    float *irradiance; /* [3][height][width] of the surface points */
    float *radiosity;  /* the same */
    float *signal;     /* [height][width] of raw pixels, raw units a second */
    uint16_t *raw;     /* the last frame */
    uint64_t key;      /* of the pattern, for the noise */
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
    (void)error; /* this projector cannot fail */
    optics_project(&station->settings, levels, station->irradiance);
    station->lit = false;
    *flip_ns = refresh_ns + milliseconds(station->settings.simulated.projector.latency_ms);
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
    return NACRE_OK;
}

/* What the diffuse layer, or the board that lies on the stage where there is no sample, sends out. */
static void reflect(struct virtual_station *station)
{
    size_t plane = (size_t)station->settings.sample.width * (size_t)station->settings.sample.height;
    for (size_t i = 0; i < 3 * plane; i++) {
        station->radiosity[i] =
            (float)station->settings.white_reflectance[i / plane] * station->irradiance[i];
    }
}

/* From what the projector shows to what each pixel gathers in a second. */
static int light(struct virtual_station *station, struct nacre_error *error)
{
    int status = NACRE_OK;
    if (station->white_layer || !station->transport) {
        reflect(station);
    } else {
        status =
            transport_apply(station->transport, station->irradiance, station->radiosity, error);
    }
    if (status == NACRE_OK) {
        optics_apply(&station->optics, station->radiosity, station->signal);
        station->lit = true;
    }
    return status;
}

static int camera_take(struct camera *camera, int64_t timeout_ns, struct camera_frame *frame,
                       struct nacre_error *error)
{
    struct virtual_station *station = ((struct virtual_camera *)camera)->station;
    int64_t readout_ns = milliseconds(station->settings.simulated.camera.readout_ms);
    int64_t ready_ns = station->trigger_ns + station->exposure_ns + readout_ns;
    if (!station->triggered || ready_ns > station->clock.time_ns + timeout_ns) {
        clock_advance(&station->clock.base, station->clock.time_ns + timeout_ns);
        return nacre_fail(error, "camera virtual: no frame within %" PRId64 " ms",
                          timeout_ns / 1000000);
    }
    if (!station->lit) {
        int status = light(station, error);
        if (status != NACRE_OK) {
            return status;
        }
    }
    sensor_expose(&station->settings.camera, station->signal, (double)station->exposure_ns * 1e-9,
                  sensor_key(station->key, (uint64_t)station->exposure_ns),
                  (size_t)camera->width * (size_t)camera->height, station->raw);
    clock_advance(&station->clock.base, ready_ns);
    station->armed = false;
    station->triggered = false;
    *frame = (struct camera_frame){
        .raw = station->raw, .frame_ns = station->trigger_ns, .sequence = station->sequence++};
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
    static const struct projector_ops projector_ops = {"virtual", projector_show, projector_close};
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

static int put_sample(const struct station *settings, struct transport **transport,
                      struct nacre_error *error)
{
    const char *path = settings->simulated.sample;
    struct sample sample = {0};
    int status = sample_read(path, &sample, error);
    if (status != NACRE_OK) {
        goto out;
    }
    if (sample.width != settings->sample.width || sample.height != settings->sample.height ||
        fabs(sample.pitch_mm - settings->sample.pitch_mm) > 1e-9 * sample.pitch_mm) {
        status =
            nacre_fail(error,
                       "%s: has %d x %d surface points of %g mm where the station file has %d x "
                       "%d of %g mm; make them the same",
                       path, sample.width, sample.height, sample.pitch_mm, settings->sample.width,
                       settings->sample.height, settings->sample.pitch_mm);
        goto out;
    }
    status = transport_new(&sample, transport, error);
out:
    sample_finish(&sample);
    return status;
}

static int allocate(struct virtual_station *station, struct nacre_error *error)
{
    const struct station *settings = &station->settings;
    size_t points = (size_t)settings->sample.width * (size_t)settings->sample.height;
    size_t pixels = (size_t)settings->camera.width * (size_t)settings->camera.height;
    station->irradiance = calloc(3 * points, sizeof *station->irradiance);
    station->radiosity = calloc(3 * points, sizeof *station->radiosity);
    station->signal = calloc(pixels, sizeof *station->signal);
    station->raw = calloc(pixels, sizeof *station->raw);
    if (!station->irradiance || !station->radiosity || !station->signal || !station->raw) {
        return nacre_fail_memory(error, "the virtual station");
    }
    return optics_init(settings, &station->optics, error);
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
    made->settings.plan = NULL;
    made->settings.simulated.sample = NULL;
    made->key = (uint64_t)station->simulated.seed;
    connect(made);
    status = allocate(made, error);
    if (status != NACRE_OK) {
        goto out;
    }
    if (station->simulated.sample) {
        status = put_sample(station, &made->transport, error);
    }
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

void virtual_station_set_white_layer(struct virtual_station *simulated, int on)
{
    simulated->white_layer = on != 0;
    simulated->lit = false;
}

void virtual_station_begin_pattern(struct virtual_station *simulated, struct pattern pattern)
{
    uint64_t seed = (uint64_t)simulated->settings.simulated.seed;
    simulated->key = sensor_key(sensor_key(seed, (uint64_t)pattern.kind), (uint64_t)pattern.number);
}

void virtual_station_free(struct virtual_station *simulated)
{
    if (!simulated) {
        return;
    }
    transport_free(simulated->transport);
    optics_finish(&simulated->optics);
    free(simulated->irradiance);
    free(simulated->radiosity);
    free(simulated->signal);
    free(simulated->raw);
    free(simulated);
}
