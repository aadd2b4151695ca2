/* Looking at a mesh file before Assimp, which trusts what a file says of its own size. */
#include "render/mesh_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { HEADER_MAXIMUM = 1 << 16 };

static const int64_t file_maximum = INT64_C(4) << 30;

/* Every element of a PLY file takes a byte at least. */
static int check_ply(const char *path, const char *header, int64_t size, struct nacre_error *error)
{
    const char *end = strstr(header, "end_header");
    for (const char *line = strstr(header, "\nelement "); line && (!end || line < end);
         line = strstr(line + 1, "\nelement ")) {
        const char *number = strchr(line + strlen("\nelement "), ' ');
        long long count = number ? strtoll(number, NULL, 10) : 0;
        if (count < 0 || count > size) {
            return nacre_fail(error,
                              "%s: the file says that it holds %lld elements of a kind, and has "
                              "only %lld bytes: it is damaged or cut off",
                              path, count, (long long)size);
        }
    }
    return NACRE_OK;
}

int mesh_file_check(const char *path, struct nacre_error *error)
{
    struct stat status;
    char *header = calloc(HEADER_MAXIMUM + 1, 1);
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK), result = NACRE_FAILED;
    bool read = header && file >= 0 && fstat(file, &status) == 0 &&
                (!S_ISREG(status.st_mode) || pread(file, header, HEADER_MAXIMUM, 0) >= 0);
    if (!header) {
        (void)nacre_fail_memory(error, "the header of a mesh");
    } else if (!read) {
        (void)nacre_fail_errno(error, errno, "%s: cannot read the mesh", path);
    } else if (!S_ISREG(status.st_mode)) {
        (void)nacre_fail(error, "%s: cannot read the mesh: it is no regular file", path);
    } else if (status.st_size == 0) {
        (void)nacre_fail(error, "%s: the mesh's file is empty", path);
    } else if (status.st_size > file_maximum) {
        (void)nacre_fail(error,
                         "%s: the mesh's file of %.1f GB is larger than the limit of %.1f GB; "
                         "simplify the mesh",
                         path, (double)status.st_size * 1e-9, (double)file_maximum * 1e-9);
    } else {
        result = strncmp(header, "ply", 3) == 0 ? check_ply(path, header, status.st_size, error)
                                                : NACRE_OK;
    }
    if (file >= 0) {
        (void)close(file);
    }
    free(header);
    return result;
}
