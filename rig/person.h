/* The person at the station: asked on the terminal, or by a signal where there is none. */
#ifndef RIG_PERSON_H
#define RIG_PERSON_H

#include "base/progress.h"
#include "nacre/error.h"

#include <signal.h>
#include <stdbool.h>

struct person {
    struct progress *progress;  /* whose bar is wiped before a question; may be NULL */
    bool terminal;              /* answers come from standard input; otherwise by signals */
    struct sigaction before[2]; /* what SIGUSR1 and SIGUSR2 did before person_begin */
};

/* Get ready to ask: Enter answers where standard input is a terminal, and SIGUSR1 everywhere. One at a time. */
int person_begin(struct person *person, struct progress *progress, struct nacre_error *error);
void person_end(struct person *person);

/* For struct sequence_operator, with a struct person as context. */
int person_white_layer(void *context, bool on, struct nacre_error *error);
void person_layer_doubted(void *context, const char *why);

#endif
