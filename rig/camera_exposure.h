/* Exposure time and gain of a camera through V4L2's controls, on its video node or on its sensor's sub-device. */
#ifndef RIG_CAMERA_EXPOSURE_H
#define RIG_CAMERA_EXPOSURE_H

#include "nacre/error.h"

#include <stdint.h>

struct camera_controls;

/* What a control allows. */
struct camera_control_range {
    int64_t minimum, maximum, step;
};

/* Each returns 0 or errno's value; EINVAL: there is no such control. */
struct camera_controls_ops {
    int (*query)(struct camera_controls *controls, uint32_t id, struct camera_control_range *range);
    int (*get)(struct camera_controls *controls, uint32_t id, int64_t *value);
    int (*set)(struct camera_controls *controls, uint32_t id, int64_t value);
};

/* The controls of one open device: the kernel's, or a test's. */
struct camera_controls {
    const struct camera_controls_ops *ops;
};

/* How a camera counts its exposures. */
struct camera_exposure {
    struct camera_controls *controls;
    uint32_t id;    /* of the control; 0: there is none */
    double unit_ns; /* of the control's value: a row's time, or 100 us */
    int rows;       /* of a frame, where a frame must be made longer than a long exposure; else 0 */
};

/* Find out how the device, which makes frames of this size, counts exposures, and turn off what would change them by
 * itself. A device without the control is no failure: id is 0. */
int camera_exposure_find(struct camera_controls *controls, int width, int height,
                         struct camera_exposure *exposure, struct nacre_error *error);

/* Expose for exposure_ns from the next frame on. Refused where the device cannot do it to half a percent. */
int camera_exposure_set(struct camera_exposure *exposure, int64_t exposure_ns,
                        struct nacre_error *error);

/* Set the gain, in the driver's own unit. */
int camera_exposure_set_gain(struct camera_controls *controls, int64_t gain,
                             struct nacre_error *error);

#endif
