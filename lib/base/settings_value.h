/* How a YAML node becomes a value in a struct. Private to settings*.c. */
#ifndef BASE_SETTINGS_VALUE_H
#define BASE_SETTINGS_VALUE_H

#include "base/settings.h"

#include <yaml.h>

/* The document that is being read. */
struct settings_source {
    const char *name;   /* for messages */
    const char *folder; /* relative paths are taken from here */
    yaml_document_t *document;
};

/* Fail with "NAME:LINE:COLUMN: " in front of the text. */
int settings_fail_at(const struct settings_source *source, yaml_mark_t mark,
                     struct nacre_error *error, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* Put the fallbacks of a schema, and of the structs inside, into the zeroed `out`. */
int settings_apply_defaults(const struct settings_source *source,
                            const struct settings_schema *schema, void *out,
                            struct nacre_error *error);

/* Put a node that is no mapping by schema at the field's place in `out`. What was allocated hangs in `out`, also on
 * failure. */
int settings_set_value(const struct settings_source *source, const struct settings_field *field,
                       const yaml_node_t *node, void *out, struct nacre_error *error);

#endif
