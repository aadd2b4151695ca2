/* Printing what a scan needs and what it took, as text or JSON on standard output. */
#ifndef CMD_SCAN_PRINT_H
#define CMD_SCAN_PRINT_H

#include "rig/sequence.h"

#include <stdbool.h>

int scan_print_plan(const struct session *session, const struct sequence_needs *needs, bool json,
                    struct nacre_error *error);

int scan_print_result(const struct sequence_result *result, const struct station *station,
                      bool json, struct nacre_error *error);

#endif
