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

struct calibrate_options {
    enum black_mode black;
    double confidence;        /* of BLACK_CLIP, one-sided */
    const char *known_pixels; /* a map of pixels that are not to be trusted either; may be NULL */
    const char *pixels;       /* where the map of pixels is written; may be NULL */
};

/* Where white is below this share of the colour's level, a quotient by it is too noisy to find dots in. */
extern const double calibrate_dots_share;

/* Zero-initialised it is empty; calibration_finish frees. */
struct calibration {
    struct noise_model noise;
    struct pixel_map pixels;
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
 * dark or saturated, the dots cannot be found, or a map of pixels cannot be read or written. */
int calibrate(const struct session *session, const struct calibrate_options *options,
              struct visit_progress *progress, struct calibration *calibration,
              struct nacre_error *error);
void calibration_finish(struct calibration *calibration);

#endif
