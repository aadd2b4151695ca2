/* Whether the white diffuse layer truly lies on the sample, or is off it: seen in check frames. */
#ifndef RIG_LAYER_CHECK_H
#define RIG_LAYER_CHECK_H

#include "nacre/error.h"
#include "rig/exposer.h"
#include "rig/frame_compare.h"
#include "rig/session.h"

#include <stdbool.h>
#include <stdint.h>

/* A check frame shows the first dots pattern: sharp on the layer, blurred and of another brightness on a translucent
 * sample. It is compared with the frame of this pattern that the session keeps, which was measured on the layer; before
 * there is one, with a check frame from before the person was asked. */
struct layer_check {
    struct exposer *exposer;
    const struct session *session;
    uint8_t *levels;     /* [projector height][projector width], borrowed */
    uint16_t *frames;    /* three of the camera's size: before, now, again */
    bool known;          /* `before` is there */
    bool on_layer;       /* and was measured on the layer */
    int64_t exposure_ns; /* of all three */
};

/* What a check frame says. */
enum layer_verdict {
    LAYER_RIGHT,   /* it is as it should be */
    LAYER_WRONG,   /* it is not */
    LAYER_UNCLEAR, /* that cannot be told */
    LAYER_MOVED    /* it is on, but not all is where it was */
};

/* What was found, and on what ground. */
struct layer_finding {
    enum layer_verdict verdict;
    struct frame_difference difference;
    char why[256]; /* a sentence without a full stop, where the verdict is not LAYER_RIGHT */
};

/* Zero-initialised it is empty; layer_check_finish frees. `levels` has room for a pattern. */
int layer_check_begin(struct layer_check *check, struct exposer *exposer,
                      const struct session *session, uint8_t *levels, struct nacre_error *error);

/* Compare with the first dots pattern of a session from now on, where it was measured: of this one, or of another of which
 * the calibration is to be used. */
int layer_check_recall(struct layer_check *check, const struct session *from,
                       struct nacre_error *error);

void layer_check_finish(struct layer_check *check);

/* The first dots pattern was measured on the layer: compare with it from now on. Others are left alone. */
void layer_check_remember(struct layer_check *check, const struct pattern_frames *frames);

/* Before the person is asked: take what there is to compare with where nothing is known. */
int layer_check_before(struct layer_check *check, struct nacre_error *error);

/* After the person has done it. */
int layer_check_after(struct layer_check *check, bool on, struct layer_finding *finding,
                      struct nacre_error *error);

/* The same, decided on a difference: for a reference measured on the layer (on_layer), or in the state before. */
enum layer_verdict layer_judge(const struct frame_difference *difference, bool on, bool on_layer);

/* By how much dots may have moved for calibrations to hold, raw pixels. */
extern const double layer_moved_px;

#endif
