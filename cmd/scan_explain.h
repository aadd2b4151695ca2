/* What `nacre scan --explain` prints. */
#ifndef CMD_SCAN_EXPLAIN_H
#define CMD_SCAN_EXPLAIN_H

#include "rig/session.h"

#include <stdbool.h>

/* Print the effects that a virtual station simulates with this plan. `path` is the file that its settings are from. */
int scan_explain(const struct session *session, const char *path, bool json,
                 struct nacre_error *error);

#endif
