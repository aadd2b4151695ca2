/* Telling a person how far long work has come, and telling the work that it should stop. */
#ifndef BASE_PROGRESS_H
#define BASE_PROGRESS_H

#include "base/clock.h"
#include "nacre/error.h"

#include <stdbool.h>
#include <stdint.h>

/* A time at which work is given up. */
struct progress_deadline {
    struct clock *clock;
    int64_t time_ns; /* by that clock */
    bool passed;     /* some was given up */
};

/* One task's progress, on standard error. Zero-initialised it stays silent but still notices Ctrl-C. */
struct progress {
    const char *task; /* "factoring" */
    bool visible;     /* standard error is a terminal and --quiet was not given */
    int64_t started_ns, shown_ns;
    struct progress_deadline *deadline; /* or NULL */
};

/* Begin a task; `quiet` silences it. */
struct progress progress_begin(const char *task, bool quiet);

/* `done` of `total` steps are behind us; `detail` (may be NULL) is shown behind the bar ("objective 0.0123"). Draws at
 * most ten times a second. Returns NACRE_OK, or NACRE_CANCELLED with the text set when the user asked to stop or the
 * deadline is over, which it notes there.
 * `progress` may be NULL: nothing is shown, cancelling still works. One thread at a time. */
int progress_step(struct progress *progress, double done, double total, const char *detail,
                  struct nacre_error *error);

/* Wipe the bar. NULL is allowed. */
void progress_end(struct progress *progress);

/* Make SIGINT, SIGTERM and, unless it is ignored, SIGHUP set the flag that progress_step reports; a second one of the first
 * two ends the process at once. */
void progress_catch_signals(void);

/* Whether such a signal came. */
bool progress_interrupted(void);

#endif
