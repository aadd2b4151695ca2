/* Tests of what nacre scan tells of a scan, and of calibrations that it uses again. */
#include "tests/cmd/spawn.h"
#include "tests/cmd/stations.h"
#include "tests/cmd/told.h"
#include "unity.h"

#include <stdlib.h>
#include <string.h>

/* Of the plan: 2 white, 4 dots, 16 black. */
enum { CALIBRATION = 6, ALL = CALIBRATION + 16 + STATION_GRIDS, EXPOSURES = 3 };

static char *folder, *station, *first, *second;
static struct spawned ran;
static json_t *result;

void setUp(void)
{
    ran = (struct spawned){0};
    result = NULL;
}

void tearDown(void)
{
    json_decref(result);
    spawned_finish(&ran);
}

static void scan(const char *session, const char *option, const char *value)
{
    const char *const arguments[] = {NACRE,    "scan", session, "--station", station,
                                     "--json", option, value,   NULL};
    ran = spawn(arguments, NULL);
    if (ran.status == 0) {
        result = told_parse(ran.output);
    }
}

static int count(const char *key)
{
    return told_count(ran.output, key);
}

/* Exposures of 1, 8 and 60 turns at 30 Hz. */
static void time_of_a_scan_is_accounted_for(void)
{
    double sum = 0;
    const char *key;
    json_t *value;
    scan(first, NULL, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    TEST_ASSERT_EQUAL_INT(ALL, count("patterns"));
    TEST_ASSERT_EQUAL_INT(ALL * EXPOSURES, count("frames"));
    json_object_foreach(json_object_get(result, "seconds"), key, value)
    {
        TEST_ASSERT_TRUE_MESSAGE(json_real_value(value) >= 0, key);
        sum += json_real_value(value);
    }
    double station_s = json_real_value(json_object_get(result, "station_seconds"));
    double exposing_s =
        json_real_value(json_object_get(json_object_get(result, "seconds"), "exposing"));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, station_s, sum);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, ALL * 69 / 30., exposing_s);
    double overhead = json_real_value(json_object_get(result, "overhead_turns"));
    TEST_ASSERT_TRUE(overhead >= 0 && overhead <= 1);
    json_object_foreach(json_object_get(result, "retaken"), key, value)
    {
        TEST_ASSERT_EQUAL_INT_MESSAGE(0, json_integer_value(value), key);
    }
}

static void dry_run_leaves_out_what_is_taken_over(void)
{
    const char *const arguments[] = {NACRE,       "scan",          second, "--station", station,
                                     "--dry-run", "--calibration", first,  "--json",    NULL};
    ran = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    result = told_parse(ran.output);
    TEST_ASSERT_EQUAL_INT(ALL - CALIBRATION, count("patterns_to_measure"));
    TEST_ASSERT_EQUAL_INT((ALL - CALIBRATION) * EXPOSURES, count("frames_to_take"));
}

static void calibration_is_taken_over(void)
{
    scan(second, "--calibration", first);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    TEST_ASSERT_EQUAL_INT(CALIBRATION, count("taken_over"));
    TEST_ASSERT_EQUAL_INT(ALL - CALIBRATION, count("patterns"));
    TEST_ASSERT_TRUE(json_real_value(json_object_get(result, "moved_px")) < 0.1);
}

/* Refused before anything is made. */
static void calibration_of_another_station_is_refused(void)
{
    size_t size = 0;
    char *third = path_join(folder, "third");
    char *text = (char *)file_read(station, &size);
    char *place = strstr(text, "elevation_deg: 12");
    TEST_ASSERT_NOT_NULL(place);
    place[strlen("elevation_deg: 1")] = '3';
    text_write(station, text);
    scan(third, "--calibration", first);
    TEST_ASSERT_EQUAL_INT(1, ran.status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(ran.errors, "elevation_deg differs"), ran.errors);
    TEST_ASSERT_NULL(file_read(third, &size));
    char *listing = folder_describe(folder);
    TEST_ASSERT_NULL(strstr(listing, "third"));
    free(listing);
    free(text);
    free(third);
}

int main(void)
{
    folder = folder_make();
    stations_write(folder);
    station = path_join(folder, "station.yaml");
    first = path_join(folder, "first");
    second = path_join(folder, "second");
    UNITY_BEGIN();
    RUN_TEST(time_of_a_scan_is_accounted_for);
    RUN_TEST(dry_run_leaves_out_what_is_taken_over);
    RUN_TEST(calibration_is_taken_over);
    RUN_TEST(calibration_of_another_station_is_refused);
    int status = UNITY_END();
    free(first);
    free(second);
    free(station);
    folder_remove(folder);
    return status;
}
