/* Tests of showing, exposing and matching on devices with faults. */
#include "rig/exposer.h"

#include "stage.h"
#include "unity.h"

#include <stdlib.h>
#include <string.h>

static struct stage stage;
static struct station settings;
static struct virtual_station *station;
static struct devices devices;
static struct shifted_camera camera;
static struct exposer exposer;
static struct exposure exposure;
static uint8_t levels[6 * 5];
static uint16_t raw[24 * 20];
static struct nacre_error error;

/* A projector that fails at its first `failures` patterns, and whose flips are told `late_ns` after they were. */
static struct {
    struct projector base, *inner;
    int failures;
    int64_t late_ns;
} projector;

static int show(struct projector *base, const uint8_t *shown, int64_t *flip_ns,
                struct nacre_error *failure)
{
    (void)base;
    if (projector.failures-- > 0) {
        return nacre_fail(failure, "projector faulty: no flip");
    }
    int status = projector.inner->ops->show(projector.inner, shown, flip_ns, failure);
    *flip_ns += projector.late_ns;
    return status;
}

/* A trigger that waits before its pulse, and fails at its first `failures`. */
static struct {
    struct trigger base, *inner;
    int failures;
    int64_t wait_ns;
} trigger;

static int fire(struct trigger *base, int64_t exposure_ns, int64_t *trigger_ns,
                struct nacre_error *failure)
{
    (void)base;
    struct clock *clock = devices.clock;
    clock_sleep_until_ns(clock, clock_now_ns(clock) + trigger.wait_ns);
    if (trigger.failures-- > 0) {
        return nacre_fail(failure, "trigger faulty: the pulse was late");
    }
    return trigger.inner->ops->fire(trigger.inner, exposure_ns, trigger_ns, failure);
}

void setUp(void)
{
    static const struct projector_ops projector_ops = {.name = "faulty", .show = show};
    static const struct trigger_ops trigger_ops = {.name = "faulty", .fire = fire};
    stage_make(&stage, NULL, NULL);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, station_read(stage.station, &settings, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, virtual_station_new(&settings, &station, &error));
    projector.inner = virtual_station_projector(station);
    projector.base = *projector.inner;
    projector.base.ops = &projector_ops;
    projector.failures = 0;
    projector.late_ns = 0;
    trigger.inner = virtual_station_trigger(station);
    trigger.base = (struct trigger){.ops = &trigger_ops};
    trigger.failures = 0;
    trigger.wait_ns = 0;
    camera = shifted_camera(virtual_station_camera(station));
    devices = (struct devices){&camera.base, &projector.base, &trigger.base,
                               virtual_station_clock(station)};
    exposer = (struct exposer){.devices = &devices, .retries = 2, .tolerance_ns = 2000000};
    exposure = (struct exposure){.exposure_ns = 33333333, .raw = raw};
}

void tearDown(void)
{
    virtual_station_free(station);
    station_finish(&settings);
    stage_remove(&stage);
}

static void must_show(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, exposer_show(&exposer, levels, &exposure.flip_ns, &error), error.text);
}

static void pattern_that_was_not_shown_is_shown_again(void)
{
    projector.failures = 2;
    must_show();
    TEST_ASSERT_EQUAL_INT(2, exposer.retaken[RETAKE_SHOW]);
    TEST_ASSERT_EQUAL_INT(2, exposer_retries(&exposer));
}

static void projector_that_shows_nothing_is_given_up(void)
{
    projector.failures = 3;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, exposer_show(&exposer, levels, &exposure.flip_ns, &error));
    TEST_ASSERT_EQUAL_STRING("projector faulty: no flip", error.text);
}

static void frame_triggered_before_its_pattern_was_shown_does_not_count(void)
{
    projector.late_ns = 1;
    exposer.retries = 0;
    must_show();
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, exposer_expose(&exposer, &exposure, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "triggered 1 ns before its pattern was on the glass"), error.text);
    TEST_ASSERT_EQUAL_INT(0, exposer.exposures);
}

/* The exposure before was 43.3 ms, so the second try begins late enough. */
static void and_is_taken_again(void)
{
    projector.late_ns = 40000000;
    must_show();
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exposer_expose(&exposer, &exposure, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT(1, exposer.retaken[RETAKE_UNSHOWN]);
    TEST_ASSERT_TRUE(exposure.trigger_ns >= exposure.flip_ns);
}

static int expose_shifted(int64_t shift_ns, bool free_running)
{
    camera.shift_ns = shift_ns;
    camera.base.free_running = free_running;
    exposer.retries = 0;
    must_show();
    return exposer_expose(&exposer, &exposure, &error);
}

static void triggered_frame_counts_within_the_tolerance_alone(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, expose_shifted(2000000, false), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, expose_shifted(2000001, false));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "began 2000001 ns after its trigger"),
                                 error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, expose_shifted(-2000000, false), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, expose_shifted(-2000001, false));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "began 2000001 ns before its trigger"),
                                 error.text);
}

static void free_frame_counts_however_late_but_never_early(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, expose_shifted(900000000, true), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, expose_shifted(0, true), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, expose_shifted(-1, true));
}

static void refused_pulse_is_given_again(void)
{
    trigger.failures = 2;
    must_show();
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exposer_expose(&exposer, &exposure, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT(2, exposer.retaken[RETAKE_TRIGGER]);
}

static void wait_for_the_trigger_is_accounted_for(void)
{
    trigger.wait_ns = 7000000;
    must_show();
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exposer_expose(&exposer, &exposure, &error));
    TEST_ASSERT_EQUAL_INT64(7000000, exposer.times.trigger_ns);
    TEST_ASSERT_EQUAL_INT64(33333333, exposer.times.exposing_ns);
    TEST_ASSERT_EQUAL_INT64(10000000, exposer.times.readout_ns);
}

static void checks_are_accounted_for_apart(void)
{
    int64_t began_ns = clock_now_ns(devices.clock);
    exposer.checking = true;
    must_show();
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exposer_expose(&exposer, &exposure, &error));
    TEST_ASSERT_EQUAL_INT64(clock_now_ns(devices.clock) - began_ns, exposer.times.checks_ns);
    TEST_ASSERT_EQUAL_INT64(0, exposer.times.flip_ns + exposer.times.exposing_ns);
    TEST_ASSERT_EQUAL_INT(0, exposer.exposures);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(pattern_that_was_not_shown_is_shown_again);
    RUN_TEST(projector_that_shows_nothing_is_given_up);
    RUN_TEST(frame_triggered_before_its_pattern_was_shown_does_not_count);
    RUN_TEST(and_is_taken_again);
    RUN_TEST(triggered_frame_counts_within_the_tolerance_alone);
    RUN_TEST(free_frame_counts_however_late_but_never_early);
    RUN_TEST(refused_pulse_is_given_again);
    RUN_TEST(wait_for_the_trigger_is_accounted_for);
    RUN_TEST(checks_are_accounted_for_apart);
    return UNITY_END();
}
