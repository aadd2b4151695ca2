/* The list of effects that --explain prints. */
#ifndef CMD_EFFECTS_PRINT_H
#define CMD_EFFECTS_PRINT_H

#include "base/effect.h"
#include "nacre/error.h"

#include <stddef.h>

/* What the list is about. */
struct effects_subject {
    const char *station; /* the files whose lines are meant; the first may be NULL */
    const char *sample;  /* may be NULL where no effect has its line there */
    const char *unit;    /* "s" or "ms" */
    double units_a_second;
    const char *note; /* below the list: of what the costs are */
};

/* Print the list on stdout, as a table or as JSON. */
int effects_print(const struct effects_subject *subject, const struct effect *effects, size_t count,
                  bool json, struct nacre_error *error);

#endif
