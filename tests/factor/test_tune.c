/* Trials of tiles: what they remember, where, and that nothing but speed depends on it. */
#include "factor/layout.h"
#include "factor/tune_trial.h"
#include "tests/files.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <unity.h>

static struct opencl opencl; /* the name is all that remembering asks of it */
static char *folder, *file;

static const struct tune_class plain = {.method = "mu", .lanes = 8};
static const struct tune_result two[] = {{{2, 4, 2}, 0.5}, {{3, 1, 64}, 1e-9}};

void setUp(void)
{
    folder = folder_make();
    file = path_join(folder, "nacre/tiles.tsv");
    TEST_ASSERT_EQUAL_INT(0, unsetenv("CACHE_DIRECTORY"));
    TEST_ASSERT_EQUAL_INT(0, setenv("XDG_CACHE_HOME", folder, 1));
    opencl = (struct opencl){.name = "a device\tof two"};
}

void tearDown(void)
{
    char path[640];
    (void)unlink(file);
    (void)snprintf(path, sizeof path, "%s/tiles.tsv", folder);
    (void)unlink(path);
    (void)snprintf(path, sizeof path, "%s/nacre", folder);
    (void)rmdir(path);
    TEST_ASSERT_EQUAL_INT(0, rmdir(folder)); /* nothing else was left */
    free(file);
    free(folder);
}

static void remember(struct tune_class class, const struct tune_result *results, size_t count)
{
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_MESSAGE(NACRE_OK, tune_remember(&opencl, class, results, count, &error),
                              error.text);
}

static size_t recall(struct tune_class class)
{
    struct tune_result results[TUNE_TILES];
    return tune_recall(&opencl, class, results);
}

static void what_is_remembered_is_recalled(void)
{
    struct tune_result results[TUNE_TILES];
    TEST_ASSERT_EQUAL_UINT64(0, recall(plain));
    remember(plain, two, 2);
    TEST_ASSERT_EQUAL_UINT64(2, tune_recall(&opencl, plain, results));
    TEST_ASSERT_EQUAL_INT(3, results[1].tile[0]);
    TEST_ASSERT_EQUAL_INT(64, results[1].tile[2]);
    TEST_ASSERT_TRUE(results[1].seconds == 1e-9 && results[0].seconds == 0.5);
    remember(plain, two + 1, 1); /* in place of the others */
    TEST_ASSERT_EQUAL_UINT64(1, recall(plain));
}

static void classes_and_devices_are_kept_apart(void)
{
    struct tune_class half = plain, clustered = plain, lanes = plain, method = plain;
    half.half = true;
    clustered.clustered = true;
    lanes.lanes = 16;
    method.method = "hals";
    remember(plain, two, 2);
    TEST_ASSERT_EQUAL_UINT64(0, recall(half) + recall(clustered) + recall(lanes) + recall(method));
    remember(half, two, 1);
    TEST_ASSERT_EQUAL_UINT64(2, recall(plain));
    TEST_ASSERT_EQUAL_UINT64(1, recall(half));
    opencl.name[0] = 'A';
    TEST_ASSERT_EQUAL_UINT64(0, recall(plain));
    remember(plain, two, 1);
    opencl.name[0] = 'a';
    TEST_ASSERT_EQUAL_UINT64(2, recall(plain));
}

static void expect_path(const char *expected)
{
    char *path = tune_path();
    TEST_ASSERT_EQUAL_STRING(expected, path);
    free(path);
}

static void the_folder_is_the_services_or_the_users(void)
{
    char path[640];
    (void)snprintf(path, sizeof path, "%s:/elsewhere", folder);
    TEST_ASSERT_EQUAL_INT(0, setenv("CACHE_DIRECTORY", path, 1));
    (void)snprintf(path, sizeof path, "%s/tiles.tsv", folder);
    expect_path(path);
    remember(plain, two, 2);
    TEST_ASSERT_EQUAL_INT(0, access(path, R_OK));
    TEST_ASSERT_EQUAL_INT(0, unsetenv("CACHE_DIRECTORY"));
    expect_path(file);
    TEST_ASSERT_EQUAL_INT(0, setenv("XDG_CACHE_HOME", "not/absolute", 1)); /* to be ignored */
    char *home = getenv("HOME") ? strdup(getenv("HOME")) : NULL;
    TEST_ASSERT_EQUAL_INT(0, setenv("HOME", "/home/x", 1));
    expect_path("/home/x/.cache/nacre/tiles.tsv");
    TEST_ASSERT_EQUAL_INT(0, unsetenv("HOME"));
    expect_path(NULL);
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, tune_remember(&opencl, plain, two, 2, &error));
    TEST_ASSERT_EQUAL_STRING("cannot remember what was measured: none of CACHE_DIRECTORY, "
                             "XDG_CACHE_HOME and HOME names a folder; set one",
                             error.text);
    if (home) {
        TEST_ASSERT_EQUAL_INT(0, setenv("HOME", home, 1));
    }
    free(home);
}

/* Replace what stands behind `mark` in the file by `patch`. */
static void damage(const char *mark, const char *patch)
{
    char text[1024] = "";
    FILE *stream = fopen(file, "r+");
    TEST_ASSERT_NOT_NULL(stream);
    TEST_ASSERT_TRUE(fread(text, 1, sizeof text - 1, stream) > 0);
    char *at = strstr(text, mark);
    TEST_ASSERT_NOT_NULL(at);
    rewind(stream);
    (void)fprintf(stream, "%.*s%s", (int)(at + strlen(mark) - text), text, patch);
    TEST_ASSERT_EQUAL_INT(0, ftruncate(fileno(stream), ftell(stream)));
    (void)fclose(stream);
}

static void damaged_files_tell_nothing_and_are_replaced(void)
{
    static const struct {
        const char *mark, *patch;
    } damages[] = {{"nacre tiles ", "2\n"},
                   {"mu\t8\t0\t0\t", "0\t4\t2\t0.5\n"},
                   {"mu\t8\t0\t0\t", "2\t4\t65\t0.5\n"},
                   {"mu\t8\t0\t0\t", "2\t4\t2\t-0.5\n"},
                   {"mu\t8\t0\t0\t", "2\t4\t2\tnan\n"},
                   {"mu\t8\t0\t0\t", "2\t4\t2\tinf\n"},
                   {"mu\t8\t0\t0\t", "2\t4\t2\t0.5 and more\n"},
                   {"mu\t8\t0\t0\t", "2\t4\t2\t0.5"},
                   {"mu\t8\t0\t0\t", "2\t4\n"},
                   {"mu\t8\t0\t0\t", "99999999999999999999\t4\t2\t0.5\n"},
                   {"mu\t8", "\n\n\t\n"}};
    for (size_t i = 0; i < sizeof damages / sizeof *damages; i++) {
        remember(plain, two, 1);
        TEST_ASSERT_EQUAL_UINT64(1, recall(plain));
        damage(damages[i].mark, damages[i].patch);
        TEST_ASSERT_EQUAL_UINT64(0, recall(plain));
    }
    remember(plain, two, 2);
    TEST_ASSERT_EQUAL_UINT64(2, recall(plain));
}

static void a_place_that_cannot_be_written_is_named(void)
{
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_INT(0, setenv("XDG_CACHE_HOME", "/proc/none", 1));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, tune_remember(&opencl, plain, two, 2, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "/proc/none/nacre/tiles.tsv"));
    TEST_ASSERT_EQUAL_UINT64(0, recall(plain));
}

static void expect_choice(int terms, int rows, int steps, int group)
{
    struct responses responses = {.lanes = 8};
    struct problem problem = {.responses = &responses, .clusters = 1, .terms = terms};
    struct update_tile tile = update_tile_choose(&opencl, &problem);
    TEST_ASSERT_EQUAL_INT(rows, tile.rows);
    TEST_ASSERT_EQUAL_INT(steps, tile.steps);
    TEST_ASSERT_EQUAL_INT(group, tile.group);
}

/* Less than TUNE_MARGIN does not move it; padding counts: 13 terms are 14 planes in twos and 16 in fours. */
static void the_least_time_decides(void)
{
    static const struct tune_result near[] = {{{2, 4, 2}, 1}, {{1, 4, 4}, 0.96}};
    static const struct tune_result far[] = {{{2, 4, 2}, 1}, {{1, 4, 4}, 0.9}};
    expect_choice(12, 2, 4, 2);
    remember(plain, near, 2);
    expect_choice(12, 2, 4, 2);
    remember(plain, far, 2);
    expect_choice(12, 1, 4, 4);
    expect_choice(13, 2, 4, 2);
}

/* OpenCL keeps what it compiles in the user's cache too, so that one is left as it is. */
static void a_trial_measures_every_class(void)
{
    static const struct update_tile tiles[] = {{2, 4, 2}, {1, 2, 1}};
    struct nacre_error error = {0};
    struct opencl device;
    char *text = NULL;
    size_t size = 0;
    TEST_ASSERT_EQUAL_INT(0, setenv("CACHE_DIRECTORY", folder, 1));
    TEST_ASSERT_EQUAL_INT(0, unsetenv("XDG_CACHE_HOME"));
    if (opencl_open(NULL, &device, &error) != NACRE_OK) {
        TEST_IGNORE_MESSAGE(error.text);
    }
    FILE *told = open_memstream(&text, &size);
    TEST_ASSERT_NOT_NULL(told);
    TEST_ASSERT_EQUAL_MESSAGE(NACRE_OK, tune_trial(&device, tiles, 2, NULL, told, &error),
                              error.text);
    TEST_ASSERT_EQUAL_INT(0, fclose(told));
    for (int i = 0; i < 4; i++) {
        struct tune_result results[TUNE_TILES];
        struct tune_class class = {
            .method = "mu", .lanes = layout_lanes(&device), .clustered = i % 2, .half = i / 2};
        TEST_ASSERT_EQUAL_UINT64(2, tune_recall(&device, class, results));
        TEST_ASSERT_EQUAL_INT(1, results[1].tile[0]);
        TEST_ASSERT_TRUE(results[0].seconds > 0 && results[0].seconds < 60);
    }
    TEST_ASSERT_NOT_NULL(strstr(text, "half  several kernels"));
    free(text);
    opencl_close(&device);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(what_is_remembered_is_recalled);
    RUN_TEST(classes_and_devices_are_kept_apart);
    RUN_TEST(the_folder_is_the_services_or_the_users);
    RUN_TEST(damaged_files_tell_nothing_and_are_replaced);
    RUN_TEST(a_place_that_cannot_be_written_is_named);
    RUN_TEST(the_least_time_decides);
    RUN_TEST(a_trial_measures_every_class);
    return UNITY_END();
}
