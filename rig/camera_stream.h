/* One open V4L2 device that streams raw frames into memory shared with the driver. */
#ifndef RIG_CAMERA_STREAM_H
#define RIG_CAMERA_STREAM_H

#include "nacre/error.h"
#include "rig/camera_exposure.h"
#include "rig/camera_format.h"

#include <stdbool.h>

struct camera_stream_settings {
    const char *device; /* of the video node */
    const char
        *subdevice;    /* of the sensor, where its controls are; NULL: the video node has them */
    int width, height; /* of whole frames */
    enum bayer bayer;  /* from the first pixel of a frame */
    int bits;
};

/* A frame in the driver's memory, until it is given back. */
struct camera_buffer {
    int index;
    const uint8_t *bytes;
    uint32_t sequence;
    int64_t stamp_ns;  /* CLOCK_MONOTONIC */
    bool at_beginning; /* the stamp is of the exposure's beginning; otherwise of the frame's end */
    bool stamped;      /* on that clock */
    bool damaged;      /* the driver says so, or it is cut short */
};

struct camera_stream;

/* What became of waiting for a frame. */
enum camera_wait { CAMERA_FRAME, CAMERA_NONE, CAMERA_BROKEN };

/* Open the device, agree on format and size, and start streaming. */
int camera_stream_open(const struct camera_stream_settings *settings, struct camera_stream **stream,
                       struct nacre_error *error);
void camera_stream_close(struct camera_stream *stream); /* NULL is allowed */

/* Wait for the next frame; timeout 0: only look. CAMERA_BROKEN: the stream must be closed, and *number is errno's. */
enum camera_wait camera_stream_wait(struct camera_stream *stream, int64_t timeout_ns,
                                    struct camera_buffer *buffer, int *number);

/* Give a frame back to the driver; 0 or errno. */
int camera_stream_return(struct camera_stream *stream, const struct camera_buffer *buffer);

/* What was agreed on. */
const struct camera_format *camera_stream_format(const struct camera_stream *stream);
size_t camera_stream_stride(const struct camera_stream *stream);

/* Of the sub-device where there is one. */
struct camera_controls *camera_stream_controls(struct camera_stream *stream);

/* Fail for a node that could not be opened, by errno. */
int camera_fail_open(const char *device, int number, struct nacre_error *error);

#endif
