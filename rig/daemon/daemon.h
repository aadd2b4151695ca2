/* The daemon itself: a loop that serves the bus, follows the job and shows the service manager that both live. */
#ifndef RIG_DAEMON_DAEMON_H
#define RIG_DAEMON_DAEMON_H

#include "nacre/error.h"
#include "rig/daemon/bus.h"
#include "rig/daemon/job.h"

/* Serve until SIGTERM or SIGINT; a scan that runs is stopped before its next pattern first. The thread that calls must
 * be the process's only one. */
int daemon_run(const struct bus_settings *settings, const struct job_opener *opener,
               struct nacre_error *error);

#endif
