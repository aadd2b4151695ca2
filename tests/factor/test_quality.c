/* Figures of a scan against what was put into it. */
#include "flawed.h"

#include "factor/quality.h"
#include "factor/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

enum { WIDTH = 40, HEIGHT = 30, WINDOW = 13 };

void setUp(void)
{
}

void tearDown(void)
{
}

static struct sample make(struct flaws flaws)
{
    return flawed_sample(WIDTH, HEIGHT, WINDOW, flaws);
}

static const struct flaws flawless = {.length = 1, .ceiling = INFINITY};

static struct quality measure(struct sample *sample)
{
    struct nacre_error error = {0};
    struct responses responses = sample_load(sample, 4);
    struct quality quality;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, quality_measure(&responses, &quality, &error),
                                  error.text);
    responses_finish(&responses);
    return quality;
}

static struct quality measure_flaws(struct flaws flaws)
{
    struct sample sample = make(flaws);
    struct quality quality = measure(&sample);
    sample_finish(&sample);
    return quality;
}

/* Warnings, one behind the other. */
static char *warn(const struct quality *quality, double wanted)
{
    static char text[2000];
    struct nacre_material material = {.window = WINDOW};
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, quality_warn(quality, wanted, &material, &error));
    text[0] = '\0';
    for (size_t i = 0; i < material.warning_count; i++) {
        (void)strncat(text, material.warnings[i], sizeof text - strlen(text) - 1);
    }
    nacre_material_finish(&material);
    return text;
}

static void a_good_scan_raises_no_warning(void)
{
    struct quality q = measure_flaws(flawless);
    TEST_ASSERT_EQUAL_STRING("", warn(&q, 0.01));
    TEST_ASSERT_TRUE(q.pairs > 100000);
    /* Rounding of floats. */
    TEST_ASSERT_TRUE(q.reciprocity < 1e-6 && q.noise < 1e-6 && q.floor < 1e-6);
}

/* The norm of the entries off the centre, of all points. */
static double norm_of(struct flaws flaws)
{
    struct sample s = make(flaws);
    double sum = 0;
    for (int i = 0; i < WIDTH * HEIGHT * WINDOW * WINDOW; i++) {
        double value = i % (WINDOW * WINDOW) == WINDOW * WINDOW / 2 ? 0 : (double)s.responses[i];
        sum += value * value;
    }
    sample_finish(&s);
    return sqrt(sum);
}

/* Entries off the centre whose ends lie inside the sample. */
static double count_entries(void)
{
    double half = (WINDOW - 1) / 2.0;
    double across = WINDOW * WIDTH - half * (half + 1), down = WINDOW * HEIGHT - half * (half + 1);
    return across * down - WIDTH * HEIGHT;
}

/* Some 100,000 pairs tell the noise to a percent; those of neighbours are not independent: 5 %. */
static void noise_is_found_by_reciprocity(void)
{
    struct flaws noisy = flawless;
    noisy.noise = 0.01;
    struct quality q = measure_flaws(noisy);
    double expected = 0.01 * sqrt(count_entries()) / norm_of(flawless);
    TEST_ASSERT_DOUBLE_WITHIN(0.05 * expected, expected, q.noise);
    TEST_ASSERT_TRUE(q.reciprocity < 0.3 * q.noise);
    TEST_ASSERT_NULL(strstr(warn(&q, 1), "noise of about"));
    TEST_ASSERT_NULL(strstr(warn(&q, 1.1 * q.floor), "noise of about"));
    TEST_ASSERT_NOT_NULL(strstr(warn(&q, 0.9 * q.floor), "is below the scan's noise of about"));
}

/* A gain of 1 - g/2 to 1 + g/2 from side to side makes R and R^T differ by g dx / width, wherever light goes. */
static void gains_are_told_from_noise(void)
{
    struct flaws flawed = flawless;
    flawed.gain = 1;
    flawed.length = 3;
    struct quality clean = measure_flaws(flawed);
    flawed.noise = 0.003;
    struct quality noisy = measure_flaws(flawed);
    flawed.gain = 0;
    struct quality reference = measure_flaws(flawed);
    TEST_ASSERT_TRUE(clean.reciprocity > 0.05);
    TEST_ASSERT_TRUE(clean.noise < 0.01 * clean.reciprocity);
    TEST_ASSERT_DOUBLE_WITHIN(0.05 * clean.reciprocity, clean.reciprocity, noisy.reciprocity);
    TEST_ASSERT_DOUBLE_WITHIN(0.05 * reference.noise, reference.noise, noisy.noise);
    TEST_ASSERT_NOT_NULL(strstr(warn(&noisy, 1), "gains of projector or camera"));
    TEST_ASSERT_NULL(strstr(warn(&reference, 1), "gains of projector or camera"));
}

static void a_peak_off_the_centre_is_measured(void)
{
    struct flaws flawed = flawless;
    flawed.peak_x = 2;
    flawed.peak_y = -1;
    struct quality q = measure_flaws(flawed);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 2, q.peak_x);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, -1, q.peak_y);
    TEST_ASSERT_NOT_NULL(strstr(warn(&q, 1), "points off the lit one"));
    flawed.peak_x = 0.1;
    flawed.peak_y = 0;
    q = measure_flaws(flawed);
    TEST_ASSERT_NULL(strstr(warn(&q, 1), "points off the lit one"));
}

static void a_window_that_is_too_small_is_told(void)
{
    struct flaws flawed = flawless;
    flawed.length = 6;
    struct quality q = measure_flaws(flawed);
    TEST_ASSERT_TRUE(q.rim > 0.1 && q.rim < 1);
    TEST_ASSERT_NOT_NULL(strstr(warn(&q, 1), "the window of 13 points is too small"));
}

static void saturation_is_told(void)
{
    struct flaws flawed = flawless;
    flawed.ceiling = 0.2;
    struct quality q = measure_flaws(flawed);
    TEST_ASSERT_TRUE(q.saturated > 0.01);
    TEST_ASSERT_NOT_NULL(strstr(warn(&q, 1), "the scan is saturated there"));
}

static void missing_entries_are_counted(void)
{
    struct sample sample = make(flawless);
    size_t lost = 0, inside = 0, area = (size_t)WINDOW * WINDOW;
    for (size_t i = 0; i < WIDTH * HEIGHT * area; i++) {
        if (sample.responses[i] > 0) { /* no entry inside is 0 */
            inside++;
            if (random_uniform(7, i) < 0.2) {
                sample.responses[i] = NAN;
                lost++;
            }
        }
    }
    struct quality q = measure(&sample);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, (double)lost / (double)inside, q.missing);
    TEST_ASSERT_NOT_NULL(strstr(warn(&q, 1), "entries of measured responses are missing"));
    sample_finish(&sample);
}

static void a_dark_scan_and_one_of_a_point_have_figures(void)
{
    struct sample dark = make(flawless), point = sample_new(1, 1, 1, 5, 5);
    sample_scale(&dark, 0);
    struct quality q = measure(&dark);
    TEST_ASSERT_EQUAL_STRING("", warn(&q, 0.01));
    TEST_ASSERT_EQUAL_INT(0, q.pairs);
    q = measure(&point);
    TEST_ASSERT_EQUAL_STRING("", warn(&q, 0.01));
    TEST_ASSERT_EQUAL_INT(0, q.pairs);
    sample_finish(&dark);
    sample_finish(&point);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(a_good_scan_raises_no_warning);
    RUN_TEST(noise_is_found_by_reciprocity);
    RUN_TEST(gains_are_told_from_noise);
    RUN_TEST(a_peak_off_the_centre_is_measured);
    RUN_TEST(a_window_that_is_too_small_is_told);
    RUN_TEST(saturation_is_told);
    RUN_TEST(missing_entries_are_counted);
    RUN_TEST(a_dark_scan_and_one_of_a_point_have_figures);
    return UNITY_END();
}
