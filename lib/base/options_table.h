/* What the parser and the help share of the tables of options. Private to options*.c. */
#ifndef BASE_OPTIONS_TABLE_H
#define BASE_OPTIONS_TABLE_H

#include "base/options.h"

/* The values of the options that every verb takes. */
struct options_common {
    bool help, quiet, json;
    const char *device;
};

/* Their table; offsets are within struct options_common. */
extern const struct option_spec options_common_table[];

/* Put the value that `text` says (NULL for flags) at the option's offset in `settings`. */
int options_set_value(const struct option_spec *spec, const char *text, void *settings,
                      struct nacre_error *error);

/* What limits the option in words ("1 to 512", "hals or mu"); may come out empty. */
void options_describe_values(const struct option_spec *spec, char *text, size_t size);

/* Fail where a file that an option writes is an argument, or what another option names; exit 2. */
int options_check_outputs(const struct verb *verb, const void *settings,
                          const struct invocation *invocation, struct nacre_error *error);

#endif
