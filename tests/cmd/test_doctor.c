/* Tests of nacre doctor on virtual stations and on stations whose devices are not there. */
#include "tests/cmd/spawn.h"
#include "tests/cmd/stations.h"
#include "tests/cmd/told.h"
#include "unity.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static char *folder, *station;
static struct spawned ran;

void setUp(void)
{
    folder = folder_make();
    stations_write(folder);
    station = path_join(folder, "station.yaml");
}

void tearDown(void)
{
    spawned_finish(&ran);
    free(station);
    folder_remove(folder);
}

static void visit(const char *more)
{
    const char *const arguments[] = {NACRE,     "doctor", "--station", station,
                                     "--flips", "12",     more,        NULL};
    ran = spawn(arguments, NULL);
}

/* The verdict of the first check called `name`. */
static const char *verdict_of(const json_t *root, const char *name)
{
    size_t i;
    json_t *check;
    json_array_foreach(json_object_get(root, "checks"), i, check)
    {
        if (strcmp(json_string_value(json_object_get(check, "check")), name) == 0) {
            return json_string_value(json_object_get(check, "verdict"));
        }
    }
    return "missing";
}

static void virtual_station_is_well_and_its_latency_is_found(void)
{
    stations_change(station, "vignetting: 0.1}", "vignetting: 0.1, latency_ms: 21.5}");
    visit("--json");
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    json_t *root = told_parse(ran.output);
    const json_t *latency = json_object_get(json_object_get(root, "delays"), "latency");
    /* 7680 pixels tell a share to far less than a hundredth of a per cent: rounding to a hundredth of a turn is ample. */
    TEST_ASSERT_DOUBLE_WITHIN(0.3, 21.5, json_real_value(json_object_get(latency, "median_ms")));
    TEST_ASSERT_EQUAL_STRING("ok", verdict_of(root, "devices"));
    TEST_ASSERT_EQUAL_STRING("ok", verdict_of(root, "latency"));
    TEST_ASSERT_EQUAL_STRING("ok", verdict_of(root, "stamps"));
    TEST_ASSERT_EQUAL_STRING("ok", verdict_of(root, "disk"));
    json_decref(root);
}

static void checks_are_told_one_a_line(void)
{
    visit(NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    TEST_ASSERT_EQUAL_INT(0, strncmp(ran.output, "ok       devices    ready\n", 26));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(ran.output, "latency    the light changes"), ran.output);
}

static void devices_that_are_not_there_are_all_named(void)
{
    stations_change(station, "camera: {driver: virtual,",
                    "camera: {driver: v4l2, v4l2: {device: /dev/nonexistent-camera},");
    stations_change(station, "projector: {driver: virtual,",
                    "projector: {driver: egl, egl: {device: /dev/nonexistent-card},");
    stations_change(station, "trigger: {driver: virtual}",
                    "trigger: {driver: gpio, gpio: {output: {line: nonexistent-line}}}");
    visit("--json");
    TEST_ASSERT_EQUAL_INT(1, ran.status);
    json_t *root = told_parse(ran.output);
    TEST_ASSERT_EQUAL_STRING("wrong", verdict_of(root, "projector"));
    TEST_ASSERT_EQUAL_STRING("wrong", verdict_of(root, "camera"));
    TEST_ASSERT_EQUAL_STRING("wrong", verdict_of(root, "trigger"));
    TEST_ASSERT_EQUAL_STRING("warning", verdict_of(root, "delays"));
    TEST_ASSERT_TRUE(json_is_null(json_object_get(root, "delays")));
    TEST_ASSERT_NOT_NULL(strstr(ran.output, "/dev/nonexistent-camera"));
    TEST_ASSERT_NOT_NULL(strstr(ran.output, "/dev/nonexistent-card"));
    TEST_ASSERT_NOT_NULL(strstr(ran.output, "GPIO"));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(ran.errors, "3 of"), ran.errors);
    json_decref(root);
}

static void station_in_the_dark_is_wrong(void)
{
    stations_change(station, "pixels_per_point: 4}", "pixels_per_point: 4, full_scale_s: 900}");
    visit(NULL);
    TEST_ASSERT_EQUAL_INT(1, ran.status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(ran.output, "does not see the projector"), ran.output);
}

static void nothing_is_stored_of_virtual_devices(void)
{
    size_t before = 0;
    size_t after = 0;
    uint8_t *text = file_read(station, &before);
    visit("--store");
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(ran.output, "nothing to store"), ran.output);
    uint8_t *now = file_read(station, &after);
    TEST_ASSERT_EQUAL_STRING((char *)text, (char *)now);
    free(text);
    free(now);
}

static void station_is_needed(void)
{
    const char *const arguments[] = {NACRE, "doctor", NULL};
    ran = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT(2, ran.status);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(virtual_station_is_well_and_its_latency_is_found);
    RUN_TEST(checks_are_told_one_a_line);
    RUN_TEST(devices_that_are_not_there_are_all_named);
    RUN_TEST(station_in_the_dark_is_wrong);
    RUN_TEST(nothing_is_stored_of_virtual_devices);
    RUN_TEST(station_is_needed);
    return UNITY_END();
}
