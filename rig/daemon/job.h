/* A scan that runs in a thread of its own: started, paused, confirmed and stopped from another. */
#ifndef RIG_DAEMON_JOB_H
#define RIG_DAEMON_JOB_H

#include "nacre/error.h"
#include "rig/devices.h"
#include "rig/plan.h"
#include "rig/station.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum job_state {
    JOB_IDLE,      /* no scan was begun */
    JOB_PREPARING, /* its devices are being opened */
    JOB_RUNNING,
    JOB_WAITING, /* for the person to do what the message asks, and job_confirm */
    JOB_PAUSED,
    JOB_DONE,
    JOB_FAILED,
    JOB_CANCELLED,
};

/* How a job comes by its devices; called in the job's thread. */
struct job_opener {
    void *context;
    int (*open)(void *context, const struct station *station, struct devices *devices,
                struct nacre_error *error);
    void (*close)(void *context, struct devices *devices);
    /* The person has laid the white layer, or taken it off: virtual devices must be told. May be NULL. */
    void (*white_layer)(void *context, bool on);
    bool check_layer; /* look in a frame whether it was done */
};

/* What is to be measured. */
struct job_order {
    const char *path;    /* the session's folder; its last part is the job's name */
    const char *station; /* the station file; NULL: resume the session with its own settings */
    const char *plan;    /* the text of the plan; NULL: the one that the station file names */
    bool unfinished;     /* the folder is there already, but was not made to its end */
};

enum { JOB_NAME_SIZE = 256 };

/* What is known of a job at one moment. */
struct job_status {
    enum job_state state;
    unsigned number; /* counts the jobs that were begun: one may end before anybody looks */
    char name[JOB_NAME_SIZE]; /* of the session; empty before the first job */
    struct pattern pattern;   /* the one being measured */
    size_t done, patterns;    /* of the session: that were measured, and all */
    size_t retries;           /* frames taken again by this job */
    double seconds_left;
    bool pausing, stopping; /* asked for, and done before the next pattern */
    char message[1024];     /* waiting: what the person is asked; failed: why */
};

struct job;

int job_new(const struct job_opener *opener, struct job **job, struct nacre_error *error);
/* Stops a job that runs, and waits for it. NULL is allowed. */
void job_free(struct job *job);

/* Readable when the status has changed: clear it, and then read the status. */
int job_event_fd(const struct job *job);
void job_clear_event(struct job *job);
/* The status as it is now. */
void job_read(struct job *job, struct job_status *status);
/* Whether a scan is under way in this state. */
bool job_is_active(enum job_state state);

/* Begin a job. Refused at once when one is active, or settings or the disk are not right; what the devices say comes
 * later, as the state. */
int job_start(struct job *job, const struct job_order *order, struct nacre_error *error);
/* Stop before the next pattern until job_resume. */
int job_pause(struct job *job, struct nacre_error *error);
int job_resume(struct job *job, struct nacre_error *error);
/* The person has done what the message asked; or says that it is so, whatever a check frame shows. */
int job_confirm(struct job *job, struct nacre_error *error);
int job_insist(struct job *job, struct nacre_error *error);
/* Stop for good before the next pattern: whole files only. */
int job_cancel(struct job *job, struct nacre_error *error);

/* Whether the job's thread moves on or has good reason not to: it waits for somebody, or has nothing to do. Its last
 * sign of life may be as old as the longest exposure with all that belongs to it, and `slack_ns`. */
bool job_is_alive(struct job *job, int64_t slack_ns);

#endif
