/* Running the built programs as a user does, and looking at what they print and leave behind. */
#ifndef TESTS_CMD_SPAWN_H
#define TESTS_CMD_SPAWN_H

#include <stddef.h>
#include <stdint.h>

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

/* A new empty folder below $TMPDIR or /tmp; heap. folder_remove removes it with all it holds and frees the name. */
char *folder_make(void);
void folder_remove(char *folder);

/* FOLDER/NAME; heap. */
char *path_join(const char *folder, const char *name);

/* The names of everything below `folder`, sorted, with sizes and hashes of files, one a line; heap. Two equal texts
 * mean that nothing was added, removed or altered. */
char *folder_describe(const char *folder);

/* The bytes of a file, with a 0 behind them; heap, NULL when it cannot be read. */
uint8_t *file_read(const char *path, size_t *size);
void file_write(const char *path, const void *bytes, size_t size);
void text_write(const char *path, const char *text);

#endif
