/* Tests of nacre plan: from a pilot to a plan, and to responses scanned by it. */
#include "tests/cmd/spawn.h"
#include "tests/cmd/stations.h"
#include "tests/cmd/told.h"
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char *folder, *station, *pilot, *plan;
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
    (void)unlink(plan); /* most tests make none */
}

/* Run a verb with up to eight more arguments; printed JSON becomes `result`. */
static void run(const char *verb, const char *operand, const char *const more[8])
{
    const char *arguments[14] = {NACRE, verb, operand};
    size_t count = 3;
    for (int i = 0; i < 8 && more[i]; i++) {
        arguments[count++] = more[i];
    }
    arguments[count++] = "--json";
    json_decref(result);
    spawned_finish(&ran);
    ran = spawn(arguments, NULL);
    result = ran.status == 0 ? json_loads(ran.output, 0, NULL) : NULL;
}

static void must_run(const char *verb, const char *operand, const char *const more[8])
{
    run(verb, operand, more);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(result, ran.output);
}

/* The mean error of a session's responses against the exact ones. */
static double error_of(const char *session, const char *exact)
{
    char *scan = path_join(folder, "developed.exr");
    must_run("develop", session, (const char *const[8]){"-o", scan});
    must_run("error", exact, (const char *const[8]){scan});
    free(scan);
    return told_number(result, "mean");
}

static void adapted_plan_is_as_good_in_a_third_of_the_time(void)
{
    char *fixed = path_join(folder, "fixed");
    char *adapted = path_join(folder, "adapted");
    char *exact = path_join(folder, "exact.exr");
    char *sample = path_join(folder, "sample.yaml");
    must_run("simulate", sample, (const char *const[8]){"-o", exact, "--window", "11"});
    must_run("scan", fixed, (const char *const[8]){"--station", station});
    double whole = told_number(result, "station_seconds");
    must_run("plan", pilot,
             (const char *const[8]){"-o", plan, "--window=11", "--noise=5%", "--tails=10%",
                                    "--overlap=10%"});
    const json_t *told = json_object_get(result, "adapted");
    double foretold = told_number(result, "station_seconds");
    double noise = told_number(told, "noise_worst");
    TEST_ASSERT_TRUE(noise <= 0.05 && told_number(told, "tails_worst") <= 0.1);
    TEST_ASSERT_TRUE(told_number(told, "widest") < 11); /* else nothing overlaps */
    must_run("scan", adapted, (const char *const[8]){"--station", station, "--plan", plan});
    double took = told_number(result, "station_seconds");
    /* What is foretold is exposing alone; each of its two to four exposures has an overhead below a turn. */
    TEST_ASSERT_TRUE(took >= foretold && took < 2 * foretold);
    TEST_ASSERT_TRUE(took < whole / 3);
    double all = error_of(fixed, exact);
    /* Noise adds in squares. A tenth of the light lies among neighbours at most, on half of the entries; nine tenths of it go
     * where they belong (test_share.c): 1 % more. */
    TEST_ASSERT_TRUE(error_of(adapted, exact) < sqrt(all * all + noise * noise + 1e-4));
    free(fixed);
    free(adapted);
    free(exact);
    free(sample);
}

static void without_noise_the_exposures_stay(void)
{
    must_run("plan", pilot, (const char *const[8]){"-o", plan, "--leak=10%"});
    TEST_ASSERT_TRUE(json_is_null(json_object_get(result, "adapted")));
    size_t size = 0;
    char *text = (char *)file_read(plan, &size);
    TEST_ASSERT_NOT_NULL(text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "exposure_turns: [1, 8, 60]"), text);
    TEST_ASSERT_EQUAL_DOUBLE(told_number(result, "grid_spacing"), told_number(result, "window"));
    free(text);
}

static void refuses(const char *option, const char *value, const char *what)
{
    run("plan", pilot,
        (const char *const[8]){"-o", plan, "--noise=5%", "--leak=10%", option, value});
    TEST_ASSERT_EQUAL_INT(1, ran.status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(ran.errors, what), ran.errors);
    TEST_ASSERT_NOT_EQUAL(0, access(plan, F_OK));
}

static void what_cannot_be_planned_is_refused(void)
{
    refuses("--window", "8", "is even");
    refuses("--window", "13", "the pilot's own is 11");
    refuses("--within", "10ms", "no plan takes less than");
}

static void make_pilot(void)
{
    char *path = path_join(folder, "plan.yaml");
    char *pilot_plan = path_join(folder, "pilot.yaml");
    size_t size = 0;
    char *text = (char *)file_read(path, &size);
    char *fewer = NULL;
    if (text && asprintf(&fewer, "%sgrid_patterns: 30\n", text) > 0) {
        text_write(pilot_plan, fewer);
    }
    const char *const arguments[] = {NACRE,    "scan",     pilot,     "--station", station,
                                     "--plan", pilot_plan, "--quiet", NULL};
    struct spawned made = spawn(arguments, NULL);
    spawned_finish(&made); /* tests fail without it */
    free(path);
    free(pilot_plan);
    free(text);
    free(fewer);
}

int main(void)
{
    folder = folder_make();
    stations_write(folder);
    station = path_join(folder, "station.yaml");
    pilot = path_join(folder, "pilot");
    plan = path_join(folder, "adapted.yaml");
    make_pilot();
    UNITY_BEGIN();
    RUN_TEST(adapted_plan_is_as_good_in_a_third_of_the_time);
    RUN_TEST(without_noise_the_exposures_stay);
    RUN_TEST(what_cannot_be_planned_is_refused);
    int failures = UNITY_END();
    free(station);
    free(pilot);
    free(plan);
    folder_remove(folder);
    return failures;
}
