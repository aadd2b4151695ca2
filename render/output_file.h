/* A text or binary file that is written through stdio and appears whole or not at all. */
#ifndef RENDER_OUTPUT_FILE_H
#define RENDER_OUTPUT_FILE_H

#include "nacre/error.h"
#include "nacre/whole_file.h"

#include <stdio.h>

struct output_file {
    struct whole_file whole;
    FILE *file;
    char *path;
};

/* Takes over `path`, which may be NULL where memory ran out. */
int output_file_open(struct output_file *output, char *path, struct nacre_error *error);

/* Give the file its name if `status` is good so far and all was written; free in any case. */
int output_file_close(struct output_file *output, int status, struct nacre_error *error);

#endif
