/* Projection, sample, lens and sensor one after the other; passes exist for the effects that are simulated. */
#include "rig/virtual/light.h"

#include "rig/virtual/lamp.h"
#include "rig/virtual/optics.h"
#include "rig/virtual/pixels.h"
#include "rig/virtual/projection.h"
#include "rig/virtual/sample.h"
#include "rig/virtual/sensor.h"
#include "rig/virtual/surface.h"
#include "rig/virtual/transport.h"
#include "rig/virtual/wheel.h"

#include <math.h>
#include <stdlib.h>

struct light {
    struct station settings; /* numbers only: what it has on the heap belongs to the caller */
    struct effects effects;
    struct projection projection;
    struct wheel wheel;
    struct transport *transport; /* NULL: the board on the stage is as white as the layer */
    struct surface surface;      /* of the sample */
    struct optics optics;
    struct hot_pixels hot;
    bool white_layer;
    bool seen; /* `signal` is what the camera sees of `irradiance` */
    size_t points, pixels;
    float *irradiance; /* [3][height][width] of the surface points, from the projector */
    float *entering;   /* the same where dust shades it; NULL without dust */
    float *radiosity;  /* [3][height][width] */
    float *signal;     /* [height][width] of raw pixels, raw units a second of white light */
    float *colored;    /* the same of the light that the wheel lets through; NULL without a wheel */
};

const struct effects *light_effects(const struct light *light)
{
    return &light->effects;
}

void light_show(struct light *light, const uint8_t *levels)
{
    projection_draw(&light->projection, &light->effects, levels, light->irradiance);
    light->seen = false;
}

void light_lay_white_layer(struct light *light, bool on)
{
    light->white_layer = on;
    light->seen = false;
}

/* What the diffuse layer, or the board that lies on the stage where there is no sample, sends out. */
static void reflect(struct light *light)
{
    for (size_t i = 0; i < 3 * light->points; i++) {
        light->radiosity[i] =
            (float)light->settings.white_reflectance[i / light->points] * light->irradiance[i];
    }
}

/* planes[3][points] times a map over the points, into out. */
static void shade(const float *planes, const float *map, size_t points, float *out)
{
    for (size_t c = 0; c < 3; c++) {
        for (size_t i = 0; i < points; i++) {
            out[c * points + i] = planes[c * points + i] * map[i];
        }
    }
}

static void add_local(const struct light *light, const float *entering)
{
    size_t points = light->points;
    for (size_t c = 0; c < 3; c++) {
        for (size_t i = 0; i < points; i++) {
            light->radiosity[c * points + i] += entering[c * points + i] * light->surface.local[i];
        }
    }
}

/* What the sample sends out. Dust lies on top of it and blocks light on its way in and on its way out. */
static int pass_sample(struct light *light, struct nacre_error *error)
{
    struct effects *effects = &light->effects;
    const float *entering = light->irradiance;
    if (effects_has(effects, EFFECT_DUST)) {
        shade(light->irradiance, light->surface.clear, light->points, light->entering);
        entering = light->entering;
    }
    int status = transport_apply(light->transport, entering, light->radiosity, error);
    if (status != NACRE_OK) {
        return status;
    }
    if (effects_has(effects, EFFECT_LOCAL)) {
        add_local(light, entering);
        effects->work[EFFECT_LOCAL] += light->points;
    }
    if (effects_has(effects, EFFECT_DUST)) {
        shade(light->radiosity, light->surface.clear, light->points, light->radiosity);
        effects->work[EFFECT_DUST] += light->points;
    }
    return NACRE_OK;
}

/* From what the projector shows to what each pixel gathers in a second. */
static int see(struct light *light, struct nacre_error *error)
{
    int status = NACRE_OK;
    if (light->white_layer || !light->transport) {
        reflect(light);
    } else {
        status = pass_sample(light, error);
    }
    if (status == NACRE_OK) {
        optics_apply(&light->optics, light->radiosity, light->signal);
        light->seen = true;
    }
    return status;
}

/* The signal of the light that the wheel lets through during the exposure. */
static const float *color(struct light *light, const struct light_exposure *exposure)
{
    const struct station_camera *camera = &light->settings.camera;
    double gains[3];
    if (!wheel_gains(&light->wheel, exposure->begin_ns, exposure->exposure_ns, gains)) {
        return light->signal;
    }
    for (int y = 0; y < camera->height; y++) {
        size_t row = (size_t)y * (size_t)camera->width;
        float pair[2] = {(float)gains[bayer_channel((enum bayer)camera->bayer, 0, y)],
                         (float)gains[bayer_channel((enum bayer)camera->bayer, 1, y)]};
        for (size_t x = 0; x < (size_t)camera->width; x++) {
            light->colored[row + x] = light->signal[row + x] * pair[x & 1];
        }
    }
    light->effects.work[EFFECT_WHEEL] += light->pixels;
    return light->colored;
}

/* The lamp's brightness during the exposure. */
static double brightness(struct light *light, const struct light_exposure *exposure)
{
    const struct virtual_settings *settings = &light->settings.simulated;
    int64_t end_ns = exposure->begin_ns + exposure->exposure_ns;
    double sum = 1;
    if (effects_has(&light->effects, EFFECT_LAMP_DRIFT)) {
        sum += lamp_drift(&settings->projector.lamp, settings->seed, exposure->begin_ns, end_ns);
        light->effects.work[EFFECT_LAMP_DRIFT]++;
    }
    if (effects_has(&light->effects, EFFECT_LAMP_FLICKER)) {
        sum += lamp_flicker(&settings->projector.lamp, settings->seed, exposure->begin_ns, end_ns);
        light->effects.work[EFFECT_LAMP_FLICKER]++;
    }
    return fmax(sum, 0);
}

static void heat(struct light *light, const struct sensor_exposure *sensor, double seconds,
                 uint16_t *raw)
{
    for (size_t i = 0; i < light->hot.count; i++) {
        struct sensor_exposure hot = *sensor;
        hot.dark += (double)light->hot.per_s[i] * seconds;
        sensor_expose_one(&hot, light->hot.pixels[i], raw);
    }
    light->effects.work[EFFECT_HOT_PIXELS] += light->hot.count;
}

static void count(struct light *light, enum effect_id id)
{
    if (effects_has(&light->effects, id)) {
        light->effects.work[id] += light->pixels;
    }
}

int light_expose(struct light *light, const struct light_exposure *exposure, uint16_t *raw,
                 struct nacre_error *error)
{
    double seconds = (double)exposure->exposure_ns * 1e-9;
    int status = light->seen ? NACRE_OK : see(light, error);
    if (status != NACRE_OK) {
        return status;
    }
    struct sensor_exposure sensor = {.camera = &light->settings.camera,
                                     .signal = light->signal,
                                     .seconds = seconds,
                                     .key = exposure->key};
    if (effects_has(&light->effects, EFFECT_WHEEL)) {
        sensor.signal = color(light, exposure);
    }
    if (effects_has(&light->effects, EFFECT_LAMP_DRIFT) ||
        effects_has(&light->effects, EFFECT_LAMP_FLICKER)) {
        sensor.seconds *= brightness(light, exposure);
    }
    if (effects_has(&light->effects, EFFECT_DARK_CURRENT)) {
        sensor.dark = light->settings.simulated.camera.dark_per_s * seconds;
    }
    sensor_expose(&sensor, light->pixels, raw);
    if (effects_has(&light->effects, EFFECT_HOT_PIXELS)) {
        heat(light, &sensor, seconds, raw);
    }
    count(light, EFFECT_DARK_CURRENT);
    count(light, EFFECT_SHOT_NOISE);
    count(light, EFFECT_READ_NOISE);
    return NACRE_OK;
}

static int check_sample(const struct station *settings, const struct sample *sample,
                        struct nacre_error *error)
{
    if (sample->width != settings->sample.width || sample->height != settings->sample.height ||
        fabs(sample->pitch_mm - settings->sample.pitch_mm) > 1e-9 * sample->pitch_mm) {
        return nacre_fail(error,
                          "%s: has %d x %d surface points of %g mm where the station file has %d x "
                          "%d of %g mm; make them the same",
                          settings->simulated.sample, sample->width, sample->height,
                          sample->pitch_mm, settings->sample.width, settings->sample.height,
                          settings->sample.pitch_mm);
    }
    return NACRE_OK;
}

/* Read the sample and all that depends on it; it is not kept. */
static int put_sample(const struct station *station, struct light *light, struct nacre_error *error)
{
    struct sample sample = {0};
    int status = sample_read(station->simulated.sample, &sample, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = check_sample(station, &sample, error);
    if (status != NACRE_OK) {
        goto out;
    }
    effects_plan(station, &sample, &light->effects);
    for (int i = 0; i < 2 && effects_has(&light->effects, EFFECT_MISALIGNMENT); i++) {
        sample.corner_mm[i] = station->simulated.projector.shift_points[i] * sample.pitch_mm;
    }
    status = transport_new(&sample, &light->transport, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = surface_init(station, &sample, &light->effects, &light->surface, error);
out:
    sample_finish(&sample);
    return status;
}

static int allocate(struct light *light, struct nacre_error *error)
{
    bool dusty = effects_has(&light->effects, EFFECT_DUST);
    bool colored = effects_has(&light->effects, EFFECT_WHEEL);
    light->irradiance = calloc(3 * light->points, sizeof *light->irradiance);
    light->entering = dusty ? calloc(3 * light->points, sizeof *light->entering) : NULL;
    light->radiosity = calloc(3 * light->points, sizeof *light->radiosity);
    light->signal = calloc(light->pixels, sizeof *light->signal);
    light->colored = colored ? calloc(light->pixels, sizeof *light->colored) : NULL;
    if (!light->irradiance || (dusty && !light->entering) || !light->radiosity || !light->signal ||
        (colored && !light->colored)) {
        return nacre_fail_memory(error, "the virtual station");
    }
    return NACRE_OK;
}

/* What the effects of projector and camera need. */
static int prepare(const struct station *station, struct light *light, struct nacre_error *error)
{
    int status = projection_init(station, &light->effects, &light->projection, error);
    if (status == NACRE_OK) {
        status = optics_init(station, &light->effects, &light->optics, error);
    }
    if (status == NACRE_OK && effects_has(&light->effects, EFFECT_HOT_PIXELS)) {
        status = hot_pixels_init(&station->simulated, light->pixels, &light->hot, error);
    }
    if (effects_has(&light->effects, EFFECT_WHEEL)) {
        wheel_init(&station->simulated.projector.wheel, station->projector.wheel_hz, &light->wheel);
    }
    return status;
}

/* The sensor reads off its settings what noise it has. */
static void silence(struct light *light)
{
    struct station_camera *camera = &light->settings.camera;
    if (!effects_has(&light->effects, EFFECT_SHOT_NOISE)) {
        camera->electrons = 0;
    }
    if (!effects_has(&light->effects, EFFECT_READ_NOISE)) {
        camera->read_noise = 0;
    }
}

int light_new(const struct station *station, struct light **light, struct nacre_error *error)
{
    int status = NACRE_OK;
    struct light *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "the virtual station");
        goto out;
    }
    made->settings = *station;
    made->points = (size_t)station->sample.width * (size_t)station->sample.height;
    made->pixels = (size_t)station->camera.width * (size_t)station->camera.height;
    if (station->simulated.sample) {
        status = put_sample(station, made, error);
    } else {
        effects_plan(station, NULL, &made->effects);
    }
    if (status != NACRE_OK) {
        goto out;
    }
    silence(made);
    status = allocate(made, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = prepare(station, made, error);
out:
    if (status != NACRE_OK) {
        light_free(made);
        made = NULL;
    }
    *light = made;
    return status;
}

void light_free(struct light *light)
{
    if (!light) {
        return;
    }
    projection_finish(&light->projection);
    transport_free(light->transport);
    surface_finish(&light->surface);
    optics_finish(&light->optics);
    hot_pixels_finish(&light->hot);
    free(light->irradiance);
    free(light->entering);
    free(light->radiosity);
    free(light->signal);
    free(light->colored);
    free(light);
}
