/* What a session's calibration frames say of its station: flat field, black level, geometry. */
#ifndef RIG_DEVELOP_CALIBRATE_H
#define RIG_DEVELOP_CALIBRATE_H

#include "nacre/error.h"
#include "rig/develop/align.h"
#include "rig/develop/black.h"
#include "rig/develop/flat.h"
#include "rig/develop/linearity.h"
#include "rig/develop/visit.h"
#include "rig/session.h"

/* Zero-initialised it is empty; calibration_finish frees. */
struct calibration {
    struct noise_model noise;
    struct flat flat;
    struct black_level black;
    struct camera_map map;                       /* surface to camera */
    int white_frames, black_frames, dots_frames; /* that were there */
    double black_median; /* of the black level of pixels that see the sample, raw units a second */
    double noise_median; /* of the deviation of one black frame there, raw units a second */
    struct linearity_report linearity;
    struct align_report align;
    double white_seconds, black_seconds, dots_seconds;
};

/* Read and use all calibration frames. Fails, naming the session and what to do, where a kind has no frame, white is
 * dark or saturated, or the dots cannot be found. */
int calibrate(const struct session *session, enum black_mode black, double confidence,
              struct visit_progress *progress, struct calibration *calibration,
              struct nacre_error *error);
void calibration_finish(struct calibration *calibration);

#endif
