/* Changing single numbers in a settings file and leaving the rest of it as a person wrote it. */
#ifndef BASE_SETTINGS_EDIT_H
#define BASE_SETTINGS_EDIT_H

#include "base/settings.h"
#include "nacre/error.h"

#include <stddef.h>

struct settings_edit {
    const char *key; /* "projector.egl.latency_ms" */
    double value;    /* written with up to six digits */
};

/* Put the values into `path`, replacing those that are there and adding keys that are not, whole or not at all. What comes
 * out must be what `schema` reads. */
int settings_edit(const char *path, const struct settings_schema *schema,
                  const struct settings_edit *edits, size_t count, struct nacre_error *error);

#endif
