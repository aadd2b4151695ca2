/* Ctrl-C in the middle of long work: exit status 130, whole files only, and the work can be taken up again. */
#include "nacre/material.h"
#include "tests/cmd/frames.h"
#include "tests/cmd/made.h"
#include "tests/cmd/spawn.h"
#include "tests/cmd/stations.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <unity.h>

enum { STOPPED = 130 };

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

#define RUN(around, ...) run(around, (const char *const[]){NACRE, __VA_ARGS__, NULL})

static bool has_temporary_files(void)
{
    char *names = folder_describe(folder);
    bool found = strstr(names, ".part-") != NULL;
    free(names);
    return found;
}

/* Updates without end, as they never quite settle; the signal comes long before. What stands at the output is then the
 * material so far, or, if the signal came before the first iteration, what was there. */
static void a_stopped_factorization_leaves_a_whole_material(void)
{
    char *scan = path_join(folder, "scan.exr");
    char *output = path_join(folder, "material.exr");
    const struct circumstances soon = {.interrupt_ms = 2500};
    struct nacre_material material = {0};
    struct nacre_error error = {""};
    size_t size = 0;
    made_scan_write(scan);
    text_write(output, "precious");
    struct spawned stopped = RUN(&soon, "factor", scan, "-o", output, "--method", "mu",
                                 "--tolerance", "0", "--iterations", "1000000");
    char *left = (char *)file_read(output, &size);
    TEST_ASSERT_EQUAL_INT_MESSAGE(STOPPED, stopped.status, stopped.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(stopped.errors, "stopped"), stopped.errors);
    TEST_ASSERT_FALSE(has_temporary_files());
    if (strcmp(left, "precious") != 0) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_read(output, &material, &error),
                                      error.text);
        TEST_ASSERT_TRUE(material.iterations > 0 && material.iterations < 1000000);
    }
    nacre_material_finish(&material);
    spawned_finish(&stopped);
    free(left);
    free(scan);
    free(output);
}

static char *frame_path(const char *session, int number)
{
    char name[32];
    (void)snprintf(name, sizeof name, "frames/%06d.exr", number);
    return path_join(session, name);
}

static int count_frames(const char *session)
{
    int count = 0;
    for (int i = 0; i < STATION_GRIDS; i++) {
        char *path = frame_path(session, i);
        count += access(path, F_OK) == 0;
        free(path);
    }
    return count;
}

/* Byte for byte, whatever depends on the station's time included: what the lamp gives at that moment, and which exposures are
 * taken twice. Between the two runs a file is lost, too. */
static void a_stopped_scan_resumes_to_what_it_would_have_been(void)
{
    char *station = path_join(folder, "station.yaml");
    char *stopped = path_join(folder, "stopped");
    char *whole = path_join(folder, "whole");
    char *seventh = frame_path(stopped, 7);
    const struct circumstances midway = {.interrupt_path = seventh};
    stations_write_restless(folder);
    struct spawned first = RUN(&midway, "scan", stopped, "--station", station);
    TEST_ASSERT_EQUAL_INT_MESSAGE(STOPPED, first.status, first.errors);
    TEST_ASSERT_FALSE(has_temporary_files());
    TEST_ASSERT_TRUE_MESSAGE(count_frames(stopped) < STATION_GRIDS, "done before the signal");
    TEST_ASSERT_EQUAL_INT(0, unlink(seventh));
    struct spawned second = RUN(NULL, "scan", stopped, "--resume");
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, second.status, second.errors);
    struct spawned third = RUN(NULL, "scan", whole, "--station", station);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, third.status, third.errors);
    frames_expect_same(whole, stopped);
    spawned_finish(&first);
    spawned_finish(&second);
    spawned_finish(&third);
    free(station);
    free(stopped);
    free(whole);
    free(seventh);
}

/* A povray that closes the terminal behind the picture: nothing of it may stay in the folder for temporary files. */
static void a_terminal_that_closes_leaves_no_temporary_folder(void)
{
    const char *path = getenv("PATH"), *temporary = getenv("TMPDIR");
    char *scene = path_join(folder, "scene.yaml"), *below = path_join(folder, "below");
    char *output = path_join(folder, "picture.png"), *povray = path_join(folder, "povray");
    char *old_path = strdup(path ? path : ""), *old_temporary = strdup(temporary ? temporary : "");
    char *new_path = NULL;
    TEST_ASSERT_TRUE(asprintf(&new_path, "%s:%s", folder, old_path) > 0);
    TEST_ASSERT_EQUAL_INT(0, mkdir(below, 0700));
    text_write(scene, "image: {width: 16, height: 12}\n"
                      "camera: {position_mm: [0, -90, 40], at_mm: [0, 0, 0]}\n"
                      "lights: [{kind: point, position_mm: [10, 5, 60]}]\n"
                      "objects: [{shape: quad, size_mm: [40, 40, 1], color: 0.8}]\n");
    text_write(povray,
               "#!/bin/sh\nls > ../seen\nkill -HUP $PPID\nkill -HUP $PPID\nexec sleep 60\n");
    TEST_ASSERT_EQUAL_INT(0, chmod(povray, 0700));
    (void)setenv("PATH", new_path, 1);
    (void)setenv("TMPDIR", below, 1);
    struct spawned stopped = RUN(NULL, "render", scene, "-o", output);
    (void)setenv("PATH", old_path, 1);
    (void)(temporary ? setenv("TMPDIR", old_temporary, 1) : unsetenv("TMPDIR"));
    TEST_ASSERT_EQUAL_INT_MESSAGE(STOPPED, stopped.status, stopped.errors);
    char *seen = path_join(below, "seen");
    size_t size = 0;
    char *names = (char *)file_read(seen, &size);
    TEST_ASSERT_NOT_NULL(names);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(names, "scene.pov"), names);
    TEST_ASSERT_EQUAL_INT(0, unlink(seen));
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, rmdir(below), "something was left");
    TEST_ASSERT_TRUE(access(output, F_OK) != 0);
    spawned_finish(&stopped);
    free(names);
    free(seen);
    free(scene);
    free(below);
    free(output);
    free(povray);
    free(old_path);
    free(old_temporary);
    free(new_path);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(a_stopped_factorization_leaves_a_whole_material);
    RUN_TEST(a_stopped_scan_resumes_to_what_it_would_have_been);
    RUN_TEST(a_terminal_that_closes_leaves_no_temporary_folder);
    return UNITY_END();
}
