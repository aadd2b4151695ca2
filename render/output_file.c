/* Whole files by stdio. */
#include "render/output_file.h"

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>

int output_file_open(struct output_file *output, char *path, struct nacre_error *error)
{
    *output = (struct output_file){.path = path};
    if (!path) {
        return nacre_fail_memory(error, "the name of a file");
    }
    if (whole_file_create(&output->whole, path, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    output->file = fopen(output->whole.temporary, "w");
    return output->file ? NACRE_OK : nacre_fail_errno(error, errno, "%s: cannot be written", path);
}

int output_file_close(struct output_file *output, int status, struct nacre_error *error)
{
    if (output->file) {
        bool bad = ferror(output->file) != 0;
        int number = errno;
        if (fclose(output->file) != 0 && !bad) {
            bad = true;
            number = errno;
        }
        if (status == NACRE_OK && bad) {
            status = nacre_fail_errno(error, number, "%s: cannot be written", output->path);
        }
    }
    if (status == NACRE_OK) {
        status = whole_file_commit(&output->whole, error);
    }
    whole_file_discard(&output->whole);
    free(output->path);
    *output = (struct output_file){0};
    return status;
}
