/* Output files that appear whole or not at all: written beside their place, synced, then renamed. */
#ifndef NACRE_WHOLE_FILE_H
#define NACRE_WHOLE_FILE_H

#include "nacre/error.h"

#include <stddef.h>

/* An output on its way. Zero-initialise; every member is private but `temporary`, the name to write to. */
struct whole_file {
    char *path;
    char *temporary; /* ".NAME.part-XXXXXX" in the folder of path */
};

/* Make the empty temporary file beside `path`. Fails, naming path and remedy, where the folder does not exist or
 * cannot be written, or where path is a folder. */
int whole_file_create(struct whole_file *file, const char *path, struct nacre_error *error);

/* Sync what was written to `temporary`, give it path's name (replacing what was there) and sync the folder. On
 * failure path is as it was. Either way the file is finished; whole_file_discard afterwards does nothing. */
int whole_file_commit(struct whole_file *file, struct nacre_error *error);

/* Remove the temporary file if it was not committed, and free. */
void whole_file_discard(struct whole_file *file);

/* Write `size` bytes as the whole file `path`. */
int whole_file_write(const char *path, const void *bytes, size_t size, struct nacre_error *error);

#endif
