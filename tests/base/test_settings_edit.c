/* Tests of changing numbers in settings files. */
#include "base/settings_edit.h"

#include "tests/files.h"
#include "unity.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

struct inner {
    double a, b;
};

struct outer {
    struct inner inner;
    double c;
    char *name;
};

static const struct settings_field inner_fields[] = {{.key = "a",
                                                      .kind = SETTINGS_REAL,
                                                      .offset = offsetof(struct inner, a),
                                                      .maximum = 100,
                                                      .sentence = "a"},
                                                     {.key = "b",
                                                      .kind = SETTINGS_REAL,
                                                      .offset = offsetof(struct inner, b),
                                                      .maximum = 100,
                                                      .sentence = "b"},
                                                     {0}};
static const struct settings_schema inner_schema = {
    .what = "inner", .size = sizeof(struct inner), .fields = inner_fields};
static const struct settings_field outer_fields[] = {{.key = "inner",
                                                      .kind = SETTINGS_STRUCT,
                                                      .offset = offsetof(struct outer, inner),
                                                      .schema = &inner_schema,
                                                      .sentence = "inner"},
                                                     {.key = "c",
                                                      .kind = SETTINGS_REAL,
                                                      .offset = offsetof(struct outer, c),
                                                      .maximum = 100,
                                                      .sentence = "c"},
                                                     {.key = "name",
                                                      .kind = SETTINGS_STRING,
                                                      .offset = offsetof(struct outer, name),
                                                      .sentence = "name"},
                                                     {0}};
static const struct settings_schema schema = {
    .what = "test file", .size = sizeof(struct outer), .fields = outer_fields};

static char *folder, *path;
static struct nacre_error error;

void setUp(void)
{
    folder = folder_make();
    path = path_join(folder, "settings.yaml");
}

void tearDown(void)
{
    free(path);
    folder_remove(folder);
}

static void put(const char *text)
{
    text_write(path, text);
}

static void is_now(const char *expected)
{
    size_t size = 0;
    char *text = (char *)file_read(path, &size);
    TEST_ASSERT_EQUAL_STRING(expected, text);
    free(text);
}

static void edit(const char *before, const char *key, double value, const char *after)
{
    const struct settings_edit change = {key, value};
    put(before);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, settings_edit(path, &schema, &change, 1, &error),
                                  error.text);
    is_now(after);
}

static void number_is_replaced_and_the_rest_stays(void)
{
    edit("# caf\xC3\xA9\nc:  7   # old\ninner: {a: 1}\n", "c", 8.25,
         "# caf\xC3\xA9\nc:  8.25   # old\ninner: {a: 1}\n");
    edit("inner:\n  b: 3 # three\n  a: 1\n", "inner.b", 4, "inner:\n  b: 4 # three\n  a: 1\n");
    edit("inner: {a: 1, b: 2}\n", "inner.a", 9, "inner: {a: 9, b: 2}\n");
}

static void missing_key_is_added_to_its_mapping(void)
{
    edit("inner:\n  # first\n  a: 1\n", "inner.b", 4, "inner:\n  # first\n  b: 4\n  a: 1\n");
    edit("inner: {a: 1}\n", "inner.b", 4, "inner: {b: 4, a: 1}\n");
    edit("inner: {}\n", "inner.b", 4, "inner: {b: 4}\n");
    edit("# only c\nc: 1\n", "inner.b", 4, "# only c\ninner: {b: 4}\nc: 1\n");
}

static void several_are_changed_at_once(void)
{
    const struct settings_edit changes[] = {{"c", 2}, {"inner.a", 3}, {"inner.b", 4}};
    put("name: x\n");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, settings_edit(path, &schema, changes, 3, &error),
                                  error.text);
    is_now("inner: {b: 4, a: 3}\nc: 2\nname: x\n");
}

static void refuse(const char *before, const char *key, double value, const char *what)
{
    const struct settings_edit change = {key, value};
    put(before);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_edit(path, &schema, &change, 1, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, what), error.text);
    is_now(before);
}

static void what_would_not_be_read_is_refused(void)
{
    refuse("c: 1\n", "c", 101, "c");
    refuse("c: 1\n", "d", 1, "d");
    refuse("inner: 3\n", "inner.a", 1, "inner");
    refuse("c: [1\n", "c", 2, "line");
    refuse("- 1\n", "c", 2, "is no settings file");
}

static void byte_order_mark_is_no_character(void)
{
    edit("\xEF\xBB\xBF"
         "c: 16\n",
         "c", 12,
         "\xEF\xBB\xBF"
         "c: 12\n");
    edit("\xEF\xBB\xBF"
         "name: x\n",
         "inner.b", 4,
         "\xEF\xBB\xBF"
         "inner: {b: 4}\nname: x\n");
}

static void empty_value_is_filled(void)
{
    edit("name: x\nc:\n", "c", 3, "name: x\nc: 3\n");
}

static void text_behind_a_zero_is_not_lost(void)
{
    static const char text[] = "c: 1\n\0name: x\n";
    const struct settings_edit change = {"c", 2};
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_UINT64(sizeof text - 1, fwrite(text, 1, sizeof text - 1, file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_edit(path, &schema, &change, 1, &error));
    is_now("c: 1\n");
}

/* The daemon, which is another user, must read what root has edited, whatever root's umask is. */
static void permissions_stay_as_they_are(void)
{
    struct stat found;
    mode_t before = umask(077);
    put("c: 1\n");
    TEST_ASSERT_EQUAL_INT(0, chmod(path, 0644));
    edit("c: 1\n", "c", 2, "c: 2\n");
    (void)umask(before);
    TEST_ASSERT_EQUAL_INT(0, stat(path, &found));
    TEST_ASSERT_EQUAL_HEX(0644, found.st_mode & 0777);
}

static void file_that_is_not_there_is_refused(void)
{
    const struct settings_edit change = {"c", 1};
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          settings_edit("/nonexistent/x.yaml", &schema, &change, 1, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "/nonexistent/x.yaml"), error.text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(number_is_replaced_and_the_rest_stays);
    RUN_TEST(missing_key_is_added_to_its_mapping);
    RUN_TEST(several_are_changed_at_once);
    RUN_TEST(what_would_not_be_read_is_refused);
    RUN_TEST(byte_order_mark_is_no_character);
    RUN_TEST(empty_value_is_filled);
    RUN_TEST(text_behind_a_zero_is_not_lost);
    RUN_TEST(permissions_stay_as_they_are);
    RUN_TEST(file_that_is_not_there_is_refused);
    return UNITY_END();
}
