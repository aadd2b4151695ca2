/* A folder of its own for each test, and the files in it as bytes. */
#ifndef TESTS_NACRE_SCRATCH_H
#define TESTS_NACRE_SCRATCH_H

#include <stddef.h>

/* Call from setUp and tearDown. */
void scratch_make(void);
void scratch_remove(void);

/* The path of NAME in the folder; valid for the next seven calls. */
const char *scratch_path(const char *name);

/* Number of files in the folder, hidden ones too. */
int scratch_count(void);

/* All bytes of a file, with a 0 behind them, from malloc. */
unsigned char *scratch_load(const char *name, size_t *size);
void scratch_store(const char *name, const void *bytes, size_t size);

/* Write a text file; returns its path, valid as above. */
const char *scratch_text(const char *name, const char *text);

/* Where `length` bytes of `needle` begin in a file's bytes; fails the test where they are missing. */
size_t scratch_find(const unsigned char *bytes, size_t size, const void *needle, size_t length);

/* Keep what is written to standard error in between; scratch_hush_end fails the test if there was anything. */
void scratch_hush(void);
void scratch_hush_end(void);

/* Let files grow to `limit` bytes only, as on a full disk; 0 lifts the limit. */
void scratch_limit_files(size_t limit);

#endif
