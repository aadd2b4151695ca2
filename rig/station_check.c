/* What a station file is refused for beyond its single keys. */
#include "rig/station_check.h"

#include "rig/camera_format.h"
#include "rig/camera_v4l2.h"
#include "rig/display_choice.h"
#include "rig/virtual/settings_check.h"

static int check_levels(const char *path, const struct station_camera *camera,
                        struct nacre_error *error)
{
    int full_scale = (1 << camera->bits) - 1;
    if (camera->pedestal >= full_scale) {
        return nacre_fail(error, "%s: camera.pedestal: %g leaves no range below saturation at %d",
                          path, camera->pedestal, full_scale);
    }
    return NACRE_OK;
}

static int check_v4l2(const char *path, const struct station *station, struct nacre_error *error)
{
    const struct station_camera *camera = &station->camera;
    const struct v4l2_settings *own = &camera->v4l2;
    const struct camera_format *formats[CAMERA_FORMATS];
    int frame_width = own->frame_width ? own->frame_width : own->left + camera->width;
    int frame_height = own->frame_height ? own->frame_height : own->top + camera->height;
    if (camera_formats_find((enum bayer)camera->bayer, camera->bits, formats) == 0) {
        return nacre_fail(
            error, "%s: camera.bits: V4L2 has no raw format of %d bits; 8, 10, 12, 14 or 16 are",
            path, camera->bits);
    }
    if (own->left + camera->width > frame_width || own->top + camera->height > frame_height) {
        return nacre_fail(error,
                          "%s:%d: camera.v4l2: %d x %d pixels from (%d, %d) on do not lie in "
                          "frames of %d x %d; correct "
                          "left, top, frame_width or frame_height",
                          path, own->line, camera->width, camera->height, own->left, own->top,
                          frame_width, frame_height);
    }
    if (own->shutter && own->mode == CAMERA_PULSE) {
        return nacre_fail(error,
                          "%s:%d: camera.v4l2: the rows of a rolling shutter do not all expose "
                          "during the trigger's "
                          "pulse; with shutter rolling, mode is edge or free",
                          path, own->line);
    }
    if (station->trigger.driver == TRIGGER_DRIVER_NONE && own->mode != CAMERA_FREE) {
        return nacre_fail(error,
                          "%s:%d: camera.v4l2: in mode %s nothing exposes without a trigger; "
                          "trigger.driver none goes "
                          "with mode free",
                          path, own->line, own->mode == CAMERA_PULSE ? "pulse" : "edge");
    }
    return NACRE_OK;
}

static int check_egl(const char *path, const struct egl_settings *own, struct nacre_error *error)
{
    struct display_mode_wish wish;
    int status = own->mode ? display_mode_parse(own->mode, &wish, error) : NACRE_OK;
    if (status != NACRE_OK) {
        return nacre_fail_within(error, "%s:%d: projector.egl.mode", path, own->line);
    }
    return NACRE_OK;
}

static int check_gpio(const char *path, const struct gpio_settings *own, struct nacre_error *error)
{
    const struct gpio_line_settings *lines[] = {&own->output, &own->index};
    static const char *const names[] = {"output", "index"};
    if (!own->output.line && !own->output.chip) {
        return nacre_fail(
            error,
            "%s:%d: trigger.gpio.output: names no line; give its name as line, or chip and offset",
            path, own->line);
    }
    for (int i = 0; i < 2; i++) {
        if (lines[i]->line && lines[i]->offset != 0) {
            return nacre_fail(error,
                              "%s:%d: trigger.gpio.%s: names its line twice, by name and by "
                              "offset; leave one out",
                              path, own->line, names[i]);
        }
    }
    return NACRE_OK;
}

int station_check(const char *path, const struct station *station, struct nacre_error *error)
{
    int status = check_levels(path, &station->camera, error);
    if (status == NACRE_OK && station->camera.driver == CAMERA_DRIVER_V4L2) {
        status = check_v4l2(path, station, error);
    }
    if (status == NACRE_OK && station->projector.driver == PROJECTOR_DRIVER_EGL) {
        status = check_egl(path, &station->projector.egl, error);
    }
    if (status == NACRE_OK && station->trigger.driver == TRIGGER_DRIVER_GPIO) {
        status = check_gpio(path, &station->trigger.gpio, error);
    }
    if (status == NACRE_OK) {
        status = virtual_settings_check(path, station, error);
    }
    return status;
}
