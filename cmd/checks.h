/* A list of things that were checked, each with what was found in one line. */
#ifndef CMD_CHECKS_H
#define CMD_CHECKS_H

#include "nacre/error.h"

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>

enum check_verdict { CHECK_OK, CHECK_WARNING, CHECK_WRONG };

struct check {
    const char *name; /* "camera" */
    enum check_verdict verdict;
    char text[1024];
};

/* Zero-initialised it is empty. */
struct checks {
    struct check *list;
    size_t count;
};

void checks_finish(struct checks *checks);

/* A check that finds no memory is left out. `name` is kept. */
void checks_add(struct checks *checks, const char *name, enum check_verdict verdict,
                const char *format, ...) __attribute__((format(printf, 4, 5)));

/* Right, or wrong with the error's text. */
void checks_add_status(struct checks *checks, const char *name, int status,
                       const struct nacre_error *error);

/* The clock, and the right to real-time priority where the program itself times pulses. */
void checks_of_machine(struct checks *checks, bool times_pulses);

size_t checks_count(const struct checks *checks, enum check_verdict verdict);
void checks_print(const struct checks *checks);
json_t *checks_as_json(const struct checks *checks); /* NULL when memory runs out */

#endif
