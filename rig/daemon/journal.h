/* What the daemon writes to the journal, with fields that can be searched for. */
#ifndef RIG_DAEMON_JOURNAL_H
#define RIG_DAEMON_JOURNAL_H

#include "rig/daemon/job.h"

/* Write `text` with the status in the fields NACRE_STATE, NACRE_SESSION, NACRE_PATTERN, NACRE_PATTERNS and NACRE_RETRIES.
 * `priority` is one of syslog's. Where there is no journal it goes to standard error. */
void journal_write(int priority, const struct job_status *status, const char *text);

#endif
