/* Writing output files beside their place, then giving them their name in one step. */
#include "nacre/whole_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

enum { ATTEMPTS = 100, NAME_LIMIT = 200 };

/* Where `path` ends: through a symbolic link to the file it names, so that the link stays a link.
 */
static char *resolve(const char *path)
{
    struct stat status;
    if (lstat(path, &status) == 0 && S_ISLNK(status.st_mode) && stat(path, &status) == 0) {
        return realpath(path, NULL);
    }
    return strdup(path);
}

/* Anything but a plain file is refused, so that a rename never takes the place of a folder or a
 * device. */
static int check_place(const char *path, struct nacre_error *error)
{
    struct stat status;
    if (path[0] == '\0') {
        return nacre_fail(error, "cannot write: the output file has an empty name");
    }
    if (path[strlen(path) - 1] == '/') {
        return nacre_fail(error, "cannot write %s: it names a folder; give a file name", path);
    }
    if (stat(path, &status) != 0) {
        return NACRE_OK;
    }
    if (S_ISDIR(status.st_mode)) {
        return nacre_fail(error, "cannot write %s: it is a folder; give a file name", path);
    }
    if (!S_ISREG(status.st_mode)) {
        return nacre_fail(error, "cannot write %s: it is no plain file; choose another name", path);
    }
    return NACRE_OK;
}

/* The name's folder, its length in `path`: 0 for the current one. */
static size_t folder_length(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? (size_t)(slash - path) + 1 : 0;
}

static int fail_create(const char *path, int number, struct nacre_error *error)
{
    int length = (int)folder_length(path);
    if (number == ENOENT || number == ENOTDIR) {
        return nacre_fail(error, "cannot write %s: the folder %.*s does not exist; make it first",
                          path, length, path);
    }
    if (number == EACCES || number == EROFS || number == EPERM) {
        return nacre_fail(error,
                          "cannot write %s: the folder %.*s may not be written to (%s); "
                          "choose another or change its permissions",
                          path, length ? length : 1, length ? path : ".", strerrordesc_np(number));
    }
    return nacre_fail_errno(error, number, "cannot write %s", path);
}

int whole_file_create(struct whole_file *file, const char *path, struct nacre_error *error)
{
    *file = (struct whole_file){0};
    bool made = false;
    if (check_place(path, error) != NACRE_OK) {
        goto out;
    }
    file->path = resolve(path);
    file->temporary = file->path ? malloc(strlen(file->path) + 32) : NULL;
    if (!file->temporary) {
        (void)nacre_fail_memory(error, path);
        goto out;
    }
    size_t folder = folder_length(file->path);
    int descriptor = -1;
    for (int attempt = 0; attempt < ATTEMPTS && descriptor < 0; attempt++) {
        uint32_t random = 0;
        if (getrandom(&random, sizeof random, 0) != (ssize_t)sizeof random) {
            random = (uint32_t)getpid() + (uint32_t)attempt;
        }
        (void)sprintf(file->temporary, "%.*s.%.*s.part-%06x", (int)folder, file->path, NAME_LIMIT,
                      file->path + folder, random & 0xffffff);
        descriptor = open(file->temporary, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (descriptor < 0 && errno != EEXIST) {
            break;
        }
    }
    if (descriptor < 0) {
        (void)fail_create(path, errno, error);
        free(file->temporary); /* not ours to remove */
        file->temporary = NULL;
        goto out;
    }
    (void)close(descriptor); /* nothing was written that could be lost */
    made = true;
out:
    if (!made) {
        whole_file_discard(file);
    }
    return made ? NACRE_OK : NACRE_FAILED;
}

/* Wait until the data of the file or folder `path` is on the disk. */
static int sync_path(const char *path, int flags)
{
    int number = 0;
    int descriptor = open(path, flags | O_CLOEXEC);
    if (descriptor < 0) {
        return errno;
    }
    if (fsync(descriptor) != 0) {
        number = errno;
    }
    if (close(descriptor) != 0 && number == 0) {
        number = errno;
    }
    return number;
}

/* Sync the folder that holds `path`. Some file systems cannot; the file itself is safe then. */
static void sync_folder(const char *path)
{
    char *folder = strdup(path);
    if (folder) {
        size_t length = folder_length(path);
        folder[length] = '\0';
        (void)sync_path(length ? folder : ".", O_RDONLY | O_DIRECTORY);
        free(folder);
    }
}

int whole_file_commit(struct whole_file *file, struct nacre_error *error)
{
    int status = NACRE_OK;
    int number = sync_path(file->temporary, O_WRONLY);
    if (number == 0 && rename(file->temporary, file->path) != 0) {
        number = errno;
    }
    if (number != 0) {
        status = nacre_fail_errno(error, number, "cannot write %s", file->path);
        goto out;
    }
    sync_folder(file->path);
    free(file->temporary);
    file->temporary = NULL;
out:
    whole_file_discard(file);
    return status;
}

void whole_file_discard(struct whole_file *file)
{
    if (!file) {
        return;
    }
    if (file->temporary) {
        (void)unlink(file->temporary); /* it may be gone already */
    }
    free(file->temporary);
    free(file->path);
    *file = (struct whole_file){0};
}

/* Write all bytes to the existing file `path`; returns 0 or an errno value. */
static int write_bytes(const char *path, const char *bytes, size_t size)
{
    int number = 0;
    int descriptor = open(path, O_WRONLY | O_CLOEXEC);
    if (descriptor < 0) {
        return errno;
    }
    while (size > 0 && number == 0) {
        ssize_t written = write(descriptor, bytes, size);
        if (written > 0) {
            bytes += written;
            size -= (size_t)written;
        } else if (written == 0) {
            number = ENOSPC;
        } else if (errno != EINTR) {
            number = errno;
        }
    }
    if (close(descriptor) != 0 && number == 0) {
        number = errno;
    }
    return number;
}

int whole_file_write(const char *path, const void *bytes, size_t size, struct nacre_error *error)
{
    struct whole_file file;
    int status = whole_file_create(&file, path, error);
    if (status != NACRE_OK) {
        return status;
    }
    int number = write_bytes(file.temporary, bytes, size);
    if (number != 0) {
        status = nacre_fail_errno(error, number, "cannot write %s", path);
    } else {
        status = whole_file_commit(&file, error);
    }
    whole_file_discard(&file);
    return status;
}
