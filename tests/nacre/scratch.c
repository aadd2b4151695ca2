/* Scratch folders for tests. */
#include "scratch.h"

#include "tests/files.h"

#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <unity.h>

static char *folder;
static int kept_error = -1;

void scratch_make(void)
{
    folder = folder_make();
}

void scratch_remove(void)
{
    (void)chmod(folder, 0700);
    folder_remove(folder);
    folder = NULL;
}

const char *scratch_path(const char *name)
{
    static char paths[8][1024];
    static unsigned next;
    char *path = paths[next++ % 8];
    (void)snprintf(path, sizeof paths[0], "%s/%s", folder, name);
    return path;
}

int scratch_count(void)
{
    int count = -2; /* itself and the one above */
    DIR *directory = opendir(folder);
    TEST_ASSERT_NOT_NULL(directory);
    while (readdir(directory)) {
        count++;
    }
    (void)closedir(directory);
    return count;
}

unsigned char *scratch_load(const char *name, size_t *size)
{
    unsigned char *bytes = file_read(scratch_path(name), size);
    TEST_ASSERT_NOT_NULL_MESSAGE(bytes, name);
    return bytes;
}

void scratch_store(const char *name, const void *bytes, size_t size)
{
    file_write(scratch_path(name), bytes, size);
}

const char *scratch_text(const char *name, const char *text)
{
    const char *path = scratch_path(name);
    text_write(path, text);
    return path;
}

size_t scratch_find(const unsigned char *bytes, size_t size, const void *needle, size_t length)
{
    const unsigned char *found = memmem(bytes, size, needle, length);
    TEST_ASSERT_NOT_NULL(found);
    return (size_t)(found - bytes);
}

void scratch_hush(void)
{
    (void)fflush(stderr);
    kept_error = dup(STDERR_FILENO);
    int file = open(scratch_path("stderr"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    TEST_ASSERT_TRUE(kept_error >= 0 && file >= 0);
    (void)dup2(file, STDERR_FILENO);
    (void)close(file);
}

void scratch_hush_end(void)
{
    struct stat status;
    (void)fflush(stderr);
    (void)dup2(kept_error, STDERR_FILENO);
    (void)close(kept_error);
    TEST_ASSERT_EQUAL_INT(0, stat(scratch_path("stderr"), &status));
    (void)remove(scratch_path("stderr"));
    TEST_ASSERT_EQUAL_INT64_MESSAGE(0, status.st_size, "the library printed something");
}

void scratch_limit_files(size_t limit)
{
    struct rlimit old;
    (void)signal(SIGXFSZ, SIG_IGN); /* so that writing fails with EFBIG */
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_FSIZE, &old));
    struct rlimit wanted = {.rlim_cur = limit ? limit : old.rlim_max, .rlim_max = old.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &wanted));
}
