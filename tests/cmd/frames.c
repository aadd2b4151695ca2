/* Comparing what two scans of one plan left behind. */
#include "tests/cmd/frames.h"

#include "nacre/exr_file.h"
#include "tests/cmd/spawn.h"

#include <dirent.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static const char *const folders[] = {".", "calibration", "frames"};
enum { FOLDERS = sizeof folders / sizeof *folders };

static int keep_exr(const struct dirent *entry)
{
    return entry->d_name[0] != '.' && strstr(entry->d_name, ".exr") != NULL;
}

static int keep_unfinished(const struct dirent *entry)
{
    return entry->d_name[0] == '.' && strstr(entry->d_name, ".part-") != NULL;
}

static int keep_visible(const struct dirent *entry)
{
    return entry->d_name[0] != '.';
}

static int count(const char *folder, int (*keep)(const struct dirent *))
{
    struct dirent **entries = NULL;
    int found = scandir(folder, &entries, keep, alphasort);
    for (int i = 0; i < found; i++) {
        free(entries[i]);
    }
    free(entries);
    return found > 0 ? found : 0;
}

struct session_files session_files_count(const char *session)
{
    struct session_files files = {0};
    for (int i = 0; i < FOLDERS; i++) {
        char *folder = path_join(session, folders[i]);
        files.patterns += count(folder, keep_exr);
        files.unfinished += count(folder, keep_unfinished);
        free(folder);
    }
    return files;
}

/* What each session has its own of: what a clock or a counter says, and its id. */
static bool is_its_own(const char *attribute)
{
    static const char *const names[] = {
        "nacre.flip_ns",  "nacre.trigger_ns",     "nacre.frame_ns", "nacre.sequence",
        "nacre.pulse_ns", "nacre.pulse_doubt_ns", "nacre.session"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        if (strcmp(attribute, names[i]) == 0) {
            return true;
        }
    }
    return false;
}

/* Whatever `a` says, `b` says too. */
static void expect_same_attributes(const struct exr_part *a, const struct exr_part *b)
{
    for (size_t i = 0; i < a->attribute_count; i++) {
        const struct exr_attribute *wanted = &a->attributes[i];
        const struct exr_attribute *found = exr_part_find(b, wanted->name, wanted->kind);
        if (is_its_own(wanted->name)) {
            continue;
        }
        TEST_ASSERT_NOT_NULL_MESSAGE(found, wanted->name);
        if (wanted->kind == EXR_INT) {
            TEST_ASSERT_EQUAL_INT_MESSAGE(wanted->integer, found->integer, wanted->name);
        } else {
            TEST_ASSERT_EQUAL_INT_MESSAGE(EXR_STRING, wanted->kind, wanted->name);
            TEST_ASSERT_EQUAL_STRING_MESSAGE(wanted->string, found->string, wanted->name);
        }
    }
}

static void expect_same_part(const struct exr_part *a, const struct exr_part *b, const char *path)
{
    TEST_ASSERT_EQUAL_STRING_MESSAGE(a->name, b->name, path);
    TEST_ASSERT_EQUAL_INT_MESSAGE(a->width, b->width, path);
    TEST_ASSERT_EQUAL_INT_MESSAGE(a->height, b->height, path);
    TEST_ASSERT_EQUAL_UINT_MESSAGE(1, a->plane_count, path);
    TEST_ASSERT_EQUAL_UINT_MESSAGE(1, b->plane_count, path);
    TEST_ASSERT_EQUAL_UINT32_ARRAY_MESSAGE(a->planes[0].integers, b->planes[0].integers,
                                           (size_t)a->width * (size_t)a->height, path);
    expect_same_attributes(a, b);
    expect_same_attributes(b, a);
}

static void expect_same_frames(const char *path_a, const char *path_b)
{
    struct exr_file a = {0};
    struct exr_file b = {0};
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exr_file_read(path_a, &a, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exr_file_read(path_b, &b, &error), error.text);
    TEST_ASSERT_EQUAL_UINT_MESSAGE(a.part_count, b.part_count, path_b);
    for (size_t i = 0; i < a.part_count; i++) {
        expect_same_part(&a.parts[i], &b.parts[i], path_b);
    }
    exr_file_finish(&a);
    exr_file_finish(&b);
}

static void expect_same_bytes(const char *path_a, const char *path_b)
{
    size_t size_a = 0;
    size_t size_b = 0;
    uint8_t *a = file_read(path_a, &size_a);
    uint8_t *b = file_read(path_b, &size_b);
    TEST_ASSERT_TRUE_MESSAGE(a && b && size_a == size_b && memcmp(a, b, size_a) == 0, path_b);
    free(a);
    free(b);
}

static void compare(const char *expected, const char *session, bool bytes)
{
    for (int i = 0; i < FOLDERS; i++) {
        struct dirent **entries = NULL;
        char *from = path_join(expected, folders[i]);
        char *to = path_join(session, folders[i]);
        int found = scandir(from, &entries, keep_visible, alphasort);
        TEST_ASSERT_TRUE_MESSAGE(found > 0, from);
        TEST_ASSERT_EQUAL_INT_MESSAGE(found, count(to, keep_visible), to);
        TEST_ASSERT_EQUAL_INT_MESSAGE(0, count(to, keep_unfinished), to);
        for (int k = 0; k < found; k++) {
            char *a = path_join(from, entries[k]->d_name);
            char *b = path_join(to, entries[k]->d_name);
            if (bytes && entries[k]->d_type == DT_REG) {
                expect_same_bytes(a, b);
            } else if (keep_exr(entries[k])) {
                expect_same_frames(a, b);
            }
            free(a);
            free(b);
            free(entries[k]);
        }
        free(entries);
        free(from);
        free(to);
    }
}

void frames_expect_same(const char *expected, const char *session)
{
    compare(expected, session, true);
}

void frames_expect_same_patterns(const char *expected, const char *session)
{
    compare(expected, session, false);
}
