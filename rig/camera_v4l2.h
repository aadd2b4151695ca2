/* A raw camera of V4L2 behind the camera seam. */
#ifndef RIG_CAMERA_V4L2_H
#define RIG_CAMERA_V4L2_H

#include "base/clock.h"
#include "rig/camera.h"
#include "rig/camera_stream.h"

/* What makes a frame. */
enum camera_mode {
    CAMERA_PULSE, /* the trigger's pulse, which lasts as long as the exposure */
    CAMERA_EDGE,  /* the trigger's rise; the exposure is a control's */
    CAMERA_FREE,  /* nothing: the camera makes frame after frame, and the exposure is a control's */
};

struct camera_v4l2_settings {
    struct camera_stream_settings
        stream; /* of whole frames, with the order from the region's first pixel on */
    struct camera_region region; /* that is kept */
    enum camera_mode mode;
    bool rolling; /* rows do not expose at the same time */
    int64_t gain; /* in the driver's unit; -1: as it is */
    int64_t
        stamp_delay_ns; /* from the exposure's end until the driver stamps its frame, or from its beginning where it
                               says that it stamps that */
    int settle_frames; /* free: frames that may still have the exposure before, after it was changed */
};

/* Open the camera and start it. A camera that was unplugged is opened anew at the next `arm`, if it is back within three
 * seconds. `clock` is the system's monotonic one. The strings of `settings` are copied. */
int camera_v4l2_new(const struct camera_v4l2_settings *settings, struct clock *clock,
                    struct camera **camera, struct nacre_error *error);

#endif
