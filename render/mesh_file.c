/* Looking at a mesh file before Assimp, which trusts what a file says of its own size. */
#include "render/mesh_file.h"

#include "render/mesh_ply.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdint.h>
#include <strings.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static const int64_t file_maximum = INT64_C(4) << 30;

static int check_ply(const char *path, int file, size_t size, struct nacre_error *error)
{
    void *text = mmap(NULL, size, PROT_READ, MAP_PRIVATE, file, 0);
    if (text == MAP_FAILED) { /* NOLINT(performance-no-int-to-ptr) */
        return nacre_fail_errno(error, errno, "%s: cannot read the mesh", path);
    }
    int status = mesh_ply_check(path, text, size, error);
    (void)munmap(text, size);
    return status;
}

int mesh_file_check(const char *path, struct nacre_error *error)
{
    struct stat status;
    char magic[3] = "";
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK), result = NACRE_FAILED;
    bool read = file >= 0 && fstat(file, &status) == 0 &&
                (!S_ISREG(status.st_mode) || pread(file, magic, sizeof magic, 0) >= 0);
    if (!read) {
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
        result = strncasecmp(magic, "ply", 3) == 0
                     ? check_ply(path, file, (size_t)status.st_size, error)
                     : NACRE_OK;
    }
    if (file >= 0) {
        (void)close(file);
    }
    return result;
}
