/* The operator's words for what a station does: names of states, and one line that tells all. */
#ifndef RIG_DAEMON_WORDS_H
#define RIG_DAEMON_WORDS_H

#include "rig/daemon/job.h"

/* "running", as the D-Bus property State says it. */
const char *words_state(enum job_state state);

/* "measuring grid 17, pattern 412 of 2401, 1 h 12 min left, 3 frames taken again". */
void words_describe(const struct job_status *status, char *text, size_t size);

/* Put a question mark for each byte that is no part of UTF-8, which D-Bus would refuse: texts are cut anywhere. */
void words_clean(char *text);

#endif
