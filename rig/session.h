/* A session folder: the files of one acquisition, written pattern by pattern and read back by develop.
 *
 * SESSION/station.yaml, plan.yaml: as used; session.yaml: an id that each pattern file names.
 * SESSION/calibration/{black,white,dots}-NNN.exr and SESSION/frames/NNNNNN.exr (grids): one multi-part file a pattern,
 * one part an exposure, named after its time; channel `raw` UINT, ZIP. A pattern file that exists is whole.
 * docs/formats.md has the attributes. */
#ifndef RIG_SESSION_H
#define RIG_SESSION_H

#include "nacre/error.h"
#include "rig/bayer.h"
#include "rig/plan.h"
#include "rig/station.h"

#include <stdbool.h>
#include <stdint.h>

struct session {
    char *path;
    struct station station;
    struct plan plan;
    char id[17]; /* 16 hexadecimal digits; "": of a session that was begun without */
    int folder;  /* holds the lock while `locked` */
    bool locked;
};

/* One exposure of a pattern. */
struct exposure {
    int64_t exposure_ns;
    int64_t flip_ns, trigger_ns,
        frame_ns; /* pattern on the glass, trigger's edge, exposure's beginning */
    int64_t pulse_ns, pulse_doubt_ns; /* the trigger's pulse as it measured it; 0: it did not */
    uint32_t sequence;
    uint16_t *raw; /* [height][width] */
};

/* Everything recorded of one pattern. */
struct pattern_frames {
    struct pattern pattern;
    int width, height, bits;
    enum bayer bayer;
    int seed; /* of the plan that showed it */
    size_t count;
    struct exposure *exposures;
    const char
        *origin; /* the session that it is taken over from, for writing; NULL: measured here */
};

/* Read a plan and lay it over the station's sample; plan_finish frees. */
int session_read_plan(const char *path, const struct station *station, struct plan *plan,
                      struct nacre_error *error);

/* Read the settings that a session would be measured with into session->station and session->plan. */
int session_read_settings(const char *station_path, const char *plan_path, struct session *session,
                          struct nacre_error *error);

/* Make a session folder from its settings files (copied in, with every default spelled out) and
 * lock it: a second program is refused. plan_path NULL: the plan that the station file names. With
 * `resume` an existing folder is continued if its settings are the same as these once read, and
 * unfinished temporary files in it are removed; station_path NULL then means the session's own
 * settings. Without `resume` an existing folder is refused. */
int session_create(const char *path, const char *station_path, const char *plan_path, bool resume,
                   struct session *session, struct nacre_error *error);

/* Open an existing session for reading. */
int session_open(const char *path, struct session *session, struct nacre_error *error);
void session_finish(struct session *session);

/* The file of a pattern, "SESSION/frames/000412.exr"; heap, NULL when memory runs out. */
char *session_pattern_path(const struct session *session, struct pattern pattern);

/* Whether the pattern's file exists. */
bool session_has(const struct session *session, struct pattern pattern);

/* How long exposure `index` of every pattern takes: whole turns of the wheel, rounded to a
 * nanosecond. */
int64_t session_exposure_ns(const struct session *session, size_t index);

/* Write a pattern's file, whole or not at all. */
int session_write(const struct session *session, const struct pattern_frames *frames,
                  struct nacre_error *error);

/* Read a pattern's file; pattern_frames_finish frees. Checked: kind, number, seed, size, bits,
 * Bayer order and exposures against the session's settings, and its id. A pattern that was not measured fails
 * too: ask session_has. */
int session_read(const struct session *session, struct pattern pattern,
                 struct pattern_frames *frames, struct nacre_error *error);
void pattern_frames_finish(struct pattern_frames *frames);

#endif
