/* Output files that appear whole or not at all. */
#include "nacre/whole_file.h"
#include "scratch.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <unity.h>

void setUp(void)
{
    scratch_make();
}

void tearDown(void)
{
    scratch_limit_files(0);
    scratch_remove();
}

static void expect_content(const char *name, const char *text)
{
    size_t size = 0;
    unsigned char *bytes = scratch_load(name, &size);
    TEST_ASSERT_EQUAL_STRING(text, (const char *)bytes);
    free(bytes);
}

static void fill(const struct whole_file *file, const char *text)
{
    FILE *stream = fopen(file->temporary, "w");
    TEST_ASSERT_NOT_NULL(stream);
    (void)fputs(text, stream);
    TEST_ASSERT_EQUAL_INT(0, fclose(stream));
}

static void committed_file_replaces_the_old_one(void)
{
    struct nacre_error error = {0};
    struct whole_file file;
    scratch_store("a", "old", 3);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, whole_file_create(&file, scratch_path("a"), &error));
    fill(&file, "new");
    expect_content("a", "old"); /* nothing is seen before the commit */
    TEST_ASSERT_EQUAL_INT(NACRE_OK, whole_file_commit(&file, &error));
    expect_content("a", "new");
    whole_file_discard(&file);
    TEST_ASSERT_EQUAL_INT(1, scratch_count());
}

static void discarded_file_leaves_the_old_one_and_nothing_beside_it(void)
{
    struct nacre_error error = {0};
    struct whole_file file;
    scratch_store("a", "old", 3);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, whole_file_create(&file, scratch_path("a"), &error));
    fill(&file, "new");
    TEST_ASSERT_EQUAL_INT(2, scratch_count());
    whole_file_discard(&file);
    expect_content("a", "old");
    TEST_ASSERT_EQUAL_INT(1, scratch_count());
    whole_file_discard(&file);
    whole_file_discard(NULL);
}

static void temporary_name_is_hidden_and_names_the_file(void)
{
    struct nacre_error error = {0};
    struct whole_file file;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, whole_file_create(&file, scratch_path("a.exr"), &error));
    TEST_ASSERT_NOT_NULL(strstr(file.temporary, "/.a.exr.part-"));
    whole_file_discard(&file);
    TEST_ASSERT_EQUAL_INT(0, scratch_count());
}

static void file_in_the_current_folder_needs_no_slash(void)
{
    char before[512];
    TEST_ASSERT_NOT_NULL(getcwd(before, sizeof before));
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_INT(0, chdir(scratch_path("")));
    int status = whole_file_write("a", "x", 1, &error);
    TEST_ASSERT_EQUAL_INT(0, chdir(before));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, status, error.text);
    expect_content("a", "x");
}

static void name_of_255_characters_can_be_written(void)
{
    char name[256];
    struct nacre_error error = {0};
    memset(name, 'n', 255);
    name[255] = '\0';
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, whole_file_write(scratch_path(name), "x", 1, &error),
                                  error.text);
    expect_content(name, "x");
}

static void link_stays_a_link_to_the_new_file(void)
{
    struct nacre_error error = {0};
    struct stat status;
    scratch_store("target", "old", 3);
    TEST_ASSERT_EQUAL_INT(0, symlink("target", scratch_path("link")));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, whole_file_write(scratch_path("link"), "new", 3, &error));
    TEST_ASSERT_EQUAL_INT(0, lstat(scratch_path("link"), &status));
    TEST_ASSERT_TRUE(S_ISLNK(status.st_mode));
    expect_content("target", "new");
}

static void permissions_follow_the_umask(void)
{
    struct nacre_error error = {0};
    struct stat status;
    mode_t before = umask(027);
    int result = whole_file_write(scratch_path("a"), "x", 1, &error);
    (void)umask(before);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, result);
    TEST_ASSERT_EQUAL_INT(0, stat(scratch_path("a"), &status));
    TEST_ASSERT_EQUAL_HEX32(0640, status.st_mode & 0777);
}

static void empty_file_can_be_written(void)
{
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, whole_file_write(scratch_path("a"), "", 0, &error));
    expect_content("a", "");
}

static void expect_refusal(const char *path, const char *why)
{
    struct nacre_error error = {0};
    struct whole_file file;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, whole_file_create(&file, path, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
    TEST_ASSERT_NULL(file.temporary);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, whole_file_create(&file, path, NULL));
}

static void folder_that_does_not_exist_is_named(void)
{
    expect_refusal(scratch_path("no/such/a"), "/no/such/ does not exist; make it first");
    scratch_store("plain", "", 0);
    expect_refusal(scratch_path("plain/a"), "/plain/ does not exist");
}

static void folders_and_devices_are_never_replaced(void)
{
    TEST_ASSERT_EQUAL_INT(0, mkdir(scratch_path("folder"), 0700));
    expect_refusal(scratch_path("folder"), "is a folder; give a file name");
    expect_refusal(scratch_path("new/"), "names a folder");
    expect_refusal("/dev/null", "/dev/null: it is no plain file");
    expect_refusal("", "empty name");
}

static void folder_that_may_not_be_written_is_named(void)
{
    uid_t user = geteuid();
    TEST_ASSERT_EQUAL_INT(0, chmod(scratch_path(""), 0555));
    if (user == 0) {
        TEST_ASSERT_EQUAL_INT(0, seteuid(65534)); /* root may write anywhere */
    }
    struct nacre_error error = {0};
    struct whole_file file;
    int status = whole_file_create(&file, scratch_path("a"), &error);
    if (user == 0) {
        TEST_ASSERT_EQUAL_INT(0, seteuid(0));
    }
    TEST_ASSERT_EQUAL_INT(0, chmod(scratch_path(""), 0700));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "may not be written to"), error.text);
    TEST_ASSERT_EQUAL_INT(0, scratch_count());
}

static void full_disk_leaves_the_old_file_alone(void)
{
    enum { SIZE = 100000 };
    struct nacre_error error = {0};
    char *bytes = calloc(1, SIZE);
    scratch_store("a", "old", 3);
    scratch_limit_files(SIZE / 2);
    int status = whole_file_write(scratch_path("a"), bytes, SIZE, &error);
    scratch_limit_files(0);
    free(bytes);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "/a: File too large"), error.text);
    expect_content("a", "old");
    TEST_ASSERT_EQUAL_INT(1, scratch_count());
}

static void file_whose_folder_vanished_fails_and_leaves_nothing(void)
{
    struct nacre_error error = {0};
    struct whole_file file;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, whole_file_create(&file, scratch_path("a"), &error));
    TEST_ASSERT_EQUAL_INT(0, remove(file.temporary));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, whole_file_commit(&file, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "No such file"), error.text);
    TEST_ASSERT_EQUAL_INT(0, scratch_count());
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(committed_file_replaces_the_old_one);
    RUN_TEST(discarded_file_leaves_the_old_one_and_nothing_beside_it);
    RUN_TEST(temporary_name_is_hidden_and_names_the_file);
    RUN_TEST(file_in_the_current_folder_needs_no_slash);
    RUN_TEST(name_of_255_characters_can_be_written);
    RUN_TEST(link_stays_a_link_to_the_new_file);
    RUN_TEST(permissions_follow_the_umask);
    RUN_TEST(empty_file_can_be_written);
    RUN_TEST(folder_that_does_not_exist_is_named);
    RUN_TEST(folders_and_devices_are_never_replaced);
    RUN_TEST(folder_that_may_not_be_written_is_named);
    RUN_TEST(full_disk_leaves_the_old_file_alone);
    RUN_TEST(file_whose_folder_vanished_fails_and_leaves_nothing);
    return UNITY_END();
}
