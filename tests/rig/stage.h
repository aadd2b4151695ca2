/* A small virtual station in a folder of its own, and its camera with faults to inject. */
#ifndef TESTS_RIG_STAGE_H
#define TESTS_RIG_STAGE_H

#include "rig/sequence.h"
#include "rig/virtual/virtual.h"

#include <stdbool.h>

/* Patterns of STAGE_PLAN. */
enum { STAGE_WHITE = 1, STAGE_DOTS = 4, STAGE_BLACK = 2, STAGE_GRIDS = 9, STAGE_PATTERNS = 16 };

/* 6 x 5 surface points, 24 x 20 raw pixels, all noise on, a bare white board; two exposures. */
extern const char stage_station[], stage_plan[];

struct stage {
    char *folder;
    char *station, *plan, *session; /* paths; the session does not exist yet */
};

/* Make the folder with both files in it. The texts may be NULL for those above. */
void stage_make(struct stage *stage, const char *station, const char *plan);
void stage_remove(struct stage *stage);

/* The same with a session that has begun; the text of the station may be NULL, too. */
void stage_begin(struct stage *stage, const char *station, struct session *session);

/* Write a text file FOLDER/NAME. */
void stage_write(const struct stage *stage, const char *name, const char *text);

/* `text` with the first `from` replaced by `to`; heap. */
char *text_replace(const char *text, const char *from, const char *to);

enum fault {
    FAULT_LATE,     /* the frame began too late after its trigger */
    FAULT_EARLY,    /* the frame began before its trigger */
    FAULT_JITTER,   /* the same, within the 2 ms that are tolerated */
    FAULT_LOST,     /* take fails; the frame is gone */
    FAULT_DROPPED,  /* another frame was dropped before this one: its number is one too high */
    FAULT_BROKEN,   /* take fails with EIO, and no frame was counted */
    FAULT_UNPLUGGED /* every take fails from here on */
};

/* A camera in front of another that fails at the `when`-th take, from 0; when < 0: never. */
struct faulty_camera {
    struct camera base;
    struct camera *inner;
    enum fault fault;
    int when, takes;
    uint32_t skipped;
};

struct faulty_camera faulty_camera(struct camera *inner, enum fault fault, int when);

/* A camera in front of another that says its frames began `shift_ns` later, and loses each `lose`-th; 0: none. */
struct shifted_camera {
    struct camera base;
    struct camera *inner;
    int64_t shift_ns;
    int lose, taken;
};

struct shifted_camera shifted_camera(struct camera *inner);

/* What an operator was asked. */
struct operator_log {
    struct virtual_station *station;
    int layer_on, layer_off, begun;
    int64_t white_layer_takes_ns;
    int call_at; /* `call` is called when so many patterns have begun */
    void (*call)(void);
    int raise_at; /* SIGINT when so many patterns have begun; 0: never */
};

/* The operator who obeys at once and keeps the log. */
struct sequence_operator stage_operator(struct operator_log *log, struct virtual_station *station);

/* Measure what `session` lacks on a new virtual station with the fault. */
int stage_scan(const struct session *session, enum fault fault, int when, int retries,
               struct operator_log *log, struct sequence_result *result, struct nacre_error *error);

#endif
