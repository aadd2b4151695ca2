/* Exposure time and gain of a camera. */
#include "rig/camera_exposure.h"

#include <errno.h>
#include <inttypes.h>
#include <linux/v4l2-controls.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>

/* Sensors want a few rows between an exposure's end and the next frame. */
enum { SPARE_ROWS = 8 };

static bool has(struct camera_controls *controls, uint32_t id, struct camera_control_range *range)
{
    return controls->ops->query(controls, id, range) == 0;
}

/* Automatic exposure, gain and white balance make frames that cannot be compared; a camera may lack the control. */
static int turn_automatic_off(struct camera_controls *controls, struct nacre_error *error)
{
    static const struct {
        uint32_t id;
        int64_t off;
        const char *name;
    } automatic[] = {{V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL, "exposure"},
                     {V4L2_CID_AUTOGAIN, 0, "gain"},
                     {V4L2_CID_AUTO_WHITE_BALANCE, 0, "white balance"}};
    for (size_t i = 0; i < sizeof automatic / sizeof *automatic; i++) {
        int number = controls->ops->set(controls, automatic[i].id, automatic[i].off);
        if (number != 0 && number != EINVAL) {
            return nacre_fail_errno(error, number, "automatic %s cannot be turned off",
                                    automatic[i].name);
        }
    }
    return NACRE_OK;
}

/* The time of a row of pixels, as sensors tell it; 0 where they do not. */
static double row_ns(struct camera_controls *controls, int width)
{
    int64_t blanking = 0;
    int64_t pixels_per_s = 0;
    if (controls->ops->get(controls, V4L2_CID_HBLANK, &blanking) != 0 ||
        controls->ops->get(controls, V4L2_CID_PIXEL_RATE, &pixels_per_s) != 0 ||
        pixels_per_s <= 0) {
        return 0;
    }
    return (double)(width + blanking) * 1e9 / (double)pixels_per_s;
}

int camera_exposure_find(struct camera_controls *controls, int width, int height,
                         struct camera_exposure *exposure, struct nacre_error *error)
{
    struct camera_control_range range;
    double row = row_ns(controls, width);
    *exposure = (struct camera_exposure){.controls = controls};
    int status = turn_automatic_off(controls, error);
    if (status != NACRE_OK) {
        return status;
    }
    if (row > 0 && has(controls, V4L2_CID_EXPOSURE, &range)) {
        exposure->id = V4L2_CID_EXPOSURE;
        exposure->unit_ns = row;
        exposure->rows = has(controls, V4L2_CID_VBLANK, &range) ? height : 0;
    } else if (has(controls, V4L2_CID_EXPOSURE_ABSOLUTE, &range)) {
        exposure->id = V4L2_CID_EXPOSURE_ABSOLUTE;
        exposure->unit_ns = 100000;
    }
    return NACRE_OK;
}

/* Make frames long enough, by rows that are not read, for an exposure of so many rows. */
static int stretch(const struct camera_exposure *exposure, double rows, struct nacre_error *error)
{
    struct camera_controls *controls = exposure->controls;
    struct camera_control_range range;
    int number = controls->ops->query(controls, V4L2_CID_VBLANK, &range);
    if (number == 0) {
        double wanted = rows + SPARE_ROWS - exposure->rows;
        wanted = wanted < (double)range.minimum ? (double)range.minimum : wanted;
        wanted = wanted > (double)range.maximum ? (double)range.maximum : wanted;
        number = controls->ops->set(controls, V4L2_CID_VBLANK, (int64_t)wanted);
    }
    return number == 0 ? NACRE_OK
                       : nacre_fail_errno(error, number, "the length of frames cannot be set");
}

int camera_exposure_set(struct camera_exposure *exposure, int64_t exposure_ns,
                        struct nacre_error *error)
{
    struct camera_controls *controls = exposure->controls;
    struct camera_control_range range;
    int64_t value = 0;
    double wanted = round((double)exposure_ns / exposure->unit_ns);
    int status = exposure->rows > 0 ? stretch(exposure, wanted, error) : NACRE_OK;
    if (status != NACRE_OK) {
        return status;
    }
    int number = controls->ops->query(controls, exposure->id, &range);
    if (number == 0) {
        wanted = wanted < (double)range.minimum ? (double)range.minimum : wanted;
        wanted = wanted > (double)range.maximum ? (double)range.maximum : wanted;
        number = controls->ops->set(controls, exposure->id, (int64_t)wanted);
    }
    if (number == 0) {
        number = controls->ops->get(controls, exposure->id, &value);
    }
    if (number != 0) {
        return nacre_fail_errno(error, number, "the exposure cannot be set");
    }
    double got_ns = (double)value * exposure->unit_ns;
    if (fabs(got_ns - (double)exposure_ns) > 0.005 * (double)exposure_ns) {
        return nacre_fail(error,
                          "an exposure of %.4f ms is not to be had, the nearest is %.4f ms (it can "
                          "do %.4f to %.4f ms); "
                          "change exposure_turns in the plan",
                          (double)exposure_ns * 1e-6, got_ns * 1e-6,
                          (double)range.minimum * exposure->unit_ns * 1e-6,
                          (double)range.maximum * exposure->unit_ns * 1e-6);
    }
    return NACRE_OK;
}

int camera_exposure_set_gain(struct camera_controls *controls, int64_t gain,
                             struct nacre_error *error)
{
    static const uint32_t ids[] = {V4L2_CID_ANALOGUE_GAIN, V4L2_CID_GAIN};
    struct camera_control_range range;
    for (size_t i = 0; i < sizeof ids / sizeof *ids; i++) {
        if (!has(controls, ids[i], &range)) {
            continue;
        }
        if (gain < range.minimum || gain > range.maximum) {
            return nacre_fail(error,
                              "gain %" PRId64 " is outside its range %" PRId64 " to %" PRId64
                              "; change camera.v4l2.gain",
                              gain, range.minimum, range.maximum);
        }
        int number = controls->ops->set(controls, ids[i], gain);
        return number == 0 ? NACRE_OK : nacre_fail_errno(error, number, "the gain cannot be set");
    }
    return nacre_fail(
        error, "there is no control for the gain; leave camera.v4l2.gain out, or name the sensor's "
               "sub-device as camera.v4l2.subdevice");
}
