/* The sequencer: shows every pattern of a session's plan, exposes it and writes its frames. It
 * knows devices only through their seams. */
#ifndef RIG_SEQUENCE_H
#define RIG_SEQUENCE_H

#include "base/progress.h"
#include "nacre/error.h"
#include "rig/devices.h"
#include "rig/exposer.h"
#include "rig/session.h"

/* Where a run is when a pattern begins. */
struct sequence_moment {
    struct pattern pattern;  /* the next one */
    size_t measured, wanted; /* patterns: measured in this run, and all that it was to measure */
    size_t retries;          /* so far */
};

/* What white_layer may return besides a nacre_status. */
enum { SEQUENCE_INSISTED = 1 };

/* What only a person (or the virtual station) can do, and what it wants to know. */
struct sequence_operator {
    void *context;
    /* Lay the white diffuse layer on the sample or take it off, and return when it is done. Called
     * before the first pattern and whenever the layer must change. May return SEQUENCE_INSISTED
     * instead of NACRE_OK: it is so, whatever a check frame shows. */
    int (*white_layer)(void *context, bool on, struct nacre_error *error);
    /* A pattern is shown and exposed next. May take its time, for a pause; NACRE_CANCELLED stops the run, with whole
     * files only. May be NULL. */
    int (*pattern_begins)(void *context, const struct sequence_moment *moment,
                          struct nacre_error *error);
    /* A sign of life: an exposure was tried, taken or not, or the disk that is waited for has moved on. May be NULL. */
    void (*exposure_ends)(void *context);
    /* A check frame does not show what white_layer said; `why` is a sentence without a full stop.
     * white_layer is called again next. May be NULL. */
    void (*layer_doubted)(void *context, const char *why);
    /* An earlier run measured the pattern before the next one: these are its frames. For a station whose time stands still
     * between runs. May be NULL. */
    int (*goes_on)(void *context, const struct pattern_frames *before, struct nacre_error *error);
};

struct sequence_options {
    int retries;          /* of one exposure, after the first try */
    int64_t tolerance_ns; /* by which a frame may begin before or after its trigger; 0: as the
                             station says */
    int64_t
        within_ns; /* on the station's clock, from the run's beginning: no grid is begun that is not foreseen to be
                             done by then; 0: no limit */
    bool check_layer; /* after each change of the white layer look whether it was done */
    const struct session *
        calibration; /* of which white and dots frames are taken over where this session has no dots and
                                          nothing has moved; NULL: all are measured */
};

/* What a whole plan needs. */
struct sequence_needs {
    size_t patterns, exposures; /* exposures over all patterns */
    double seconds;             /* of exposing, without the devices' overhead */
    uint64_t bytes;             /* on disk, at most */
};

/* Where the time went, on the station's clock: these and what `stages` holds sum to station_ns. */
struct sequence_times {
    struct exposer_times stages;
    int64_t person_ns; /* waiting for the person: the white layer, a pause */
    int64_t disk_ns;   /* waiting for frames to be written */
    int64_t rest_ns;
};

/* What was done; counts what a stopped scan had finished too. */
struct sequence_result {
    size_t patterns, skipped;  /* measured now; measured before */
    size_t left;               /* grids that there was no time for */
    size_t exposures, retries; /* kept; taken again */
    size_t retaken[RETAKES];   /* what was taken again, by reason */
    size_t taken_over;         /* calibration frames of another session */
    double moved_px;           /* by which dots lie from where those have them, at most */
    size_t insisted;           /* changes of the white layer that no check frame showed */
    int64_t station_ns;        /* on the station's clock */
    struct sequence_times times;
    uint64_t bytes; /* of the pattern files written */
};

/* What measuring `plan` on `station` needs; of patterns that `session` has already if it is not
 * NULL, nothing. */
int sequence_estimate(const struct station *station, const struct plan *plan,
                      const struct session *session, struct sequence_needs *needs,
                      struct nacre_error *error);

/* Refuse a disk with too little room. `path` is the session's folder, or where it is to be made. */
int sequence_check_disk(const char *path, const struct sequence_needs *needs,
                        struct nacre_error *error);

/* The same while a scan runs: refuse where there is no room for the `next` bytes. `rest` is told: what is still needed. */
int sequence_check_room(const char *path, uint64_t next, uint64_t rest, struct nacre_error *error);

/* What the frames that were kept cost on average beyond exposing and reading out, in turns of the station's colour wheel:
 * waiting for patterns to be on the glass and for exposures to begin. */
double sequence_overhead_turns(const struct sequence_result *result, const struct station *station);

/* Measure every pattern that the session lacks. A lost, damaged or unmatched frame is taken again,
 * so often as the options allow. Stops cleanly, with whole files only, when a device or the disk
 * fails or the user asks (NACRE_CANCELLED); what was written is resumed later. Refuses to begin
 * where the devices are not what the session's station file says, the disk is too small, or there is too little time for the
 * calibration and one grid. What there is no time for is left for a later run, and is no failure. */
int sequence_run(const struct devices *devices, const struct session *session,
                 const struct sequence_operator *person, const struct sequence_options *options,
                 struct progress *progress, struct sequence_result *result,
                 struct nacre_error *error);

#endif
