/* What the key `virtual`, and the list of forbidden effects, are refused for beyond their single keys. */
#ifndef RIG_VIRTUAL_SETTINGS_CHECK_H
#define RIG_VIRTUAL_SETTINGS_CHECK_H

#include "nacre/error.h"

#include <stddef.h>

struct station;

/* Check what was read from `path`; a message names file and line. */
int virtual_settings_check(const char *path, const struct station *station,
                           struct nacre_error *error);

/* Refuse a name in `without` that is none of the effects, of which there are two NULL-terminated lists; the second may be
 * NULL. */
int effects_check_names(const char *path, int line, char *const *without, size_t count,
                        const char *const *names, const char *const *more,
                        struct nacre_error *error);

#endif
