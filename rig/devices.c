/* From a station file to devices. */
#include "rig/devices.h"

#include "rig/camera_v4l2.h"
#include "rig/projector_egl.h"
#include "rig/trigger_gpio.h"
#include "rig/trigger_none.h"
#include "rig/trigger_usb.h"

#include <math.h>

static int refuse_virtual(const char *what, struct nacre_error *error)
{
    return nacre_fail(error,
                      "%s: the driver virtual works with virtual devices alone; let camera, "
                      "projector and trigger all be "
                      "virtual, or none",
                      what);
}

static struct camera_v4l2_settings v4l2_settings_of(const struct station_camera *camera)
{
    const struct v4l2_settings *own = &camera->v4l2;
    return (struct camera_v4l2_settings){
        .stream = {.device = own->device,
                   .subdevice = own->subdevice,
                   .width = own->frame_width ? own->frame_width : own->left + camera->width,
                   .height = own->frame_height ? own->frame_height : own->top + camera->height,
                   .bayer = (enum bayer)camera->bayer,
                   .bits = camera->bits},
        .region = {own->left, own->top, camera->width, camera->height},
        .mode = (enum camera_mode)own->mode,
        .rolling = own->shutter != 0,
        .gain = own->gain,
        .stamp_delay_ns = llround(own->stamp_delay_ms * 1e6),
        .settle_frames = own->settle_frames};
}

int devices_open_camera(const struct station *station, struct clock *clock, struct camera **camera,
                        struct nacre_error *error)
{
    if (station->camera.driver != CAMERA_DRIVER_V4L2) {
        return refuse_virtual("camera", error);
    }
    struct camera_v4l2_settings settings = v4l2_settings_of(&station->camera);
    return camera_v4l2_new(&settings, clock, camera, error);
}

static struct gpio_place place_of(const struct gpio_line_settings *line)
{
    return (struct gpio_place){.name = line->line,
                               .chip = line->chip,
                               .offset = line->offset,
                               .active_low = line->active_low};
}

int devices_open_projector(const struct station *station, struct clock *clock,
                           struct projector **projector, struct nacre_error *error)
{
    const struct egl_settings *own = &station->projector.egl;
    if (station->projector.driver != PROJECTOR_DRIVER_EGL) {
        *projector = NULL;
        return refuse_virtual("projector", error);
    }
    const struct projector_egl_settings settings = {
        .display = {.device = own->device, .connector = own->connector, .mode = own->mode},
        .region = {own->left, own->top, station->sample.width, station->sample.height},
        .latency_ns = llround(own->latency_ms * 1e6),
        .period_ns = llround(1e9 / station->projector.wheel_hz)};
    return projector_egl_new(&settings, clock, projector, error);
}

/* A wheel that shows no index for three turns, or a second, stands still. */
static int64_t index_limit_ns(double wheel_hz)
{
    double limit_ns = 3e9 / wheel_hz;
    return llround(limit_ns > 1e9 ? limit_ns : 1e9);
}

static int open_usb(struct clock *clock, struct trigger **trigger, struct nacre_error *error)
{
    struct usb_port *port = NULL;
    int status = usb_libusb_port(&trigger_usb_kind, NULL, &port, error);
    return status == NACRE_OK ? trigger_usb_new(port, clock, trigger, error) : status;
}

int devices_open_trigger(const struct station *station, struct clock *clock,
                         struct trigger **trigger, struct nacre_error *error)
{
    const struct gpio_settings *own = &station->trigger.gpio;
    const struct trigger_gpio_settings gpio = {.output = place_of(&own->output),
                                               .index = place_of(&own->index),
                                               .index_delay_ns = llround(own->index_delay_us * 1e3),
                                               .index_limit_ns =
                                                   index_limit_ns(station->projector.wheel_hz),
                                               .jitter_ns = llround(own->jitter_us * 1e3)};
    switch (station->trigger.driver) {
    case TRIGGER_DRIVER_USB:
        return open_usb(clock, trigger, error);
    case TRIGGER_DRIVER_GPIO:
        return trigger_gpio_new(&gpio, clock, trigger, error);
    case TRIGGER_DRIVER_NONE:
        return trigger_none_new(clock, trigger, error);
    default:
        return refuse_virtual("trigger", error);
    }
}

int devices_open(const struct station *station, struct clock *clock, struct devices *devices,
                 struct nacre_error *error)
{
    *devices = (struct devices){.clock = clock};
    int status = devices_open_projector(station, clock, &devices->projector, error);
    if (status == NACRE_OK) {
        status = devices_open_camera(station, clock, &devices->camera, error);
    }
    if (status == NACRE_OK) {
        status = devices_open_trigger(station, clock, &devices->trigger, error);
    }
    if (status != NACRE_OK) {
        devices_close(devices);
    }
    return status;
}

void devices_close(struct devices *devices)
{
    if (devices->trigger) {
        devices->trigger->ops->close(devices->trigger);
    }
    if (devices->camera) {
        devices->camera->ops->close(devices->camera);
    }
    if (devices->projector) {
        devices->projector->ops->close(devices->projector);
    }
    *devices = (struct devices){0};
}
