/* Block coordinate descent against double precision, and what it promises of any run. */
#include "bench.h"
#include "device.h"

#include "factor/hals.h"
#include "factor/layout.h"
#include "factor/random.h"
#include "factor/update.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

enum { SWEEPS = 10, STEPS = 5 }; /* as in hals.c */

static struct opencl opencl;

void setUp(void)
{
}

void tearDown(void)
{
}

static void start(struct bench *b, const struct hals_options *options)
{
    struct nacre_error error = {0};
    b->problem.responses = &b->responses;
    bench_succeed(hals_new(&opencl, &b->problem, options, &b->method, &error), &error);
    if (!b->method) {
        abort(); /* cannot be, which analysers do not know */
    }
}

static double norm_of_difference(const double *a, const float *b, size_t count, double *norm)
{
    double difference = 0;
    *norm = 0;
    for (size_t i = 0; i < count; i++) {
        difference += (a[i] - (double)b[i]) * (a[i] - (double)b[i]);
        *norm += a[i] * a[i];
    }
    *norm = sqrt(*norm);
    return sqrt(difference);
}

/* The first steps as hals.h describes them, in double: H set, then F, both carried on along the change since the step
 * before; three steps without that, then half of it, then 5 % more. */
static void reference_steps(struct reference *r, size_t count, int steps)
{
    double *last[2] = {malloc(count * sizeof(double)), malloc(count * sizeof(double))};
    memcpy(last[0], r->f, count * sizeof(double));
    memcpy(last[1], r->h, count * sizeof(double));
    for (int i = 0; i < steps; i++) {
        double share = i < 3 ? 0 : 0.5 * pow(1.05, i - 3);
        for (int of_h = 1; of_h >= 0; of_h--) {
            double *factor = of_h ? r->h : r->f;
            reference_descend(r, of_h, SWEEPS);
            for (size_t k = 0; k < count; k++) {
                double best = factor[k];
                factor[k] = fmax(0, best + share * (best - last[of_h][k]));
                last[of_h][k] = best;
            }
        }
    }
    free(last[0]);
    free(last[1]);
}

/* After `steps`: coordinate descent amplifies roundings by the condition of the normal equations, so single entries are
 * not compared, but F and H as wholes: 1e-3 in the Euclidean norm. Around its minimum the objective is flat: 1e-5 of it
 * after one step, and 1e-4 after five, each of which starts from the roundings of the one before. Summed in double from
 * the factors as they are, it is that of the device to 1e-5. */
static void compare_with_reference(struct bench *b, int channel, const double *f, const double *h,
                                   double first, int steps)
{
    struct nacre_error error = {0};
    double objective = 0, norm = 0;
    struct reference reference = bench_reference(b, channel);
    memcpy(reference.f, f, b->count * sizeof *f);
    memcpy(reference.h, h, b->count * sizeof *h);
    reference_steps(&reference, b->count, steps);
    bench_read(b, channel);
    struct reference actual = bench_reference(b, channel);
    double expected = reference_objective(&reference), exact = reference_objective(&actual);
    TEST_ASSERT_TRUE_MESSAGE(expected < first, "this sample's first steps are to be taken");
    bench_succeed(b->method->ops->measure(b->method, channel, &objective, &error), &error);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5 * exact + 1e-10 * first, exact, objective);
    TEST_ASSERT_DOUBLE_WITHIN((steps > 1 ? 1e-4 : 1e-5) * expected + 1e-10 * first, expected,
                              exact);
    double difference = norm_of_difference(reference.f, b->f, b->count, &norm);
    TEST_ASSERT_TRUE(difference <= 1e-3 * norm);
    difference = norm_of_difference(reference.h, b->h, b->count, &norm);
    TEST_ASSERT_TRUE(difference <= 1e-3 * norm);
    bench_reference_finish(&actual);
    bench_reference_finish(&reference);
}

static void compare_first_steps(struct bench *b)
{
    static const struct hals_options exact = {.far = 0};
    struct nacre_error error = {0};
    start(b, &exact);
    for (int c = 0; c < b->responses.channels; c++) {
        double objective = 0;
        bench_read(b, c);
        struct reference begun = bench_reference(b, c);
        double first = reference_objective(&begun);
        bench_succeed(b->method->ops->step(b->method, c, &objective, &error), &error);
        TEST_ASSERT_DOUBLE_WITHIN(1e-5 * first, first, objective);
        compare_with_reference(b, c, begun.f, begun.h, first, 1);
        for (int i = 1; i < STEPS; i++) {
            bench_succeed(b->method->ops->step(b->method, c, NULL, &error), &error);
        }
        compare_with_reference(b, c, begun.f, begun.h, first, STEPS);
        bench_reference_finish(&begun);
    }
}

static void the_first_steps_agree_with_double_precision(void)
{
    static const struct {
        int width, height, window, terms, clusters, channels;
    } shapes[] = {
        /* Few numbers of terms: each is a program of its own to compile. */
        {1, 13, 5, 1, 1, 1},  {13, 1, 7, 1, 1, 1},    {17, 11, 9, 4, 3, 3},
        {31, 7, 25, 4, 5, 1}, {37, 19, 11, 12, 1, 1}, {8, 9, 67, 4, 2, 1},
    };
    for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++) {
        struct sample sample =
            sample_new(shapes[i].width, shapes[i].height, shapes[i].channels, shapes[i].window, 5);
        struct bench b =
            bench_new(&sample, shapes[i].terms, shapes[i].clusters, layout_lanes(&opencl));
        compare_first_steps(&b);
        bench_finish(&b);
        sample_finish(&sample);
    }
}

static void the_first_steps_with_missing_entries_agree_with_double_precision(void)
{
    struct sample sample = sample_new(19, 12, 3, 7, 5);
    sample_punch_holes(&sample);
    struct bench b = bench_new(&sample, 4, 3, layout_lanes(&opencl));
    TEST_ASSERT_TRUE(b.responses.mask_needed);
    compare_first_steps(&b);
    bench_finish(&b);
    sample_finish(&sample);
}

/* Steps with the options in use. Returns the objective after them, in double precision from the factors themselves. */
static double descend_with(const struct hals_options *options, struct sample *sample, int terms,
                           int clusters, int steps)
{
    struct nacre_error error = {0};
    struct bench b = bench_new(sample, terms, clusters, layout_lanes(&opencl));
    double previous = INFINITY, objective = 0;
    start(&b, options);
    for (int i = 0; i < steps; i++) {
        bench_succeed(b.method->ops->step(b.method, 0, &objective, &error), &error);
        TEST_ASSERT_TRUE(isfinite(objective));
        TEST_ASSERT_TRUE(objective <= previous * (1 + 1e-6));
        previous = objective;
    }
    bench_succeed(b.method->ops->measure(b.method, 0, &objective, &error), &error);
    TEST_ASSERT_TRUE(objective <= previous * (1 + 1e-6));
    bench_read(&b, 0);
    for (size_t i = 0; i < b.count; i++) {
        TEST_ASSERT_TRUE(isfinite(b.f[i]) && b.f[i] >= 0 && isfinite(b.h[i]) && b.h[i] >= 0);
    }
    struct reference reference = bench_reference(&b, 0);
    double exact = reference_objective(&reference);
    /* Float residuals of responses up to 1 against a sum of their squares over kernels as small as 1e-5 of the peak. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-5 * exact + 1e-9, exact, objective);
    bench_reference_finish(&reference);
    bench_finish(&b);
    return exact;
}

static double descend(struct sample *sample, int terms, int clusters, int steps)
{
    return descend_with(NULL, sample, terms, clusters, steps);
}

static void the_objective_never_rises(void)
{
    struct sample plain = sample_new(24, 17, 1, 15, 5), holes = sample_new(24, 17, 1, 15, 6);
    struct sample dark_point = sample_new(24, 17, 1, 15, 7), dark = sample_new(24, 17, 1, 15, 8);
    struct sample spike = sample_new(24, 17, 1, 15, 9), negative = sample_new(24, 17, 1, 15, 10);
    size_t area = 225;
    sample_punch_holes(&holes);
    memset(sample_at(&dark_point, 5, 5), 0, area * sizeof(float));
    sample_scale(&dark, 0);
    for (size_t i = 0; i < 24 * 17 * area; i++) {
        spike.responses[i] *= i / area == 100 ? 1e5F : 1;
        negative.responses[i] -= i % 5 ? 0 : 0.02F;
    }
    (void)descend(&plain, 4, 1, 60);
    (void)descend(&plain, 4, 4, 60);
    (void)descend(&holes, 4, 2, 60);
    (void)descend(&dark_point, 4, 1, 60);
    (void)descend(&dark, 4, 1, 10);
    (void)descend(&spike, 4, 2, 60);
    (void)descend(&negative, 4, 1, 60);
    sample_finish(&plain);
    sample_finish(&holes);
    sample_finish(&dark_point);
    sample_finish(&dark);
    sample_finish(&spike);
    sample_finish(&negative);
}

/* The point of the method: what the paper's updates need hundreds of iterations for comes in a few steps, with exact
 * normal matrices and with those of cells, with one cluster and where unlike ones alternate from column to column. */
static void few_steps_are_better_than_three_hundred_updates(void)
{
    static const struct hals_options exact = {.far = 0}, cells = {.far = 1};
    static const struct {
        const struct hals_options *options;
        int clusters, steps;
    } cases[] = {{&exact, 3, 30}, {&cells, 3, 30}, {&cells, 1, 40}};
    struct nacre_error error = {0};
    struct sample sample = sample_new(40, 33, 1, 17, 11);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct bench b = bench_new(&sample, 4, cases[i].clusters, layout_lanes(&opencl));
        double objective = 0;
        b.problem.responses = &b.responses;
        bench_succeed(update_new(&opencl, &b.problem, NULL, &b.method, &error), &error);
        bench_run(&b, 300);
        bench_succeed(b.method->ops->measure(b.method, 0, &objective, &error), &error);
        TEST_ASSERT_TRUE(descend_with(cases[i].options, &sample, 4, cases[i].clusters,
                                      cases[i].steps) <= objective);
        bench_finish(&b);
    }
    sample_finish(&sample);
}

/* Leave out the responses of points for which (x / unit + y / unit) is no multiple of `every`. */
static void measure_some(struct sample *sample, int unit, int every)
{
    size_t area = (size_t)sample->window * (size_t)sample->window;
    for (int y = 0; y < sample->height; y++) {
        for (int x = 0; x < sample->width; x++) {
            for (size_t i = 0; i < area && (x / unit + y / unit) % every != 0; i++) {
                sample_at(sample, x, y)[i] = NAN;
            }
        }
    }
}

/* Cells of points stand for their points' matrices; steps by them must get as far as exact ones, to a quarter of the
 * objective, where all points are measured, where patches are and where single points are. */
static void normal_matrices_of_cells_lead_as_far_as_exact_ones(void)
{
    static const struct hals_options exact = {.far = 0};
    static const struct {
        int unit, every;
    } lattices[] = {{1, 1}, {8, 2}, {1, 2}, {1, 4}};
    for (size_t i = 0; i < sizeof lattices / sizeof *lattices; i++) {
        struct sample sample = sample_new(40, 33, 1, 17, 12);
        measure_some(&sample, lattices[i].unit, lattices[i].every);
        double expected = descend_with(&exact, &sample, 4, 1, 30);
        TEST_ASSERT_TRUE(descend(&sample, 4, 1, 30) <= 1.25 * expected);
        sample_finish(&sample);
    }
}

static void what_stands_behind_the_mask_influences_nothing(void)
{
    static const float garbage[] = {NAN, INFINITY, -INFINITY, 1e30F, -7, 1e-42F};
    struct sample sample = sample_new(19, 12, 1, 13, 5);
    float *results[2] = {NULL};
    size_t count = 0;
    sample_punch_holes(&sample);
    for (int dirty = 0; dirty < 2; dirty++) {
        struct bench b = bench_new(&sample, 4, 3, layout_lanes(&opencl));
        int changed = 0;
        for (int i = 0; i < 19 * 12 * 169 && dirty; i++) {
            int x = i % 19, y = i / 19 % 12, u = i / 228 % 13, v = i / 2964;
            int xo = x + u - 6, yo = y + v - 6;
            size_t index = responses_index(&b.responses, x, y, u, v);
            if (xo >= 0 && xo < 19 && yo >= 0 && yo < 12 &&
                !responses_is_measured(&b.responses, 0, index)) {
                b.responses.values[0][index] = garbage[changed++ % 6];
            }
        }
        TEST_ASSERT_TRUE(!dirty || changed > 1000);
        start(&b, NULL);
        bench_run(&b, 6);
        results[dirty] = bench_factors(&b);
        count = 2 * b.count;
        bench_finish(&b);
    }
    TEST_ASSERT_EQUAL_MEMORY(results[0], results[1], count * sizeof(float));
    free(results[0]);
    free(results[1]);
    sample_finish(&sample);
}

static void two_runs_give_the_same_bits(void)
{
    struct sample sample = sample_new(23, 19, 1, 15, 5);
    float *results[2] = {NULL};
    size_t count = 0;
    for (int i = 0; i < 2; i++) {
        struct bench b = bench_new(&sample, 4, 2, layout_lanes(&opencl));
        start(&b, NULL);
        bench_run(&b, 10);
        results[i] = bench_factors(&b);
        count = 2 * b.count;
        bench_finish(&b);
    }
    TEST_ASSERT_EQUAL_MEMORY(results[0], results[1], count * sizeof(float));
    free(results[0]);
    free(results[1]);
    sample_finish(&sample);
}

static void awkward_sizes_stay_finite(void)
{
    static const int sizes[][5] = {/* width, height, window, terms, clusters */
                                   {1, 1, 1, 1, 1},   {1, 1, 31, 4, 1},  {2, 1, 31, 4, 2},
                                   {5, 5, 25, 30, 5}, {3, 40, 41, 4, 1}, {40, 3, 41, 70, 2}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        struct sample sample = sample_new(sizes[i][0], sizes[i][1], 1, sizes[i][2], 5);
        (void)descend(&sample, sizes[i][3], sizes[i][4], 10);
        sample_finish(&sample);
    }
}

static void too_many_terms_are_refused(void)
{
    struct nacre_error error = {0};
    struct sample sample = sample_new(5, 4, 1, 3, 5);
    struct bench b = bench_new(&sample, HALS_TERMS + 1, 1, layout_lanes(&opencl));
    b.problem.responses = &b.responses;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, hals_new(&opencl, &b.problem, NULL, &b.method, &error));
    TEST_ASSERT_EQUAL_STRING(
        "257 terms are too many for hals, which takes 256 at most; use --method mu", error.text);
    TEST_ASSERT_NULL(b.method);
    bench_finish(&b);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(the_first_steps_agree_with_double_precision);
    RUN_TEST(the_first_steps_with_missing_entries_agree_with_double_precision);
    RUN_TEST(the_objective_never_rises);
    RUN_TEST(few_steps_are_better_than_three_hundred_updates);
    RUN_TEST(normal_matrices_of_cells_lead_as_far_as_exact_ones);
    RUN_TEST(what_stands_behind_the_mask_influences_nothing);
    RUN_TEST(two_runs_give_the_same_bits);
    RUN_TEST(awkward_sizes_stay_finite);
    RUN_TEST(too_many_terms_are_refused);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
