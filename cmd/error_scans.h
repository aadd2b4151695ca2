/* nacre error with two scans: how far one is from the other. */
#ifndef CMD_ERROR_SCANS_H
#define CMD_ERROR_SCANS_H

#include "base/options.h"
#include "nacre/error.h"

#include <stdbool.h>

/* Whether the file is a scan that can be read. */
bool error_is_scan(const char *path);

/* Compare the second operand with the first and print how far it is from it. */
int error_compare_scans(const struct invocation *invocation, struct nacre_error *error);

#endif
