/* A factorization from responses to material, and the error it reports. */
#include "device.h"
#include "outcome.h"

#include "factor/layout.h"
#include "factor/update.h"

#include "nacre/evaluate.h"

#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct opencl opencl;

void setUp(void)
{
}

void tearDown(void)
{
}

static int attempt(const struct sample *sample, const struct factor_options *options,
                   struct nacre_material *material, struct factor_summary *summary,
                   struct nacre_error *error)
{
    struct outcome outcome = outcome_of(sample, options, &opencl, error);
    *material = outcome.material;
    *summary = outcome.summary;
    return outcome.status;
}

static struct nacre_material run(const struct sample *sample, const struct factor_options *options,
                                 struct factor_summary *summary)
{
    struct nacre_material material;
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_MESSAGE(NACRE_OK, attempt(sample, options, &material, summary, &error),
                              error.text);
    return material;
}

static struct factor_options quick(int terms, int clusters, int iterations)
{
    struct factor_options options = factor_options_default();
    options.terms = terms;
    options.clusters = clusters;
    options.iterations = iterations;
    options.tolerance = 0;
    return options;
}

/* The definition, written out: points have an error, are dark (-1) or not measured (-2). */
static double error_of_point(const struct sample *s, const struct nacre_material *m, int x, int y,
                             bool with_centre)
{
    int half = s->window / 2, area = s->window * s->window, measured = 0;
    double difference = 0, norm = 0;
    for (int i = 0; i < s->channels * area; i++) {
        int dx = i % s->window - half, dy = i % area / s->window - half;
        double value = (double)sample_at(s, x, y)[i], model = 0;
        if (x + dx < 0 || x + dx >= s->width || y + dy < 0 || y + dy >= s->height || isnan(value) ||
            (!with_centre && dx == 0 && dy == 0)) {
            continue;
        }
        for (int t = 0; t < m->terms; t++) {
            int plane = (t * m->channels + i / area) * m->height;
            model += (double)m->f[(plane + y) * m->width + x] *
                     (double)m->h[(plane + y + dy) * m->width + x + dx];
        }
        model *= (double)m->kernels[(int)m->ids[y * m->width + x] * s->channels * area + i];
        difference += (value - model) * (value - model);
        norm += value * value;
        measured++;
    }
    return !measured ? -2 : norm == 0 ? -1 : sqrt(difference / norm);
}

static void check_report(const struct sample *s, const struct nacre_material *m,
                         const struct error_report *report)
{
    size_t dark = 0, not_measured = 0, points = 0;
    double sum = 0, least = INFINITY, greatest = 0;
    for (int i = 0; i < s->width * s->height; i++) {
        double expected = error_of_point(s, m, i % s->width, i / s->width, true);
        double without = error_of_point(s, m, i % s->width, i / s->width, false);
        dark += expected == -1;
        not_measured += expected == -2;
        if (expected >= 0) {
            /* The model is evaluated in float: 1e-6 of the response. */
            TEST_ASSERT_DOUBLE_WITHIN(2e-6, expected, (double)report->map[i]);
            sum += expected;
            least = fmin(least, expected);
            greatest = fmax(greatest, expected);
            points++;
        } else {
            TEST_ASSERT_TRUE(isnan(report->map[i]));
        }
        if (without >= 0) {
            TEST_ASSERT_DOUBLE_WITHIN(2e-6 * (1 + without), without,
                                      (double)report->map_without_centre[i]);
        }
    }
    TEST_ASSERT_EQUAL_UINT64(dark, report->dark);
    TEST_ASSERT_EQUAL_UINT64(not_measured, report->not_measured);
    TEST_ASSERT_EQUAL_UINT64(points, report->whole.points);
    TEST_ASSERT_DOUBLE_WITHIN(2e-6, least, report->whole.minimum);
    TEST_ASSERT_DOUBLE_WITHIN(2e-6, sum / (double)points, report->whole.mean);
    TEST_ASSERT_DOUBLE_WITHIN(2e-6, greatest, report->whole.maximum);
}

/* Holes, a dark point and a point that was not measured. */
static struct sample make_spoilt(void)
{
    struct sample sample = sample_new(18, 14, 3, 7, 3);
    for (int i = 0; i < 3 * 49; i++) {
        sample_at(&sample, 4, 5)[i] = 0;
        sample_at(&sample, 9, 9)[i] = NAN;
        sample_at(&sample, 10, 2)[i] = i % 3 ? sample_at(&sample, 10, 2)[i] : NAN;
        sample_at(&sample, 12, 12)[i] = i < 49 ? NAN : sample_at(&sample, 12, 12)[i];
    }
    return sample;
}

static void the_error_is_what_its_definition_says(void)
{
    struct sample sample = make_spoilt();
    struct factor_options options = quick(4, 2, 10);
    struct factor_summary summary;
    struct nacre_material material = run(&sample, &options, &summary);
    struct error_report report = outcome_judge(&sample, &material);
    check_report(&sample, &material, &report);
    check_report(&sample, &material, &summary.error);
    TEST_ASSERT_EQUAL_UINT64(1, report.dark);
    TEST_ASSERT_EQUAL_UINT64(1, report.not_measured);
    error_report_finish(&report);
    factor_summary_finish(&summary);
    nacre_material_finish(&material);
    sample_finish(&sample);
}

/* Two materials on and off the vein make four kinds of fall-off. The noise is uniform in +-1 %, 0.58 % in the mean
 * square; half of it again is left for what eight terms cannot follow and float storage. */
static void a_sample_of_two_materials_and_a_vein_is_fitted_to_its_noise(void)
{
    struct sample sample = sample_new(30, 26, 3, 9, 3);
    struct factor_options options = quick(8, 4, 60);
    struct factor_summary summary;
    struct nacre_material material = run(&sample, &options, &summary);
    TEST_ASSERT_TRUE(summary.error.whole.mean < 0.009);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, summary.error.whole.mean, material.error_mean);
    TEST_ASSERT_EQUAL_INT(NACRE_HALF, material.pixel);
    TEST_ASSERT_EQUAL_UINT64(60, material.history_count);
    for (size_t i = 1; i < material.history_count; i++) {
        TEST_ASSERT_TRUE(material.history_objective[i] <=
                         material.history_objective[i - 1] * (1 + 1e-6F));
        TEST_ASSERT_TRUE(material.history_seconds[i] >= material.history_seconds[i - 1]);
    }
    /* Of a third of the points, before rounding: their errors spread by about their mean. */
    TEST_ASSERT_DOUBLE_WITHIN(0.2 * summary.error.whole.mean, summary.error.whole.mean,
                              (double)material.history_error[59]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 * summary.objective, summary.objective,
                              (double)material.history_objective[59]);
    factor_summary_finish(&summary);
    nacre_material_finish(&material);
    sample_finish(&sample);
}

static void chessboard_points_are_clustered_by_their_material(void)
{
    struct sample sample = sample_new(30, 25, 3, 9, 3);
    struct factor_options options = quick(2, 2, 1);
    struct factor_summary summary;
    struct nacre_material m = run(&sample, &options, &summary);
    int wrong = 0, inner = 0;
    for (int y = 0; y < 25; y++) {
        for (int x = 0; x < 30; x++) {
            /* Points that are dimmed by a vein near by have bent fall-offs; they may be taken for either. */
            bool clear = true;
            for (int d = -3; d <= 3; d++) {
                clear = clear && abs(x + d - y) % 11 != 5;
            }
            if (clear) {
                uint32_t same = m.ids[0] ^ (uint32_t)((x / 5 + y / 5) % 2);
                wrong += m.ids[y * 30 + x] != same;
                inner++;
            }
        }
    }
    TEST_ASSERT_TRUE(inner > 200);
    TEST_ASSERT_EQUAL_INT(0, wrong);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void two_runs_give_the_same_material(void)
{
    struct sample sample = make_spoilt();
    struct factor_options options = quick(3, 3, 20);
    struct factor_summary summary, again;
    struct nacre_material a = run(&sample, &options, &summary), b = run(&sample, &options, &again);
    size_t count = (size_t)(3 * 3 * 18 * 14);
    TEST_ASSERT_EQUAL_MEMORY(a.f, b.f, count * sizeof *a.f);
    TEST_ASSERT_EQUAL_MEMORY(a.h, b.h, count * sizeof *a.h);
    TEST_ASSERT_EQUAL_MEMORY(a.ids, b.ids, (size_t)18 * 14 * sizeof *a.ids);
    TEST_ASSERT_EQUAL_MEMORY(a.kernels, b.kernels, (size_t)3 * 3 * 49 * sizeof *a.kernels);
    nacre_material_finish(&b);
    factor_summary_finish(&again);
    options.seed = 1;
    b = run(&sample, &options, &again);
    TEST_ASSERT_TRUE(memcmp(a.f, b.f, count * sizeof *a.f) != 0);
    factor_summary_finish(&summary);
    factor_summary_finish(&again);
    nacre_material_finish(&a);
    nacre_material_finish(&b);
    sample_finish(&sample);
}

static void points_that_were_not_measured_are_filled(void)
{
    struct sample sample = sample_new(20, 16, 1, 7, 3);
    struct factor_options options = quick(3, 2, 30);
    struct factor_summary summary;
    for (int i = 0; i < 49; i++) {
        for (int y = 4; y < 12; y++) {
            for (int x = 6; x < 14; x++) {
                sample_at(&sample, x, y)[i] = NAN;
            }
        }
    }
    struct nacre_material m = run(&sample, &options, &summary);
    for (int i = 0; i < 20 * 16; i++) {
        float response[49], sum = 0;
        nacre_material_response(&m, i % 20, i / 20, response);
        for (int j = 0; j < 49; j++) {
            TEST_ASSERT_TRUE(isfinite(response[j]) && response[j] >= 0);
            sum += response[j];
        }
        TEST_ASSERT_TRUE(sum > 0);
        TEST_ASSERT_EQUAL_INT(isnan(m.albedo[i]) != 0,
                              i % 20 >= 6 && i % 20 < 14 && i / 20 >= 4 && i / 20 < 12);
    }
    TEST_ASSERT_EQUAL_UINT64(64, summary.error.not_measured);
    TEST_ASSERT_EQUAL_UINT64(320 - 64, summary.error.whole.points);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void the_scale_of_the_data_does_not_change_the_error(void)
{
    static const float scales[] = {1e-30F, 1e-5F, 1e5F, 1e30F};
    struct sample sample = sample_new(14, 12, 1, 7, 3);
    struct factor_options options = quick(3, 2, 30);
    struct factor_summary summary, scaled;
    struct nacre_material m = run(&sample, &options, &summary);
    for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
        struct sample other = sample_new(14, 12, 1, 7, 3);
        sample_scale(&other, scales[i]);
        struct nacre_material n = run(&other, &options, &scaled);
        TEST_ASSERT_DOUBLE_WITHIN(1e-5 * m.error_mean, m.error_mean, n.error_mean);
        factor_summary_finish(&scaled);
        nacre_material_finish(&n);
        sample_finish(&other);
    }
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void a_dark_sample_gives_a_dark_material(void)
{
    struct sample sample = sample_new(9, 8, 3, 5, 3);
    struct factor_options options = quick(3, 4, 5);
    struct factor_summary summary;
    float response[75];
    sample_scale(&sample, 0);
    struct nacre_material m = run(&sample, &options, &summary);
    for (int i = 0; i < 72; i++) {
        nacre_material_response(&m, i % 9, i / 9, response);
        for (int j = 0; j < 75; j++) {
            TEST_ASSERT_EQUAL_FLOAT(0, response[j]);
        }
    }
    TEST_ASSERT_EQUAL_UINT64(72, summary.error.dark);
    TEST_ASSERT_EQUAL_UINT64(0, summary.error.whole.points);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void one_point_is_enough(void)
{
    struct sample sample = sample_new(1, 1, 1, 9, 3);
    struct factor_options options = quick(2, 1, 10);
    struct factor_summary summary;
    struct nacre_material m = run(&sample, &options, &summary);
    /* The single entry can be met exactly, up to rounding to half: 11 bits each of F and H. */
    TEST_ASSERT_TRUE(summary.error.whole.maximum < 2e-3);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void requests_that_cannot_be_met_are_refused(void)
{
    struct sample sample = sample_new(4, 3, 1, 3, 3);
    struct nacre_material material;
    struct factor_summary summary;
    struct nacre_error error = {0};
    struct factor_options options = quick(3, 12, 1);
    for (int i = 0; i < 9; i++) {
        sample_at(&sample, 2, 1)[i] = NAN;
    }
    TEST_ASSERT_EQUAL(NACRE_FAILED, attempt(&sample, &options, &material, &summary, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "only 11 surface points"));
    TEST_ASSERT_NULL(material.f);
    options = quick(-1, 1, 1);
    TEST_ASSERT_EQUAL(NACRE_FAILED, attempt(&sample, &options, &material, &summary, &error));
    options = quick(1, -1, 1);
    TEST_ASSERT_EQUAL(NACRE_FAILED, attempt(&sample, &options, &material, &summary, &error));
    for (int i = 0; i < 12 * 9; i++) {
        sample.responses[i] = NAN;
    }
    options = quick(1, 1, 1);
    TEST_ASSERT_EQUAL(NACRE_FAILED, attempt(&sample, &options, &material, &summary, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "no surface point was measured"));
    sample_finish(&sample);
}

static void storing_as_float_loses_nothing_and_half_hardly_anything(void)
{
    struct sample sample = sample_new(20, 16, 1, 7, 3);
    struct factor_options options = quick(4, 2, 100);
    struct factor_summary as_float, as_half;
    options.store = FACTOR_STORE_FLOAT;
    struct nacre_material a = run(&sample, &options, &as_float);
    options.store = FACTOR_STORE_HALF;
    struct nacre_material b = run(&sample, &options, &as_half);
    TEST_ASSERT_EQUAL_INT(NACRE_FLOAT, a.pixel);
    TEST_ASSERT_EQUAL_INT(NACRE_HALF, b.pixel);
    TEST_ASSERT_TRUE(nacre_material_size(&b) < nacre_material_size(&a));
    TEST_ASSERT_DOUBLE_WITHIN(0.01 * a.error_mean, a.error_mean, b.error_mean);
    for (size_t i = 0; i < (size_t)4 * 20 * 16; i++) {
        /* 11 bits: half a unit in the last place is 2^-11 of the value. */
        TEST_ASSERT_FLOAT_WITHIN(a.f[i] * 0x1p-11F + 0x1p-24F, a.f[i], b.f[i]);
    }
    factor_summary_finish(&as_float);
    factor_summary_finish(&as_half);
    nacre_material_finish(&a);
    nacre_material_finish(&b);
    sample_finish(&sample);
}

/* The true mean error of a material made of responses held as floats or as half floats. */
static double error_of_stored(const struct sample *sample, const struct factor_options *options,
                              bool half)
{
    struct nacre_error error = {0};
    struct nacre_material material;
    struct factor_summary summary = {0};
    struct responses responses = half ? sample_load_half(sample, layout_lanes(&opencl))
                                      : sample_load(sample, layout_lanes(&opencl));
    TEST_ASSERT_EQUAL_MESSAGE(
        NACRE_OK,
        factorize_responses(&responses, 0.5, options, &opencl, NULL, &material, &summary, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT(half, summary.half_responses);
    struct error_report report = outcome_judge(sample, &material);
    double mean = report.whole.mean;
    /* What the run itself reports is of what it held: off by what halves round, 2^-11 of each entry at most. */
    TEST_ASSERT_DOUBLE_WITHIN(half ? 0x1p-11 : 1e-6, mean, summary.error.whole.mean);
    error_report_finish(&report);
    factor_summary_finish(&summary);
    nacre_material_finish(&material);
    responses_finish(&responses);
    return mean;
}

/* Points that differ by 1300 in brightness, with responses that fall by 1e5 and more. The noise of 1 % leaves an error of
 * 0.005, to which roundings of 2^-11 and less, of their own, add 1 % in quadrature at most. */
static void half_responses_leave_the_error_as_it_is(void)
{
    struct sample sample = sample_new(33, 21, 3, 15, 5);
    for (size_t i = 0; i < (size_t)33 * 21 * 3 * 225; i++) {
        sample.responses[i] /= i / (3 * 225) % 33 % 3 == 1 ? 1300 : 1;
    }
    for (int method = FACTOR_METHOD_HALS; method <= FACTOR_METHOD_MU; method++) {
        struct factor_options options = quick(4, 2, 40);
        options.method = (enum factor_method)method;
        options.store = FACTOR_STORE_FLOAT;
        double floats = error_of_stored(&sample, &options, false);
        double halves = error_of_stored(&sample, &options, true);
        TEST_ASSERT_TRUE(halves <= 1.01 * floats && halves != floats);
    }
    sample_finish(&sample);
}

/* Last, as the flag that the signal sets stays set. */
static void a_run_that_is_stopped_before_it_iterates_leaves_no_material(void)
{
    struct sample sample = sample_new(4, 3, 1, 3, 3);
    struct nacre_material material;
    struct factor_summary summary;
    struct nacre_error error = {0};
    struct factor_options options = quick(3, 1, 1000000);
    progress_catch_signals();
    TEST_ASSERT_EQUAL_INT(0, raise(SIGINT));
    TEST_ASSERT_EQUAL(NACRE_CANCELLED, attempt(&sample, &options, &material, &summary, &error));
    TEST_ASSERT_NULL(material.f);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(the_error_is_what_its_definition_says);
    RUN_TEST(a_sample_of_two_materials_and_a_vein_is_fitted_to_its_noise);
    RUN_TEST(chessboard_points_are_clustered_by_their_material);
    RUN_TEST(two_runs_give_the_same_material);
    RUN_TEST(points_that_were_not_measured_are_filled);
    RUN_TEST(the_scale_of_the_data_does_not_change_the_error);
    RUN_TEST(a_dark_sample_gives_a_dark_material);
    RUN_TEST(one_point_is_enough);
    RUN_TEST(requests_that_cannot_be_met_are_refused);
    RUN_TEST(storing_as_float_loses_nothing_and_half_hardly_anything);
    RUN_TEST(half_responses_leave_the_error_as_it_is);
    RUN_TEST(a_run_that_is_stopped_before_it_iterates_leaves_no_material);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
