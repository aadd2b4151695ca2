/* Running the built programs as a user does, and looking at what they print and leave behind (files.h). */
#ifndef TESTS_CMD_SPAWN_H
#define TESTS_CMD_SPAWN_H

#include "tests/files.h"

#include <stddef.h>

/* How one run ended. spawned_finish frees. */
struct spawned {
    int status;   /* exit status, or 128 + the signal that killed it */
    char *output; /* standard output */
    char *errors; /* standard error */
};

/* The circumstances of a run; zeroed: none. */
struct circumstances {
    size_t file_limit;          /* no file may grow beyond so many bytes */
    const char *interrupt_path; /* SIGINT once this file exists, ... */
    int interrupt_ms;           /* ... and so long afterwards */
    int interrupt_us;           /* added to that */
    int signal;                 /* another in place of SIGINT; 0: none */
};

/* Run arguments[0], found by path, to its end; the list ends with NULL. `around` may be NULL. */
struct spawned spawn(const char *const *arguments, const struct circumstances *around);
void spawned_finish(struct spawned *run);

/* Run for what is made before the tests: what fails ends the test program with what was said. */
void spawn_or_abort(const char *const *arguments);

#endif
