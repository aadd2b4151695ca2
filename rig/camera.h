/* The camera seam: what the sequencer needs of any raw-Bayer camera. */
#ifndef RIG_CAMERA_H
#define RIG_CAMERA_H

#include "nacre/error.h"
#include "rig/bayer.h"

#include <stdbool.h>
#include <stdint.h>

struct camera;

/* One exposure as the sensor gave it. */
struct camera_frame {
    const uint16_t *raw; /* [height][width], owned by the camera, valid until the next call to it */
    int64_t frame_ns;    /* when the exposure began, on the station's clock */
    uint32_t sequence;   /* counts frames; a gap is a lost frame */
};

struct camera_ops {
    const char *name;
    /* Get ready to expose once for exposure_ns at the next trigger. */
    int (*arm)(struct camera *camera, int64_t exposure_ns, struct nacre_error *error);
    /* Wait for the triggered frame, at most until timeout_ns after the call. A frame that was lost
     * or damaged is NACRE_FAILED with a text; the sequencer retries. */
    int (*take)(struct camera *camera, int64_t timeout_ns, struct camera_frame *frame,
                struct nacre_error *error);
    void (*close)(struct camera *camera);
};

/* A concrete camera embeds this as its first member. */
struct camera {
    const struct camera_ops *ops;
    int width, height; /* of raw frames, cropped to the sample's region */
    int bits;          /* a saturated pixel holds 2^bits - 1 */
    enum bayer bayer;
    bool
        free_running; /* it takes frame after frame, whatever the trigger does: the first exposure that
                          begins after the trigger is its own, however long after */
};

#endif
