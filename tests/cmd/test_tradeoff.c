/* nacre tradeoff as a user runs it: a study of a small scan, and commands of its points copied and pasted. */
#include "tests/cmd/made.h"
#include "tests/cmd/spawn.h"
#include "tests/cmd/told.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <unity.h>

static char *folder, *scan, *output;

void setUp(void)
{
}

void tearDown(void)
{
}

static struct spawned study(const char *input, const char *to, const char *budget,
                            const struct circumstances *around)
{
    const char *const arguments[] = {NACRE,      "tradeoff", input,    "-o", to,
                                     "--budget", budget,     "--json", NULL};
    return spawn(arguments, around);
}

/* Run a command of the study in the folder, as pasted into a shell, with this program; its mean error. */
static double paste(const char *command)
{
    char *line = NULL;
    TEST_ASSERT_EQUAL_INT(0, strncmp(command, "nacre ", 6));
    if (asprintf(&line, "cd '%s' && '%s' %s --json", folder, NACRE, command + 6) < 0) {
        abort();
    }
    const char *const arguments[] = {"/bin/sh", "-c", line, NULL};
    struct spawned run = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    json_t *root = told_parse(run.output);
    double mean = told_number(root, "error.mean");
    json_decref(root);
    spawned_finish(&run);
    free(line);
    return mean;
}

/* The quickest and the most exact point, and one that was started from another, give the same error again: to the last
 * bit, as the same scan, options and device do. JSON holds 17 digits. */
static void points_can_be_repeated_by_copy_and_paste(void)
{
    struct spawned run = study(scan, output, "8s", NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    json_t *root = told_parse(run.output);
    char *here = getcwd(NULL, 0);
    TEST_ASSERT_EQUAL_STRING(here, json_string_value(json_object_get(root, "run_in")));
    free(here);
    const json_t *points = json_object_get(root, "points"), *point = NULL;
    const json_t *quickest = NULL, *best = NULL, *started = NULL;
    size_t i = 0;
    json_array_foreach(points, i, point)
    {
        double error = told_number(point, "error");
        double seconds = told_number(point, "seconds");
        if (!best || error < told_number(best, "error")) {
            best = point;
        }
        if (!quickest || seconds < told_number(quickest, "seconds")) {
            quickest = point;
        }
        if (strstr(json_string_value(json_object_get(point, "command")), "--from")) {
            started = point;
        }
    }
    const json_t *const repeated[] = {quickest, best, started};
    TEST_ASSERT_NOT_NULL(best);
    TEST_ASSERT_TRUE(json_is_true(json_object_get(quickest, "quickest")));
    for (i = 0; i < 3; i++) {
        if (repeated[i]) { /* a slow machine may not come to the third */
            double error = paste(json_string_value(json_object_get(repeated[i], "command")));
            TEST_ASSERT_EQUAL_DOUBLE(told_number(repeated[i], "error"), error);
        }
    }
    json_decref(root);
    spawned_finish(&run);
}

static void the_folder_holds_table_and_page(void)
{
    static const char *const names[] = {"tradeoff.csv", "tradeoff.json", "tradeoff.html"};
    for (int i = 0; i < 3; i++) {
        char *path = path_join(output, names[i]);
        struct stat status;
        TEST_ASSERT_EQUAL_INT_MESSAGE(0, stat(path, &status), path);
        TEST_ASSERT_TRUE(status.st_size > 500);
        free(path);
    }
}

static void expect_failure(const char *input, const char *to, const char *budget, int status,
                           const char *text)
{
    char *before = folder_describe(folder);
    struct spawned run = study(input, to, budget, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(status, run.status, run.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.errors, text), run.errors);
    spawned_finish(&run);
    char *after = folder_describe(folder);
    TEST_ASSERT_EQUAL_STRING(before, after);
    free(before);
    free(after);
}

static void what_cannot_be_studied_is_refused_before_the_work(void)
{
    char *missing = path_join(folder, "missing.exr"), *inside = path_join(scan, "out");
    char *deep = path_join(folder, "none/deeper");
    expect_failure(missing, output, "1s", 1, "missing.exr");
    expect_failure(scan, inside, "1s", 1, "cannot make the folder");
    expect_failure(scan, deep, "1s", 1, "cannot make the folder");
    expect_failure(scan, scan, "1s", 1, "is a file");
    expect_failure(scan, output, "soon", 2, "--budget");
    /* of which reading the scan takes more */
    expect_failure(scan, output, "1ms", 1, "too short for a single factorization");
    free(missing);
    free(inside);
    free(deep);
}

static void stopping_leaves_what_was_found(void)
{
    char *stopped = path_join(folder, "stopped"), *page = path_join(stopped, "tradeoff.html");
    const struct circumstances around = {.interrupt_path = stopped, .interrupt_ms = 3000};
    struct spawned run = study(scan, stopped, "100s", &around);
    TEST_ASSERT_EQUAL_INT_MESSAGE(130, run.status, run.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.errors, "stopped on request"), run.errors);
    /* Before the first point there is nothing to leave. */
    TEST_ASSERT_EQUAL_INT(strstr(run.errors, "holds what") ? 0 : -1, access(page, F_OK));
    spawned_finish(&run);
    free(page);
    free(stopped);
}

int main(void)
{
    folder = folder_make();
    scan = path_join(folder, "it's a scan.exr");
    output = path_join(folder, "study");
    made_scan_write(scan);
    UNITY_BEGIN();
    RUN_TEST(points_can_be_repeated_by_copy_and_paste);
    RUN_TEST(the_folder_holds_table_and_page);
    RUN_TEST(what_cannot_be_studied_is_refused_before_the_work);
    RUN_TEST(stopping_leaves_what_was_found);
    free(scan);
    free(output);
    folder_remove(folder);
    return UNITY_END();
}
