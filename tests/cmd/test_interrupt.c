/* Ctrl-C in the middle of long work: exit status 130, whole files only, and the work can be taken up again. */
#include "tests/cmd/made.h"
#include "tests/cmd/spawn.h"
#include "tests/cmd/stations.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

enum { STOPPED = 130 };

static const char *nacre;
static char *folder;

void setUp(void)
{
    folder = folder_make();
}

void tearDown(void)
{
    folder_remove(folder);
}

static struct spawned run(const struct circumstances *around, const char *const *arguments)
{
    return spawn(arguments, around);
}

#define RUN(around, ...) run(around, (const char *const[]){nacre, __VA_ARGS__, NULL})

static bool has_temporary_files(void)
{
    char *names = folder_describe(folder);
    bool found = strstr(names, ".part-") != NULL;
    free(names);
    return found;
}

/* Iterations without end; the signal comes long before. */
static void factor_stops_and_leaves_what_was_there(void)
{
    char *scan = path_join(folder, "scan.exr");
    char *material = path_join(folder, "material.exr");
    const struct circumstances soon = {.interrupt_ms = 2500};
    made_scan_write(scan);
    text_write(material, "precious");
    char *before = folder_describe(folder);
    struct spawned stopped =
        RUN(&soon, "factor", scan, "-o", material, "--terms", "2", "--iterations", "1000000");
    char *after = folder_describe(folder);
    TEST_ASSERT_EQUAL_INT_MESSAGE(STOPPED, stopped.status, stopped.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(stopped.errors, "stopped"), stopped.errors);
    TEST_ASSERT_EQUAL_STRING(before, after);
    spawned_finish(&stopped);
    free(before);
    free(after);
    free(scan);
    free(material);
}

/* The lines of a description of two session folders that tell of raw frames must agree but for the folder's name. */
static char *describe_frames(const char *session)
{
    char *frames = path_join(session, "frames");
    char *text = folder_describe(frames);
    size_t length = strlen(session);
    for (char *found = text; (found = strstr(found, session));) {
        memmove(found, found + length, strlen(found + length) + 1);
    }
    free(frames);
    return text;
}

static void a_stopped_scan_resumes_to_what_it_would_have_been(void)
{
    char *station = path_join(folder, "station.yaml");
    char *stopped = path_join(folder, "stopped");
    char *whole = path_join(folder, "whole");
    char *seventh = path_join(stopped, "frames/000007.exr");
    const struct circumstances midway = {.interrupt_path = seventh};
    stations_write(folder);
    struct spawned first = RUN(&midway, "scan", stopped, "--station", station);
    char *half = describe_frames(stopped);
    TEST_ASSERT_EQUAL_INT_MESSAGE(STOPPED, first.status, first.errors);
    TEST_ASSERT_FALSE(has_temporary_files());
    struct spawned second = RUN(NULL, "scan", stopped, "--resume");
    struct spawned third = RUN(NULL, "scan", whole, "--station", station);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, second.status, second.errors);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, third.status, third.errors);
    char *resumed = describe_frames(stopped);
    char *uninterrupted = describe_frames(whole);
    TEST_ASSERT_TRUE_MESSAGE(strlen(half) < strlen(resumed), "the scan was done before the signal");
    TEST_ASSERT_EQUAL_STRING(uninterrupted, resumed);
    spawned_finish(&first);
    spawned_finish(&second);
    spawned_finish(&third);
    free(half);
    free(resumed);
    free(uninterrupted);
    free(station);
    free(stopped);
    free(whole);
    free(seventh);
}

int main(int argc, char **argv)
{
    if (argc != 2) {
        (void)fprintf(stderr, "usage: %s NACRE\n", argv[0]);
        return 2;
    }
    nacre = argv[1];
    UNITY_BEGIN();
    RUN_TEST(factor_stops_and_leaves_what_was_there);
    RUN_TEST(a_stopped_scan_resumes_to_what_it_would_have_been);
    return UNITY_END();
}
