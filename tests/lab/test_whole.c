/* A whole scan by `nacre scan` with V4L2 camera, EGL projector and GPIO trigger together, in which the camera sees the
 * screen: the same frames and responses as of a virtual station, whatever goes wrong on the way. */
#include "gpio_sim.h"
#include "guest.h"
#include "tests/cmd/frames.h"
#include "tests/cmd/told.h"
#include "tests/files.h"
#include "unity.h"
#include "whole.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const names[] = {"shutter", NULL};
static const struct whole_event nothing;
static const struct whole_station station = {
    .tolerance_ms = 20,
    .stamp_delay_ms = 10,
    .trigger = "{driver: gpio, gpio: {output: {line: shutter}, jitter_us: 900000}}"};
static struct whole whole;
static struct gpio_sim chip;

void setUp(void)
{
}

void tearDown(void)
{
    whole_end(&whole);
}

static void plug_camera(void)
{
    whole_plug_camera(&whole, &chip, NULL);
}

static void plug_trigger(void)
{
    chip = gpio_sim_plug("lines", 2, names);
}

static void virtual_scan_is_measured(void)
{
    whole_scan_virtual();
}

/* Frames were taken again by these causes, and at most two that were late in earnest, as the guest's clock is the host's
 * while it waits. */
static void expect_retakes(const struct whole_outcome *outcome, int late, int early, int lost,
                           int gap)
{
    int slow = told_count(outcome->output, "retaken.late") - late;
    TEST_ASSERT_TRUE_MESSAGE(slow >= 0 && slow <= 2, outcome->output);
    TEST_ASSERT_EQUAL_INT(early, told_count(outcome->output, "retaken.early"));
    TEST_ASSERT_EQUAL_INT(lost, told_count(outcome->output, "retaken.lost"));
    TEST_ASSERT_EQUAL_INT(gap, told_count(outcome->output, "retaken.gap"));
    TEST_ASSERT_EQUAL_INT_MESSAGE(late + early + lost + gap + slow,
                                  told_count(outcome->output, "retries"), outcome->output);
}

static void camera_sees_what_the_projector_shows(void)
{
    static const char session[] = WHOLE "/sound";
    struct whole_outcome outcome = whole_scan(&whole, session, "3", nothing);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, outcome.status, outcome.errors);
    expect_retakes(&outcome, 0, 0, 0, 0);
    TEST_ASSERT_EQUAL_INT(WHOLE_EXPOSURES, told_count(outcome.output, "frames"));
    TEST_ASSERT_EQUAL_INT(2, outcome.asked);
    whole_expect_same_as_virtual(session);
    printf("whole scan: %d patterns, %d pulses, %.1f s of the guest\n", WHOLE_PATTERNS,
           outcome.pulses, outcome.seconds);
    whole_outcome_finish(&outcome);
}

/* And the person forgets to take the layer off. */
static void frames_that_go_wrong_are_taken_again(void)
{
    static const struct feeder_injection injections[] = {
        {6, FEEDER_LATE},      {13, FEEDER_DAMAGED}, {17, FEEDER_PREVIOUS}, {22, FEEDER_LOST},
        {27, FEEDER_REPEATED}, {33, FEEDER_SKIPPED}, {38, FEEDER_TORN},     {42, FEEDER_PREVIOUS},
        {43, FEEDER_LATE},     {0, FEEDER_SOUND}};
    static const char session[] = WHOLE "/faulty";
    whole.feeder.pulses = 0;
    whole.feeder.injected = 0;
    whole.feeder.injections = injections;
    whole.forgets = 2;
    struct whole_outcome outcome = whole_scan(&whole, session, "3", nothing);
    whole.feeder.injections = NULL;
    whole.forgets = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, outcome.status, outcome.errors);
    TEST_ASSERT_EQUAL_INT(9, whole.feeder.injected);
    TEST_ASSERT_EQUAL_INT_MESSAGE(3, outcome.asked, outcome.errors);
    expect_retakes(&outcome, 2, 2, 3, 2);
    TEST_ASSERT_EQUAL_INT(WHOLE_EXPOSURES, told_count(outcome.output, "frames"));
    whole_expect_same_as_virtual(session);
    printf("9 faults injected and their frames taken again, a forgotten layer asked for again, "
           "%.1f s of the guest\n",
           outcome.seconds);
    whole_outcome_finish(&outcome);
}

static double delay_of(const json_t *root, const char *which)
{
    const json_t *figure = json_object_get(json_object_get(root, "delays"), which);
    const json_t *median = json_object_get(figure, "median_ms");
    TEST_ASSERT_TRUE_MESSAGE(json_is_number(median), which);
    return json_number_value(median);
}

/* The camera's stamps come 10 ms late, which the file denies; pulses in the emulated machine are some milliseconds off.
 * The screen changes within an exposure of its flip. Whether delays are as they should be is not asked here. */
static void doctor_measures_delays_and_stores_them(void)
{
    static const char path[] = WHOLE "/ill.yaml";
    static const char *const arguments[] = {NACRE,     "doctor", "--station", path, "--store",
                                            "--flips", "10",     "--json",    NULL};
    struct whole_station ill = station;
    size_t size = 0;
    ill.stamp_delay_ms = 0;
    whole_write_station(&whole, path, &ill);
    feeder_lay_white(&whole.feeder, true);
    whole.feeder.exposures_ns[1] = 100000000;
    struct whole_outcome outcome = whole_run(&whole, arguments, nothing);
    feeder_lay_white(&whole.feeder, false);
    whole.feeder.exposures_ns[1] = 200000000;
    json_t *root = json_loads(outcome.output, 0, NULL);
    TEST_ASSERT_NOT_NULL_MESSAGE(root, outcome.errors);
    double stamps_ms = delay_of(root, "stamps");
    double latency_ms = delay_of(root, "latency");
    char *stored = (char *)file_read(path, &size);
    printf("doctor: stamps %.2f ms late, light %.2f ms after a flip, %.1f s of the guest\n",
           stamps_ms, latency_ms, outcome.seconds);
    TEST_ASSERT_DOUBLE_WITHIN(8, 10, stamps_ms);
    TEST_ASSERT_TRUE(latency_ms >= 0 && latency_ms <= 100);
    TEST_ASSERT_NOT_NULL(strstr(stored, "# my station"));
    const char *kept = strstr(stored, "stamp_delay_ms: ");
    TEST_ASSERT_NOT_NULL_MESSAGE(kept, stored);
    TEST_ASSERT_DOUBLE_WITHIN(0.001, stamps_ms, strtod(kept + strlen("stamp_delay_ms: "), NULL));
    json_decref(root);
    free(stored);
    whole_outcome_finish(&outcome);
}

static bool unplug_camera(void)
{
    feeder_unplug(&whole.feeder);
    return true;
}

static bool unplug_trigger(void)
{
    gpio_sim_unplug(&chip);
    return true;
}

static bool unplug_projector(void)
{
    guest_write(whole.screen.status, "off");
    return true;
}

/* The scan stops with a message about the device, and keeps what it has. */
static int expect_stop(const char *session, struct whole_event event, const char *message)
{
    int before = session_files_count(session).patterns;
    struct whole_outcome outcome = whole_scan(&whole, session, "1", event);
    int kept = session_files_count(session).patterns;
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, outcome.status, outcome.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(outcome.errors, message), outcome.errors);
    TEST_ASSERT_TRUE(kept > before && kept < WHOLE_PATTERNS);
    TEST_ASSERT_EQUAL_INT(0, session_files_count(session).unfinished);
    const char *said = strstr(outcome.errors, "nacre scan: ");
    printf("unplugged: %.1f s, %d patterns kept: %s", outcome.seconds, kept,
           said ? said : outcome.errors);
    whole_outcome_finish(&outcome);
    return kept;
}

static void scan_whose_devices_are_unplugged_is_resumed(void)
{
    static const char session[] = WHOLE "/unplugged";
    (void)expect_stop(session, (struct whole_event){9, unplug_camera}, "camera /dev/video0");
    feeder_finish(&whole.feeder);
    plug_camera();
    (void)expect_stop(session, (struct whole_event){9, unplug_trigger}, "GPIO");
    plug_trigger();
    int kept =
        expect_stop(session, (struct whole_event){9, unplug_projector}, "projector Virtual-1");
    guest_write(whole.screen.status, "on");
    struct whole_outcome outcome = whole_scan(&whole, session, "3", nothing);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, outcome.status, outcome.errors);
    TEST_ASSERT_EQUAL_INT(kept, told_count(outcome.output, "measured_before"));
    TEST_ASSERT_EQUAL_INT(WHOLE_PATTERNS - kept, told_count(outcome.output, "patterns"));
    whole_expect_same_as_virtual(session);
    whole_outcome_finish(&outcome);
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    guest_run("modprobe -r vkms v4l2loopback");
    whole.screen = screen_plug("vkms", "vkms");
    plug_trigger();
    whole_write(&whole, &station);
    RUN_TEST(virtual_scan_is_measured);
    plug_camera();
    RUN_TEST(camera_sees_what_the_projector_shows);
    RUN_TEST(doctor_measures_delays_and_stores_them);
    RUN_TEST(frames_that_go_wrong_are_taken_again);
    RUN_TEST(scan_whose_devices_are_unplugged_is_resumed);
    return UNITY_END();
}
