/* The V4L2 camera. */
#include "rig/camera_v4l2.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

/* A camera that was unplugged may come back within this. */
static const int64_t replug_ns = 3000000000;
static const int64_t replug_round_ns = 100000000;

struct v4l2_camera {
    struct camera base;
    struct clock *clock;
    struct camera_v4l2_settings settings; /* with strings of our own */
    struct camera_stream *stream;         /* NULL after it broke */
    struct camera_exposure exposure;
    int64_t exposure_ns; /* that is set; 0: none is */
    int64_t armed_ns;
    int unsettled;      /* frames to come that do not count yet */
    uint32_t discarded; /* frames of this stream that were not asked for */
    uint32_t delivered;
    uint16_t *raw; /* [height][width] of the region */
};

static void drop(struct v4l2_camera *camera)
{
    camera_stream_close(camera->stream);
    camera->stream = NULL;
}

/* What else the open device must be: able to expose as the mode says. */
static int set_up(struct v4l2_camera *camera, struct nacre_error *error)
{
    const struct camera_v4l2_settings *settings = &camera->settings;
    struct camera_controls *controls = camera_stream_controls(camera->stream);
    int status = camera_exposure_find(controls, settings->stream.width, settings->stream.height,
                                      &camera->exposure, error);
    if (status == NACRE_OK && settings->mode != CAMERA_PULSE && camera->exposure.id == 0) {
        status = nacre_fail(error, "there is no control for the exposure; name the sensor's "
                                   "sub-device as camera.v4l2.subdevice, "
                                   "or use camera.v4l2.mode pulse");
    }
    if (status == NACRE_OK && settings->gain >= 0) {
        status = camera_exposure_set_gain(controls, settings->gain, error);
    }
    if (status != NACRE_OK) {
        (void)nacre_fail_within(error, "camera %s",
                                settings->stream.subdevice ? settings->stream.subdevice
                                                           : settings->stream.device);
    }
    return status;
}

static int connect(struct v4l2_camera *camera, struct nacre_error *error)
{
    int status = camera_stream_open(&camera->settings.stream, &camera->stream, error);
    camera->exposure_ns = 0;
    camera->discarded = 0;
    if (status == NACRE_OK) {
        status = set_up(camera, error);
    }
    if (status != NACRE_OK) {
        drop(camera);
    }
    return status;
}

/* Open a camera that broke, when it is back. */
static int reconnect(struct v4l2_camera *camera, struct nacre_error *error)
{
    int64_t end_ns = clock_now_ns(camera->clock) + replug_ns;
    int status = connect(camera, error);
    while (status != NACRE_OK && clock_now_ns(camera->clock) < end_ns) {
        clock_sleep_until_ns(camera->clock, clock_now_ns(camera->clock) + replug_round_ns);
        status = connect(camera, error);
    }
    return status;
}

/* Fail for a stream that broke, and close it. */
static int fail_stream(struct v4l2_camera *camera, int number, struct nacre_error *error)
{
    const char *device = camera->settings.stream.device;
    drop(camera);
    if (number == ENODEV) {
        return nacre_fail(error, "camera %s: was unplugged; plug it in again", device);
    }
    return nacre_fail_errno(
        error, number, "camera %s: its stream broke; look at its cable and at the kernel's log",
        device);
}

/* Give back a frame that was not asked for. */
static int discard(struct v4l2_camera *camera, const struct camera_buffer *buffer,
                   struct nacre_error *error)
{
    int number = camera_stream_return(camera->stream, buffer);
    camera->discarded++;
    return number == 0 ? NACRE_OK : fail_stream(camera, number, error);
}

/* Frames that wait were made before now. */
static int discard_waiting(struct v4l2_camera *camera, struct nacre_error *error)
{
    struct camera_buffer buffer;
    int number = 0;
    enum camera_wait found = camera_stream_wait(camera->stream, 0, &buffer, &number);
    while (found == CAMERA_FRAME) {
        int status = discard(camera, &buffer, error);
        if (status != NACRE_OK) {
            return status;
        }
        found = camera_stream_wait(camera->stream, 0, &buffer, &number);
    }
    return found == CAMERA_BROKEN ? fail_stream(camera, number, error) : NACRE_OK;
}

static int set_exposure(struct v4l2_camera *camera, int64_t exposure_ns, struct nacre_error *error)
{
    int status = camera_exposure_set(&camera->exposure, exposure_ns, error);
    if (status != NACRE_OK) {
        return nacre_fail_within(error, "camera %s", camera->settings.stream.device);
    }
    camera->unsettled = camera->settings.mode == CAMERA_FREE ? camera->settings.settle_frames : 0;
    return NACRE_OK;
}

static int arm(struct camera *base, int64_t exposure_ns, struct nacre_error *error)
{
    struct v4l2_camera *camera = (struct v4l2_camera *)base;
    int status = NACRE_OK;
    if (exposure_ns <= 0) {
        return nacre_fail(error, "camera %s: cannot expose for %" PRId64 " ns",
                          camera->settings.stream.device, exposure_ns);
    }
    if (!camera->stream) {
        status = reconnect(camera, error);
    }
    if (status == NACRE_OK && camera->settings.mode != CAMERA_PULSE &&
        exposure_ns != camera->exposure_ns) {
        camera->exposure_ns = 0;
        status = set_exposure(camera, exposure_ns, error);
    }
    if (status == NACRE_OK) {
        camera->exposure_ns = exposure_ns;
        status = discard_waiting(camera, error);
    }
    camera->armed_ns = clock_now_ns(camera->clock);
    return status;
}

static int64_t beginning_ns(const struct v4l2_camera *camera, const struct camera_buffer *buffer)
{
    int64_t stamp_ns = buffer->stamp_ns - camera->settings.stamp_delay_ns;
    return buffer->at_beginning ? stamp_ns : stamp_ns - camera->exposure_ns;
}

/* Whether a frame is none that was asked for, as it began too early. */
static bool is_stale(struct v4l2_camera *camera, const struct camera_buffer *buffer)
{
    if (camera->settings.mode != CAMERA_FREE) {
        return buffer->stamp_ns < camera->armed_ns;
    }
    if (beginning_ns(camera, buffer) < camera->armed_ns) {
        return true;
    }
    return camera->unsettled > 0 && camera->unsettled-- > 0;
}

/* Take the pixels out of a frame that was asked for. */
static int keep(struct v4l2_camera *camera, const struct camera_buffer *buffer,
                struct camera_frame *frame, struct nacre_error *error)
{
    const char *device = camera->settings.stream.device;
    int full_scale = (1 << camera->base.bits) - 1;
    if (buffer->damaged) {
        return nacre_fail(error, "camera %s: frame %" PRIu32 " is damaged", device,
                          buffer->sequence);
    }
    if (!buffer->stamped) {
        return nacre_fail(error,
                          "camera %s: its driver does not stamp frames by the monotonic clock, and "
                          "they cannot be "
                          "matched; use another camera or driver",
                          device);
    }
    uint16_t largest = camera_format_unpack(camera_stream_format(camera->stream), buffer->bytes,
                                            camera_stream_stride(camera->stream),
                                            &camera->settings.region, camera->raw);
    if (largest > full_scale) {
        return nacre_fail(
            error,
            "camera %s: a pixel of %d bits holds %u; its driver does not keep to the format %s",
            device, camera->base.bits, (unsigned)largest,
            camera_code_text(camera_stream_format(camera->stream)->code).text);
    }
    *frame = (struct camera_frame){.raw = camera->raw,
                                   .frame_ns = beginning_ns(camera, buffer),
                                   .sequence = camera->settings.mode == CAMERA_FREE
                                                   ? camera->delivered++
                                                   : buffer->sequence - camera->discarded};
    return NACRE_OK;
}

/* Why no frame came. */
static int fail_missing(const struct v4l2_camera *camera, int64_t timeout_ns,
                        struct nacre_error *error)
{
    static const char *const remedies[] = {
        [CAMERA_PULSE] =
            "is its trigger input connected, and the sensor in its external trigger mode?",
        [CAMERA_EDGE] =
            "is its trigger input connected, and the sensor in its external trigger mode?",
        [CAMERA_FREE] = "is the sensor in its external trigger mode?"};
    return nacre_fail(error, "camera %s: no frame within %" PRId64 " ms; %s",
                      camera->settings.stream.device, timeout_ns / 1000000,
                      remedies[camera->settings.mode]);
}

static int take(struct camera *base, int64_t timeout_ns, struct camera_frame *frame,
                struct nacre_error *error)
{
    struct v4l2_camera *camera = (struct v4l2_camera *)base;
    struct camera_buffer buffer;
    int number = 0;
    if (!camera->stream) {
        return nacre_fail(error, "camera %s: is not armed", camera->settings.stream.device);
    }
    int64_t end_ns = clock_now_ns(camera->clock) + timeout_ns;
    for (;;) {
        int64_t left_ns = end_ns - clock_now_ns(camera->clock);
        if (left_ns <= 0) {
            return fail_missing(camera, timeout_ns, error);
        }
        enum camera_wait found = camera_stream_wait(camera->stream, left_ns, &buffer, &number);
        if (found == CAMERA_BROKEN) {
            return fail_stream(camera, number, error);
        }
        if (found == CAMERA_NONE) {
            continue;
        }
        /* Frames without stamps would be stale for ever. */
        if (!buffer.stamped || !is_stale(camera, &buffer)) {
            break;
        }
        int status = discard(camera, &buffer, error);
        if (status != NACRE_OK) {
            return status;
        }
        /* It works, only its frame is still to come. */
        end_ns = clock_now_ns(camera->clock) + timeout_ns;
    }
    int status = keep(camera, &buffer, frame, error);
    number = camera_stream_return(camera->stream, &buffer);
    return status == NACRE_OK && number != 0 ? fail_stream(camera, number, error) : status;
}

static void camera_close(struct camera *base)
{
    struct v4l2_camera *camera = (struct v4l2_camera *)base;
    drop(camera);
    free((char *)camera->settings.stream.device);
    free((char *)camera->settings.stream.subdevice);
    free(camera->raw);
    free(camera);
}

/* What no driver needs to be asked for. */
static int check(const struct camera_v4l2_settings *settings, struct nacre_error *error)
{
    const struct camera_region *region = &settings->region;
    if (settings->rolling && settings->mode == CAMERA_PULSE) {
        return nacre_fail(error,
                          "camera %s: the rows of a rolling shutter do not all expose during the "
                          "trigger's pulse; use "
                          "camera.v4l2.mode edge or free, or a camera with a global shutter",
                          settings->stream.device);
    }
    if (region->left < 0 || region->top < 0 ||
        region->left > settings->stream.width - region->width ||
        region->top > settings->stream.height - region->height) {
        return nacre_fail(error,
                          "camera %s: the region of %d x %d pixels at (%d, %d) is not inside its "
                          "frames of %d x %d; "
                          "correct camera.v4l2.left, top, frame_width or frame_height",
                          settings->stream.device, region->width, region->height, region->left,
                          region->top, settings->stream.width, settings->stream.height);
    }
    return NACRE_OK;
}

static int copy_settings(struct v4l2_camera *camera, const struct camera_v4l2_settings *settings,
                         struct nacre_error *error)
{
    const struct camera_region *region = &settings->region;
    camera->settings = *settings;
    camera->settings.stream.bayer =
        camera_bayer_of_frame(settings->stream.bayer, region->left, region->top);
    camera->settings.stream.device = strdup(settings->stream.device);
    camera->settings.stream.subdevice =
        settings->stream.subdevice ? strdup(settings->stream.subdevice) : NULL;
    camera->raw = malloc((size_t)region->width * (size_t)region->height * sizeof *camera->raw);
    camera->base.width = region->width;
    camera->base.height = region->height;
    camera->base.bits = settings->stream.bits;
    camera->base.bayer = settings->stream.bayer;
    camera->base.free_running = settings->mode == CAMERA_FREE;
    bool good = camera->raw && camera->settings.stream.device &&
                (camera->settings.stream.subdevice || !settings->stream.subdevice);
    return good ? NACRE_OK : nacre_fail_memory(error, "a camera's frames");
}

int camera_v4l2_new(const struct camera_v4l2_settings *settings, struct clock *clock,
                    struct camera **camera, struct nacre_error *error)
{
    static const struct camera_ops ops = {
        .name = "v4l2", .arm = arm, .take = take, .close = camera_close};
    struct v4l2_camera *made = NULL;
    int status = check(settings, error);
    if (status != NACRE_OK) {
        goto out;
    }
    made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "a camera");
        goto out;
    }
    made->base.ops = &ops;
    made->clock = clock;
    status = copy_settings(made, settings, error);
    if (status == NACRE_OK) {
        status = connect(made, error);
    }
out:
    if (status != NACRE_OK && made) {
        camera_close(&made->base);
        made = NULL;
    }
    *camera = made ? &made->base : NULL;
    return status;
}
