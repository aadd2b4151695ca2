/* Tests of the virtual projector's parts: lamp, colour wheel and defocus. */
#include "rig/virtual/lamp.h"
#include "rig/virtual/spread.h"
#include "rig/virtual/wheel.h"

#include "unity.h"

#include <math.h>
#include <string.h>

void setUp(void)
{
}

void tearDown(void)
{
}

static const int64_t HOUR_NS = 3600000000000;

static void lamp_drifts_smoothly_with_the_stated_deviation(void)
{
    const struct virtual_lamp lamp = {.drift = 0.02, .drift_hours = 0.5};
    enum { COUNT = 4000 };
    double sum = 0;
    double squares = 0;
    for (int i = 0; i < COUNT; i++) {
        /* At the moments themselves, where values are the normal variates. */
        double value = lamp_drift(&lamp, 7, i * HOUR_NS / 2, i * HOUR_NS / 2 + 1000);
        sum += value;
        squares += value * value;
    }
    /* 5 standard deviations of a mean, s / sqrt(n), and of a variance, s^2 sqrt(2 / n). */
    TEST_ASSERT_DOUBLE_WITHIN(5 * 0.02 / sqrt(COUNT), 0, sum / COUNT);
    TEST_ASSERT_DOUBLE_WITHIN(5 * 0.0004 * sqrt(2. / COUNT), 0.0004, squares / COUNT);
    /* The step's slope is at most 1.5, and hardly two values differ by more than 6 deviations: 0.18 a moment. */
    double before = lamp_drift(&lamp, 7, 0, 1000);
    for (int64_t time_ns = HOUR_NS / 100; time_ns < 4 * HOUR_NS; time_ns += HOUR_NS / 100) {
        double now = lamp_drift(&lamp, 7, time_ns, time_ns + 1000);
        TEST_ASSERT_DOUBLE_WITHIN(0.18 / 50, before, now);
        before = now;
    }
}

/* The mean of an exposure is that of its parts, weighed by their lengths; of a part by a sum over short ones. */
static void lamp_is_integrated_exactly_over_an_exposure(void)
{
    const struct virtual_lamp lamp = {.flicker = 0.01, .flicker_hz = 100};
    enum { PARTS = 2000 };
    const int64_t begin_ns = 1234567;
    const int64_t length_ns = 47 * 1000000;
    double sum = 0;
    for (int i = 0; i < PARTS; i++) {
        int64_t from_ns = begin_ns + i * (length_ns / PARTS);
        sum += lamp_flicker(&lamp, 3, from_ns, from_ns + length_ns / PARTS);
    }
    /* Roundings of times near 5 moments in 53 bits, divided by parts of 1/400 of a moment: 1e-12 of 0.01. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-13, sum / PARTS,
                              lamp_flicker(&lamp, 3, begin_ns, begin_ns + length_ns));
}

static void lamp_depends_on_seed_and_time_alone(void)
{
    const struct virtual_lamp lamp = {.drift = 0.02, .drift_hours = 1};
    double value = lamp_drift(&lamp, 1, HOUR_NS, HOUR_NS + 1);
    TEST_ASSERT_EQUAL_DOUBLE(value, lamp_drift(&lamp, 1, HOUR_NS, HOUR_NS + 1));
    TEST_ASSERT_TRUE(value != lamp_drift(&lamp, 2, HOUR_NS, HOUR_NS + 1));
    TEST_ASSERT_TRUE(value != lamp_drift(&lamp, 1, 2 * HOUR_NS, 2 * HOUR_NS + 1));
}

static void drift_and_flicker_have_nothing_in_common(void)
{
    enum { COUNT = 4000 };
    const struct virtual_lamp lamp = {
        .drift = 1, .drift_hours = 1, .flicker = 1, .flicker_hz = 1. / 3600};
    double products = 0;
    for (int i = 0; i < COUNT; i++) {
        products += lamp_drift(&lamp, 7, i * HOUR_NS, i * HOUR_NS + 1000) *
                    lamp_flicker(&lamp, 7, i * HOUR_NS, i * HOUR_NS + 1000);
    }
    /* 5 standard deviations of a sample correlation, 1 / sqrt(n). */
    TEST_ASSERT_DOUBLE_WITHIN(5 / sqrt(COUNT), 0, products / COUNT);
}

static struct virtual_segment segments[3] = {{{1, 0, 0}, 90}, {{0, 1, 0.5}, 180}, {{0, 0, 1}, 90}};

static struct wheel make_wheel(double phase_deg)
{
    const struct virtual_wheel settings = {
        .segments = segments, .segment_count = 3, .phase_deg = phase_deg};
    struct wheel wheel;
    wheel_init(&settings, 50, &wheel); /* 20 ms a turn */
    return wheel;
}

static void check_gains(const struct wheel *wheel, int64_t begin_ns, int64_t exposure_ns, double r,
                        double g, double b)
{
    double gains[3];
    TEST_ASSERT_TRUE(wheel_gains(wheel, begin_ns, exposure_ns, gains));
    /* Some roundings of numbers near 1. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, r, gains[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, g, gains[1]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, b, gains[2]);
}

/* Relative to white, red is 4 in the first quarter, green 2 in the half in the middle, and blue, of which the turn's mean
 * is (0.5 x 0.5 + 0.25) = 0.5, is 1 in the middle and 2 in the last quarter. */
static void wheel_gives_exposures_the_overlap_with_its_segments(void)
{
    struct wheel wheel = make_wheel(0);
    check_gains(&wheel, 0, 5000000, 4, 0, 0);
    check_gains(&wheel, 0, 10000000, 2, 1, 0.5);
    check_gains(&wheel, 12500000, 5000000, 0, 1, 0.5 + 1);
    check_gains(&wheel, 17500000, 5000000, 2, 0, 1); /* across the turn's end */
    check_gains(&wheel, 0, 30000000, 2. / 1.5, 1.5 / 1.5, 1.25 / 1.5);
    check_gains(&wheel, -10000000, 30000000, (1 + 0.) / 1.5, 1.5 / 1.5, (1 + 0.75) / 1.5);
    wheel = make_wheel(90);
    check_gains(&wheel, 0, 5000000, 0, 2, 1);
}

static void wheel_changes_nothing_in_whole_turns(void)
{
    struct wheel wheel = make_wheel(33);
    double gains[3];
    TEST_ASSERT_FALSE(wheel_gains(&wheel, 123456, 20000000, gains));
    TEST_ASSERT_FALSE(wheel_gains(&wheel, 123456, 240 * 20000000LL, gains));
    TEST_ASSERT_TRUE(wheel_gains(&wheel, 123456, 20000003, gains));
    TEST_ASSERT_TRUE(wheel_gains(&wheel, 123456, 1, gains));
}

enum { SIDE = 15, POINTS = SIDE * SIDE };

static double sum_of(const float *plane)
{
    double sum = 0;
    for (int i = 0; i < POINTS; i++) {
        sum += (double)plane[i];
    }
    return sum;
}

static void defocus_keeps_the_light_and_has_the_disc_s_variance(void)
{
    static const double diameters[] = {0.3, 1, 2.5, 6};
    for (int k = 0; k < 4; k++) {
        struct spread spread = {0};
        struct nacre_error error;
        float in[POINTS] = {0};
        float out[POINTS];
        double variance = 0;
        in[POINTS / 2] = 1;
        TEST_ASSERT_EQUAL_INT(NACRE_OK, spread_init(diameters[k], &spread, &error));
        spread_apply(&spread, SIDE, SIDE, in, out);
        for (int i = 0; i < POINTS; i++) {
            int dx = i % SIDE - SIDE / 2;
            variance += (double)out[i] * dx * dx;
            TEST_ASSERT_EQUAL_FLOAT(out[i], out[POINTS - 1 - i]);
        }
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 1, sum_of(out));
        /* A disc's variance along an axis is d^2 / 16. From the middles of points, where they are counted, that of a
         * convolution is the sum of the disc's and twice a square's 1/12, for light that a place of the square has and
         * for the point that counts it; for a small disc it is what crosses edges, less than that. */
        if (diameters[k] >= 1) {
            TEST_ASSERT_DOUBLE_WITHIN(0.1 * (diameters[k] * diameters[k] / 16 + 1. / 6),
                                      diameters[k] * diameters[k] / 16 + 1. / 6, variance);
        }
        spread_finish(&spread);
    }
}

static void light_spread_over_the_border_is_lost(void)
{
    struct spread spread = {0};
    struct nacre_error error;
    float in[POINTS] = {0};
    float out[POINTS];
    in[SIDE - 1] = 1;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, spread_init(2, &spread, &error));
    spread_apply(&spread, SIDE, SIDE, in, out);
    TEST_ASSERT_TRUE(sum_of(out) < 0.8);
    spread_finish(&spread);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(lamp_drifts_smoothly_with_the_stated_deviation);
    RUN_TEST(lamp_is_integrated_exactly_over_an_exposure);
    RUN_TEST(lamp_depends_on_seed_and_time_alone);
    RUN_TEST(drift_and_flicker_have_nothing_in_common);
    RUN_TEST(wheel_gives_exposures_the_overlap_with_its_segments);
    RUN_TEST(wheel_changes_nothing_in_whole_turns);
    RUN_TEST(defocus_keeps_the_light_and_has_the_disc_s_variance);
    RUN_TEST(light_spread_over_the_border_is_lost);
    return UNITY_END();
}
