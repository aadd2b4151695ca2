/* A folder of its own for each test. */
#include "scratch.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

static char folder[512];

void scratch_make(void)
{
    const char *base = getenv("TMPDIR");
    (void)snprintf(folder, sizeof folder, "%s/nacre-virtual-XXXXXX", base && *base ? base : "/tmp");
    TEST_ASSERT_NOT_NULL(mkdtemp(folder));
}

const char *scratch_path(const char *name)
{
    static char path[1024];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

const char *scratch_text(const char *name, const char *text)
{
    const char *path = scratch_path(name);
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fputs(text, file) >= 0);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    return path;
}

char *scratch_load(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    TEST_ASSERT_NOT_NULL_MESSAGE(file, path);
    TEST_ASSERT_EQUAL_INT(0, fseek(file, 0, SEEK_END));
    long length = ftell(file);
    rewind(file);
    char *bytes = malloc((size_t)length + 1);
    TEST_ASSERT_NOT_NULL(bytes);
    *size = fread(bytes, 1, (size_t)length, file);
    bytes[*size] = '\0';
    (void)fclose(file); /* only read */
    return bytes;
}

/* Call `visit` with the path of every file in the folder; returns how many there are. */
static int visit_files(int (*visit)(const char *path))
{
    DIR *entries = opendir(folder);
    int count = 0;
    TEST_ASSERT_NOT_NULL(entries);
    for (struct dirent *entry = readdir(entries); entry; entry = readdir(entries)) {
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0) {
            count++;
            if (visit) {
                TEST_ASSERT_EQUAL_INT(0, visit(scratch_path(entry->d_name)));
            }
        }
    }
    (void)closedir(entries); /* only read */
    return count;
}

int scratch_count(void)
{
    return visit_files(NULL);
}

void scratch_remove(void)
{
    (void)visit_files(unlink);
    TEST_ASSERT_EQUAL_INT(0, rmdir(folder));
}
