/* Judging by reciprocal pairs against a truth that is known. */
#include "device.h"
#include "flawed.h"

#include "factor/cross.h"
#include "factor/layout.h"

#include "nacre/evaluate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unity.h>

enum { WIDTH = 40, HEIGHT = 30, WINDOW = 13, AREA = WINDOW * WINDOW };

static struct opencl opencl;
static struct nacre_error error;

void setUp(void)
{
}

void tearDown(void)
{
}

static struct factor_options options_of(int terms)
{
    struct factor_options options = factor_options_default();
    options.terms = terms;
    options.clusters = 2;
    options.iterations = 30;
    options.store = FACTOR_STORE_FLOAT;
    return options;
}

/* ||S - factored|| / ||S|| over the entries off the centre that were fitted. */
static double true_error(const struct sample *truth, const struct responses *kept,
                         const struct nacre_material *m)
{
    double miss = 0, energy = 0;
    float factored[AREA], fitted[AREA];
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        nacre_material_response(m, i % WIDTH, i / WIDTH, factored);
        responses_get(kept, 0, i % WIDTH, i / WIDTH, fitted);
        for (int j = 0; j < AREA; j++) {
            double value = (double)sample_at(truth, i % WIDTH, i / WIDTH)[j];
            if (j != AREA / 2 && !isnan(fitted[j])) {
                miss += pow(value - (double)factored[j], 2);
                energy += value * value;
            }
        }
    }
    return sqrt(miss / energy);
}

static const struct flaws clean = {.length = 1.5, .ceiling = INFINITY};

/* The judge's figures with this noise and so many terms, and the truth. */
static struct cross_report judge(double noise, int terms, double *truth)
{
    struct flaws flaws = clean;
    struct factor_options options = options_of(terms);
    flaws.noise = noise;
    struct sample perfect = flawed_sample(WIDTH, HEIGHT, WINDOW, clean);
    struct sample noisy = flawed_sample(WIDTH, HEIGHT, WINDOW, flaws);
    struct responses whole = sample_load(&noisy, layout_lanes(&opencl)), kept;
    struct nacre_material material = {0};
    struct factor_summary summary = {0};
    struct cross_report report = {0};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, cross_halve(&whole, &kept, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK,
        factorize_responses(&kept, 1, &options, &opencl, NULL, &material, &summary, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, cross_judge(&whole, &material, &report, &error));
    *truth = true_error(&perfect, &kept, &material);
    factor_summary_finish(&summary);
    nacre_material_finish(&material);
    responses_finish(&kept);
    responses_finish(&whole);
    sample_finish(&perfect);
    sample_finish(&noisy);
    return report;
}

/* Some 80,000 pairs: what noise adds to their sums is known to 1/280 of it, twice, and to that the error's square must be
 * large; it is a quarter of the noise's at least here, which makes 5 % of the error with room. */
static void the_error_against_the_truth_is_found_behind_noise(void)
{
    static const struct {
        double noise;
        int terms;
    } cases[] = {{0, 2}, {0.003, 2}, {0.01, 4}, {0.03, 4}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double truth = 0;
        struct cross_report report = judge(cases[i].noise, cases[i].terms, &truth);
        printf("%g %d: %g %g noise %g\n", cases[i].noise, cases[i].terms, truth, report.error,
               report.noise);
        TEST_ASSERT_DOUBLE_WITHIN(0.05 * truth, truth, report.error);
    }
}

/* Every pair loses one, and none both. */
static void one_of_each_pair_is_kept(void)
{
    struct sample sample = flawed_sample(WIDTH, HEIGHT, WINDOW, clean);
    sample_at(&sample, 20, 10)[3] = NAN; /* its counterpart must stay */
    struct responses whole = sample_load(&sample, 4), kept;
    int half = WINDOW / 2, end = WINDOW - 1, forth = 0, back = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, cross_halve(&whole, &kept, &error));
    for (int i = 0; i < WIDTH * HEIGHT * AREA; i++) {
        int x = i / AREA % WIDTH, y = i / AREA / WIDTH, u = i % WINDOW, v = i % AREA / WINDOW;
        int xo = x + u - half, yo = y + v - half;
        if (xo < 0 || xo >= WIDTH || yo < 0 || yo >= HEIGHT) {
            continue;
        }
        bool here = !isnan(responses_value(&kept, 0, x, y, u, v));
        bool there = !isnan(responses_value(&kept, 0, xo, yo, end - u, end - v));
        TEST_ASSERT_TRUE(u == half && v == half ? here : here != there);
        forth += here && (v > half || (v == half && u > half));
        back += here && (v < half || (v == half && u < half));
    }
    /* A fair lot of some 80,000: 1 % is three standard deviations. */
    TEST_ASSERT_INT_WITHIN((forth + back) / 100, forth, back);
    responses_finish(&kept);
    responses_finish(&whole);
    sample_finish(&sample);
}

static void a_dark_scan_has_no_pairs(void)
{
    struct sample sample = flawed_sample(WIDTH, HEIGHT, WINDOW, clean);
    struct factor_options options = options_of(2);
    struct cross_report report = {.pairs = 1};
    sample_scale(&sample, 0);
    struct responses whole = sample_load(&sample, layout_lanes(&opencl));
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          cross_measure(&whole, NULL, 1, &options, &opencl, NULL, &report, &error));
    TEST_ASSERT_EQUAL_INT(0, report.pairs);
    responses_finish(&whole);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(the_error_against_the_truth_is_found_behind_noise);
    RUN_TEST(one_of_each_pair_is_kept);
    RUN_TEST(a_dark_scan_has_no_pairs);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
