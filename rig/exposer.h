/* Showing patterns and exposing them until each frame is beyond doubt; keeps account of where the time goes. */
#ifndef RIG_EXPOSER_H
#define RIG_EXPOSER_H

#include "nacre/error.h"
#include "rig/devices.h"
#include "rig/session.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Why something was done again. */
enum retake {
    RETAKE_SHOW, /* the projector did not show the pattern, or not until its exposures were done */
    RETAKE_TRIGGER, /* camera or trigger refused: a pulse that was late or of wrong length */
    RETAKE_LOST,    /* no frame came, or a damaged one */
    RETAKE_UNSHOWN, /* triggered before the pattern was on the glass */
    RETAKE_EARLY,   /* the frame began before its trigger */
    RETAKE_LATE,    /* or too long after it */
    RETAKE_GAP,     /* the camera counted a frame that was not asked for */
    RETAKES
};

/* Words for the reasons in the order of the enum: "show", "trigger" ... */
extern const char *const retake_names[];

/* Where the time of a run went, on the station's clock. */
struct exposer_times {
    int64_t exposing_ns,
        readout_ns;  /* of frames that were kept: what a scan is for, and what it costs at least */
    int64_t flip_ns; /* from asking for a pattern until it is on the glass */
    int64_t trigger_ns; /* from arming the camera until the exposure begins */
    int64_t retakes_ns; /* showing and exposing what did not count */
    int64_t checks_ns;  /* check frames of the white layer and of calibrations */
};

/* Zero-initialise, then set the first members. */
struct exposer {
    const struct devices *devices;
    int retries;          /* after the first try */
    int64_t tolerance_ns; /* by which a triggered frame may begin before or after its trigger */
    void (*tried)(void *context); /* after each try of an exposure; may be NULL */
    void *context;
    bool checking; /* time counts as that of checks */

    struct exposer_times times;
    size_t exposures, retaken[RETAKES];
    bool sequence_known; /* frames arrive one by one: `sequence` is the next one's number */
    uint32_t sequence;
};

/* Put a pattern on the glass; *flip_ns is when it was there. */
int exposer_show(struct exposer *exposer, const uint8_t *levels, int64_t *flip_ns,
                 struct nacre_error *error);

/* Take one exposure of what is shown: exposure->exposure_ns and flip_ns are given, raw has room for a frame, the rest
 * is filled in. A frame counts where
 *   the trigger came when the pattern was on the glass,
 *   a triggered camera's exposure began within the tolerance of its trigger (by the stamp: it cannot truly begin before
 *   it), a free one's not before it, and
 *   the camera's count went on by one.
 * Anything else is taken again. */
int exposer_expose(struct exposer *exposer, struct exposure *exposure, struct nacre_error *error);

/* What was shown and exposed since `before`, a copy of *exposer then, counts for nothing: it is a retake of the pattern. */
void exposer_discard(struct exposer *exposer, const struct exposer *before);

/* All retakes. */
size_t exposer_retries(const struct exposer *exposer);

#endif
