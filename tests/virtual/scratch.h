/* A folder of its own for each test. */
#ifndef TESTS_VIRTUAL_SCRATCH_H
#define TESTS_VIRTUAL_SCRATCH_H

#include <stddef.h>

/* Call from setUp and tearDown. */
void scratch_make(void);
void scratch_remove(void);

/* The path of `name` in the folder, until the next call; nothing is made. */
const char *scratch_path(const char *name);

/* Write a text file into the folder; returns its path. */
const char *scratch_text(const char *name, const char *text);

/* All of a file and a final 0, from malloc. */
char *scratch_load(const char *path, size_t *size);

/* How many files are in the folder, hidden ones too. */
int scratch_count(void);

#endif
