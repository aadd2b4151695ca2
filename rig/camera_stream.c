/* Streaming from V4L2 devices. */
#include "rig/camera_stream.h"

#include "rig/holder.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

enum { BUFFERS = 4 };

struct mapping {
    void *bytes;
    size_t size;
};

struct device_controls {
    struct camera_controls base;
    int file;
};

struct camera_stream {
    const char *device; /* the caller's */
    int file, subfile;  /* -1: not open */
    uint32_t type;      /* of buffers: of one plane, or of several of which we use one */
    const struct camera_format *format;
    size_t stride;
    size_t frame_bytes;
    struct mapping mappings[BUFFERS];
    int count;
    bool streams;
    struct device_controls controls;
};

/* An ioctl that a signal does not cut short; 0 or errno. */
static int call(int file, unsigned long request, void *argument)
{
    int result = 0;
    do {
        result = ioctl(file, request, argument);
    } while (result != 0 && errno == EINTR);
    return result == 0 ? 0 : errno;
}

static int controls_query(struct camera_controls *controls, uint32_t id,
                          struct camera_control_range *range)
{
    struct v4l2_query_ext_ctrl query = {.id = id};
    int number = call(((struct device_controls *)controls)->file, VIDIOC_QUERY_EXT_CTRL, &query);
    if (number == ENOTTY) {
        number = EINVAL; /* it has no controls at all */
    }
    if (number == 0 && query.flags & V4L2_CTRL_FLAG_DISABLED) {
        number = EINVAL;
    }
    *range = (struct camera_control_range){query.minimum, query.maximum, (int64_t)query.step};
    return number;
}

/* Control values are of 32 or 64 bits, which the call must tell apart. */
static int transfer(struct camera_controls *controls, unsigned long request, uint32_t id,
                    int64_t *value)
{
    int file = ((struct device_controls *)controls)->file;
    struct v4l2_query_ext_ctrl query = {.id = id};
    int number = call(file, VIDIOC_QUERY_EXT_CTRL, &query);
    if (number != 0) {
        return number == ENOTTY ? EINVAL : number;
    }
    bool wide = query.type == V4L2_CTRL_TYPE_INTEGER64;
    struct v4l2_ext_control control = {.id = id};
    struct v4l2_ext_controls list = {
        .which = V4L2_CTRL_WHICH_CUR_VAL, .count = 1, .controls = &control};
    if (wide) {
        control.value64 = *value;
    } else {
        control.value = (int32_t)*value;
    }
    number = call(file, request, &list);
    *value = wide ? control.value64 : control.value;
    return number;
}

static int controls_get(struct camera_controls *controls, uint32_t id, int64_t *value)
{
    *value = 0;
    return transfer(controls, VIDIOC_G_EXT_CTRLS, id, value);
}

static int controls_set(struct camera_controls *controls, uint32_t id, int64_t value)
{
    return transfer(controls, VIDIOC_S_EXT_CTRLS, id, &value);
}

int camera_fail_open(const char *device, int number, struct nacre_error *error)
{
    switch (number) {
    case EACCES:
    case EPERM:
        return nacre_fail(error,
                          "camera %s: may not be opened; install udev/70-nacre-camera.rules, and "
                          "be in the group nacre",
                          device);
    case ENOENT:
    case ENXIO:
    case ENODEV:
        return nacre_fail(
            error,
            "camera %s: is not there; plug it in, or name another as camera.v4l2.device "
            "in the station file",
            device);
    default:
        return nacre_fail_errno(error, number, "camera %s: cannot be opened", device);
    }
}

/* Fail for a call that the driver refused, and say who holds the device if that is why. */
static int fail_call(const struct camera_stream *stream, int number, const char *what,
                     struct nacre_error *error)
{
    char holder[80];
    if (number != EBUSY) {
        return nacre_fail_errno(error, number, "camera %s: %s", stream->device, what);
    }
    holder_find(stream->device, holder, sizeof holder);
    return nacre_fail(error, "camera %s: is in use by %s; stop that", stream->device, holder);
}

static int open_files(struct camera_stream *stream, const struct camera_stream_settings *settings,
                      struct nacre_error *error)
{
    stream->file = open(settings->device, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    if (stream->file < 0) {
        return camera_fail_open(settings->device, errno, error);
    }
    stream->controls.file = stream->file;
    if (settings->subdevice) {
        stream->subfile = open(settings->subdevice, O_RDWR | O_CLOEXEC);
        if (stream->subfile < 0) {
            return camera_fail_open(settings->subdevice, errno, error);
        }
        stream->controls.file = stream->subfile;
    }
    return NACRE_OK;
}

static int check_kind(struct camera_stream *stream, struct nacre_error *error)
{
    struct v4l2_capability found = {.version = 0};
    if (call(stream->file, VIDIOC_QUERYCAP, &found) != 0) {
        return nacre_fail(
            error,
            "camera %s: is no V4L2 device; name another as camera.v4l2.device in the station file",
            stream->device);
    }
    uint32_t can =
        found.capabilities & V4L2_CAP_DEVICE_CAPS ? found.device_caps : found.capabilities;
    stream->type = can & V4L2_CAP_VIDEO_CAPTURE_MPLANE ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE
                                                       : V4L2_BUF_TYPE_VIDEO_CAPTURE;
    if (!(can & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE)) ||
        !(can & V4L2_CAP_STREAMING)) {
        return nacre_fail(error,
                          "camera %s: (%.31s) does not stream pictures; cameras often have several "
                          "nodes, name another",
                          stream->device, (const char *)found.card);
    }
    return NACRE_OK;
}

/* Whether the driver lists the format; what it lists instead is added to `offered`. */
static bool offers(const struct camera_stream *stream, uint32_t code, char *offered, size_t size)
{
    struct v4l2_fmtdesc listed = {.type = stream->type};
    offered[0] = '\0';
    for (; call(stream->file, VIDIOC_ENUM_FMT, &listed) == 0; listed.index++) {
        size_t used = strlen(offered);
        if (listed.pixelformat == code) {
            return true;
        }
        (void)snprintf(offered + used, size - used, " %s",
                       camera_code_text(listed.pixelformat).text);
    }
    return false;
}

static int choose_format(struct camera_stream *stream,
                         const struct camera_stream_settings *settings, struct nacre_error *error)
{
    const struct camera_format *wanted[CAMERA_FORMATS];
    size_t count = camera_formats_find(settings->bayer, settings->bits, wanted);
    char names[32] = "";
    char offered[256];
    for (size_t i = 0; i < count; i++) {
        size_t used = strlen(names);
        if (offers(stream, wanted[i]->code, offered, sizeof offered)) {
            stream->format = wanted[i];
            return NACRE_OK;
        }
        (void)snprintf(names + used, sizeof names - used, "%s%s", i > 0 ? " or " : "",
                       camera_code_text(wanted[i]->code).text);
    }
    if (count == 0) {
        return nacre_fail(
            error,
            "camera %s: there is no format of %d bits; correct camera.bits in the station file",
            stream->device, settings->bits);
    }
    return nacre_fail(
        error,
        "camera %s: has no format %s, which camera.bits and camera.bayer ask for; it offers%s",
        stream->device, names, offered[0] ? offered : " none");
}

static int set_format(struct camera_stream *stream, const struct camera_stream_settings *settings,
                      struct nacre_error *error)
{
    struct v4l2_format agreed = {.type = stream->type};
    bool planes = stream->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
    if (planes) {
        agreed.fmt.pix_mp = (struct v4l2_pix_format_mplane){.width = (uint32_t)settings->width,
                                                            .height = (uint32_t)settings->height,
                                                            .pixelformat = stream->format->code,
                                                            .field = V4L2_FIELD_NONE,
                                                            .num_planes = 1};
    } else {
        agreed.fmt.pix = (struct v4l2_pix_format){.width = (uint32_t)settings->width,
                                                  .height = (uint32_t)settings->height,
                                                  .pixelformat = stream->format->code,
                                                  .field = V4L2_FIELD_NONE};
    }
    int number = call(stream->file, VIDIOC_S_FMT, &agreed);
    if (number != 0) {
        return fail_call(stream, number, "refuses its format", error);
    }
    /* Both kinds begin with width, height and format. */
    const struct v4l2_pix_format *got = &agreed.fmt.pix;
    if (got->pixelformat != stream->format->code || got->width != (uint32_t)settings->width ||
        got->height != (uint32_t)settings->height) {
        return nacre_fail(
            error,
            "camera %s: makes frames of %u x %u pixels in format %s in place of %d x "
            "%d in %s; correct "
            "camera.v4l2.frame_width and camera.v4l2.frame_height in the station file",
            stream->device, got->width, got->height, camera_code_text(got->pixelformat).text,
            settings->width, settings->height, camera_code_text(stream->format->code).text);
    }
    stream->stride = planes ? agreed.fmt.pix_mp.plane_fmt[0].bytesperline : got->bytesperline;
    size_t row = camera_format_row_bytes(stream->format, settings->width);
    if (stream->stride < row) {
        stream->stride = row;
    }
    stream->frame_bytes = stream->stride * (size_t)(settings->height - 1) + row;
    return NACRE_OK;
}

/* A buffer's description, of either kind. */
struct description {
    struct v4l2_buffer buffer;
    struct v4l2_plane planes[VIDEO_MAX_PLANES];
};

static void describe(const struct camera_stream *stream, int index, struct description *description)
{
    *description = (struct description){
        .buffer = {.type = stream->type, .memory = V4L2_MEMORY_MMAP, .index = (uint32_t)index}};
    if (stream->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE) {
        description->buffer.m.planes = description->planes;
        description->buffer.length = VIDEO_MAX_PLANES;
    }
}

static int map_buffer(struct camera_stream *stream, int index, struct nacre_error *error)
{
    struct description description;
    struct mapping *mapping = &stream->mappings[index];
    describe(stream, index, &description);
    int number = call(stream->file, VIDIOC_QUERYBUF, &description.buffer);
    if (number != 0) {
        return fail_call(stream, number, "cannot tell its buffers", error);
    }
    bool planes = stream->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
    mapping->size = planes ? description.planes[0].length : description.buffer.length;
    uint32_t offset = planes ? description.planes[0].m.mem_offset : description.buffer.m.offset;
    if (mapping->size < stream->frame_bytes) {
        return nacre_fail(error,
                          "camera %s: its buffers of %zu bytes do not hold a frame of %zu bytes",
                          stream->device, mapping->size, stream->frame_bytes);
    }
    mapping->bytes =
        mmap(NULL, mapping->size, PROT_READ | PROT_WRITE, MAP_SHARED, stream->file, (off_t)offset);
    if (mapping->bytes == MAP_FAILED) {
        mapping->bytes = NULL;
        return nacre_fail_errno(error, errno, "camera %s: cannot share its buffers",
                                stream->device);
    }
    stream->count = index + 1;
    number = call(stream->file, VIDIOC_QBUF, &description.buffer);
    return number == 0 ? NACRE_OK : fail_call(stream, number, "refuses a buffer", error);
}

static int start(struct camera_stream *stream, struct nacre_error *error)
{
    struct v4l2_requestbuffers request = {
        .count = BUFFERS, .type = stream->type, .memory = V4L2_MEMORY_MMAP};
    int number = call(stream->file, VIDIOC_REQBUFS, &request);
    if (number != 0) {
        return fail_call(stream, number, "gives no buffers", error);
    }
    int given = request.count < BUFFERS ? (int)request.count : BUFFERS;
    int status =
        given > 0 ? NACRE_OK : nacre_fail(error, "camera %s: gives no buffers", stream->device);
    for (int i = 0; i < given && status == NACRE_OK; i++) {
        status = map_buffer(stream, i, error);
    }
    if (status == NACRE_OK) {
        number = call(stream->file, VIDIOC_STREAMON, &stream->type);
        stream->streams = number == 0;
        status =
            number == 0 ? NACRE_OK : fail_call(stream, number, "does not start to stream", error);
    }
    return status;
}

int camera_stream_open(const struct camera_stream_settings *settings, struct camera_stream **stream,
                       struct nacre_error *error)
{
    static const struct camera_controls_ops controls_ops = {controls_query, controls_get,
                                                            controls_set};
    int status = NACRE_OK;
    struct camera_stream *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "a camera");
        goto out;
    }
    *made = (struct camera_stream){.device = settings->device, .file = -1, .subfile = -1};
    made->controls.base.ops = &controls_ops;
    status = open_files(made, settings, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = check_kind(made, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = choose_format(made, settings, error);
    if (!made->format) {
        goto out;
    }
    status = set_format(made, settings, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = start(made, error);
out:
    if (status != NACRE_OK) {
        camera_stream_close(made);
        made = NULL;
    }
    *stream = made;
    return status;
}

void camera_stream_close(struct camera_stream *stream)
{
    if (!stream) {
        return;
    }
    if (stream->streams) {
        (void)call(stream->file, VIDIOC_STREAMOFF, &stream->type); /* closing does it too */
    }
    for (int i = 0; i < stream->count; i++) {
        (void)munmap(stream->mappings[i].bytes, stream->mappings[i].size);
    }
    if (stream->subfile >= 0) {
        (void)close(stream->subfile);
    }
    if (stream->file >= 0) {
        (void)close(stream->file);
    }
    free(stream);
}

/* Take a buffer when there is one; 0, ETIMEDOUT or errno. */
static int dequeue(const struct camera_stream *stream, int64_t timeout_ns,
                   struct v4l2_buffer *buffer)
{
    struct pollfd wanted = {.fd = stream->file, .events = POLLIN};
    struct timespec timeout = {.tv_sec = timeout_ns / 1000000000,
                               .tv_nsec = timeout_ns % 1000000000};
    int found = ppoll(&wanted, 1, &timeout, NULL);
    if (found < 0) {
        return errno == EINTR ? ETIMEDOUT : errno;
    }
    if (found == 0) {
        return ETIMEDOUT;
    }
    int number = call(stream->file, VIDIOC_DQBUF, buffer);
    if (number == EAGAIN) {
        return wanted.revents & POLLERR ? EIO : ETIMEDOUT;
    }
    return number;
}

enum camera_wait camera_stream_wait(struct camera_stream *stream, int64_t timeout_ns,
                                    struct camera_buffer *buffer, int *number)
{
    struct description description;
    describe(stream, 0, &description);
    *number = dequeue(stream, timeout_ns, &description.buffer);
    if (*number == ETIMEDOUT) {
        return CAMERA_NONE;
    }
    const struct v4l2_buffer *got = &description.buffer;
    if (*number == 0 && (int)got->index >= stream->count) {
        *number = EPROTO;
    }
    if (*number != 0) {
        return CAMERA_BROKEN;
    }
    bool planes = stream->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
    *buffer = (struct camera_buffer){
        .index = (int)got->index,
        .bytes = stream->mappings[got->index].bytes,
        .sequence = got->sequence,
        .stamp_ns =
            (int64_t)got->timestamp.tv_sec * 1000000000 + (int64_t)got->timestamp.tv_usec * 1000,
        .at_beginning =
            (got->flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE,
        .stamped = (got->flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC,
        .damaged =
            (got->flags & V4L2_BUF_FLAG_ERROR) != 0 ||
            (planes ? description.planes[0].bytesused : got->bytesused) < stream->frame_bytes};
    return CAMERA_FRAME;
}

int camera_stream_return(struct camera_stream *stream, const struct camera_buffer *buffer)
{
    struct description description;
    describe(stream, buffer->index, &description);
    return call(stream->file, VIDIOC_QBUF, &description.buffer);
}

const struct camera_format *camera_stream_format(const struct camera_stream *stream)
{
    return stream->format;
}

size_t camera_stream_stride(const struct camera_stream *stream)
{
    return stream->stride;
}

struct camera_controls *camera_stream_controls(struct camera_stream *stream)
{
    return &stream->controls.base;
}
