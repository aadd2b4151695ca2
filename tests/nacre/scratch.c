/* Scratch folders for tests. */
#include "scratch.h"

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

static char folder[512];
static int kept_error = -1;

void scratch_make(void)
{
    const char *base = getenv("TMPDIR");
    (void)snprintf(folder, sizeof folder, "%s/nacre-test-XXXXXX", base && base[0] ? base : "/tmp");
    TEST_ASSERT_NOT_NULL(mkdtemp(folder));
}

/* Call `act` with the path of each file in the folder. */
static int for_each(int (*act)(const char *path))
{
    int count = 0;
    DIR *directory = opendir(folder);
    TEST_ASSERT_NOT_NULL(directory);
    for (struct dirent *entry = readdir(directory); entry; entry = readdir(directory)) {
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0) {
            if (act) {
                (void)act(scratch_path(entry->d_name));
            }
            count++;
        }
    }
    (void)closedir(directory);
    return count;
}

void scratch_remove(void)
{
    (void)chmod(folder, 0700);
    (void)for_each(remove);
    (void)rmdir(folder);
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
    return for_each(NULL);
}

unsigned char *scratch_load(const char *name, size_t *size)
{
    FILE *file = fopen(scratch_path(name), "rb");
    TEST_ASSERT_NOT_NULL(file);
    (void)fseek(file, 0, SEEK_END);
    *size = (size_t)ftell(file);
    rewind(file);
    unsigned char *bytes = malloc(*size + 1);
    TEST_ASSERT_NOT_NULL(bytes);
    TEST_ASSERT_EQUAL_UINT64(*size, fread(bytes, 1, *size, file));
    (void)fclose(file);
    return bytes;
}

void scratch_store(const char *name, const void *bytes, size_t size)
{
    FILE *file = fopen(scratch_path(name), "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_UINT64(size, fwrite(bytes, 1, size, file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
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
