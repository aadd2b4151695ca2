/* Tests of measuring projector latency and camera delay, on a virtual station whose own are known. */
#include "rig/latency.h"

#include "stage.h"
#include "unity.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { FLIPS = 24 };

/* What the mean of 480 pixels with a noise of 3 is wrong by, 0.14, is 0.06 % of the light's change and 0.02 ms of an
 * exposure of 33 ms; rounding to whole numbers is less. */
static const double bound_ms = 0.1;

static struct stage stage;
static struct station settings;
static struct virtual_station *station;
static struct devices devices;
static struct shifted_camera camera;
static struct latency_report report;
static struct nacre_error error;

/* A trigger that is locked to a wheel of 30 Hz, `phase_ns` after each turn. */
static struct {
    struct trigger base, *inner;
    int64_t phase_ns;
} locked;

static int fire_locked(struct trigger *base, int64_t exposure_ns, int64_t *trigger_ns,
                       struct nacre_error *failure)
{
    (void)base;
    int64_t turn_ns = devices.projector->period_ns;
    int64_t now_ns = clock_now_ns(devices.clock) - locked.phase_ns;
    clock_sleep_until_ns(devices.clock,
                         (now_ns + turn_ns - 1) / turn_ns * turn_ns + locked.phase_ns);
    return locked.inner->ops->fire(locked.inner, exposure_ns, trigger_ns, failure);
}

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
    if (station) {
        virtual_station_free(station);
        station = NULL;
        station_finish(&settings);
        stage_remove(&stage);
    }
}

static void set_up(const char *from, const char *to)
{
    char *text = text_replace(stage_station, from, to);
    stage_make(&stage, text, NULL);
    free(text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, station_read(stage.station, &settings, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, virtual_station_new(&settings, &station, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, virtual_station_tell_refreshes(station, &error));
    camera = shifted_camera(virtual_station_camera(station));
    devices = (struct devices){&camera.base, virtual_station_projector(station),
                               virtual_station_trigger(station), virtual_station_clock(station)};
}

static void measure(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, latency_measure(&devices, FLIPS, NULL, &report, &error),
                                  error.text);
}

static void latency_is_found(const char *latency, double expected_ms)
{
    char text[64];
    (void)snprintf(text, sizeof text, "latency_ms: %s", latency);
    set_up("latency_ms: 16", text);
    measure();
    TEST_ASSERT_DOUBLE_WITHIN(bound_ms, expected_ms, report.light.median_ms);
    TEST_ASSERT_TRUE(report.light.spread_ms < bound_ms);
    TEST_ASSERT_TRUE(report.light.count >= FLIPS / 2);
    TEST_ASSERT_DOUBLE_WITHIN(0.5, 33.3, report.exposure_ms);
}

static void latency_of_half_a_turn_is_found(void)
{
    latency_is_found("16", 16);
}

static void latency_of_several_turns_is_found(void)
{
    latency_is_found("123.4", 123.4);
}

static void latency_of_less_than_a_frame_sees_is_found(void)
{
    latency_is_found("5", 5);
}

static void no_latency_is_none(void)
{
    set_up("latency_ms: 16", "latency_ms: 0");
    measure();
    /* Frames cannot begin before the flip: it is between 0 and a twelfth of an exposure. */
    TEST_ASSERT_TRUE(report.light.median_ms >= 0);
    TEST_ASSERT_TRUE(report.light.median_ms <= 33.4 / 12);
}

/* A projector of which one flip fails and leaves what is there. */
static struct {
    struct projector base, *inner;
    int shown, fail_at;
} weak;

static int show_weakly(struct projector *projector, const uint8_t *levels, int64_t *flip_ns,
                       struct nacre_error *failure)
{
    (void)projector;
    return weak.shown++ == weak.fail_at
               ? nacre_fail(failure, "projector weak: did not flip")
               : weak.inner->ops->show(weak.inner, levels, flip_ns, failure);
}

static void trigger_locked_to_the_wheel_finds_it_too(void)
{
    static const struct trigger_ops ops = {.name = "locked", .fire = fire_locked};
    set_up("latency_ms: 16", "latency_ms: 40");
    locked.base.ops = &ops;
    locked.inner = devices.trigger;
    locked.phase_ns = 2000000;
    devices.trigger = &locked.base;
    measure();
    TEST_ASSERT_DOUBLE_WITHIN(bound_ms, 40, report.light.median_ms);
}

/* Exposures that begin just when the light changes see none or all of it, which tells the change to a twelfth of an exposure
 * each way. Where a flip failed, the next brings what is there already. */
static void flip_that_fails_does_not_make_the_latency_shorter(void)
{
    static const struct trigger_ops trigger_ops = {.name = "locked", .fire = fire_locked};
    static const struct projector_ops ops = {.name = "weak", .show = show_weakly};
    set_up("latency_ms: 16", "latency_ms: 43.3333333");
    locked.base.ops = &trigger_ops;
    locked.inner = devices.trigger;
    locked.phase_ns = 10000000;
    devices.trigger = &locked.base;
    weak.inner = devices.projector;
    weak.base = *weak.inner;
    weak.base.ops = &ops;
    weak.shown = 0;
    weak.fail_at = 2; /* the first to black, after the first look at black and white */
    devices.projector = &weak.base;
    measure();
    TEST_ASSERT_EQUAL_INT(1, report.lost);
    TEST_ASSERT_DOUBLE_WITHIN(33.4 / 12, 43.3, report.light.median_ms);
}

/* Colours one after the other: how much of a turn a colour has is not how much of the time. What that makes of it is less
 * than a third of a turn. */
static void colour_wheel_is_allowed_for(void)
{
    set_up("virtual:\n  seed: 5\n  projector: {contrast: 500, latency_ms: 16}",
           "virtual:\n  seed: 5\n  projector:\n    latency_ms: 16\n    wheel:\n      segments:\n"
           "        - {color: [1, 0, 0], angle_deg: 120}\n"
           "        - {color: [0, 1, 0], angle_deg: 120}\n"
           "        - {color: [0, 0, 1], angle_deg: 120}\n");
    measure();
    TEST_ASSERT_DOUBLE_WITHIN(33.3 / 3, 16, report.light.median_ms);
}

static void stamps_are_compared_with_triggers(void)
{
    set_up("latency_ms: 16", "latency_ms: 16");
    camera.shift_ns = 3210000;
    measure();
    TEST_ASSERT_EQUAL_INT(FLIPS, report.camera.count);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3.21, report.camera.median_ms);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, report.camera.spread_ms);
    TEST_ASSERT_DOUBLE_WITHIN(bound_ms, 16, report.light.median_ms); /* stamps have no part in it */
}

static void some_frames_may_be_lost(void)
{
    set_up("latency_ms: 16", "latency_ms: 16");
    camera.lose = 7;
    measure();
    TEST_ASSERT_EQUAL_INT((FLIPS + 2) / 7, report.lost);
    TEST_ASSERT_DOUBLE_WITHIN(bound_ms, 16, report.light.median_ms);
}

static void camera_that_loses_most_is_refused(void)
{
    set_up("latency_ms: 16", "latency_ms: 16");
    camera.lose = 3;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, latency_measure(&devices, FLIPS, NULL, &report, &error));
    TEST_ASSERT_EQUAL_STRING("camera faulty: lost", error.text);
}

static void camera_that_sees_nothing_is_refused(void)
{
    set_up("full_scale_s: 0.05", "full_scale_s: 500");
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, latency_measure(&devices, FLIPS, NULL, &report, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "does not see the projector"), error.text);
}

static void figure_is_of_all_values(void)
{
    double values[] = {5, 1, 3, 2, 4};
    struct latency_figure figure = latency_figure(values, 5);
    TEST_ASSERT_EQUAL_DOUBLE(3, figure.median_ms);
    TEST_ASSERT_EQUAL_DOUBLE(1, figure.least_ms);
    TEST_ASSERT_EQUAL_DOUBLE(5, figure.most_ms);
    TEST_ASSERT_EQUAL_DOUBLE(1, figure.spread_ms);
    TEST_ASSERT_EQUAL_DOUBLE(1.5, latency_figure(values, 2).median_ms);
    TEST_ASSERT_EQUAL_INT(0, latency_figure(values, 0).count);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(latency_of_half_a_turn_is_found);
    RUN_TEST(latency_of_several_turns_is_found);
    RUN_TEST(latency_of_less_than_a_frame_sees_is_found);
    RUN_TEST(no_latency_is_none);
    RUN_TEST(trigger_locked_to_the_wheel_finds_it_too);
    RUN_TEST(flip_that_fails_does_not_make_the_latency_shorter);
    RUN_TEST(colour_wheel_is_allowed_for);
    RUN_TEST(stamps_are_compared_with_triggers);
    RUN_TEST(some_frames_may_be_lost);
    RUN_TEST(camera_that_loses_most_is_refused);
    RUN_TEST(camera_that_sees_nothing_is_refused);
    RUN_TEST(figure_is_of_all_values);
    return UNITY_END();
}
