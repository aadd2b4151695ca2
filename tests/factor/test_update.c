/* The update kernels against the double-precision reference, and what they promise of any run. */
#include "bench.h"
#include "device.h"

#include "factor/layout.h"
#include "factor/random.h"
#include "factor/update.h"

#include <math.h>
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

static void bench_start(struct bench *b, const struct update_tile *tile)
{
    struct nacre_error error = {0};
    b->problem.responses = &b->responses;
    bench_succeed(update_new(&opencl, &b->problem, tile, &b->method, &error), &error);
    if (!b->method) {
        abort(); /* cannot be, which analysers do not know */
    }
}

/* Every entry within 1e-4 of itself, the requirement; entries of 0 in double may be anything up to the floor. */
static void assert_close(const double *expected, const float *actual, size_t count,
                         const char *what)
{
    for (size_t i = 0; i < count; i++) {
        double difference = fabs(expected[i] - (double)actual[i]);
        if (!(difference <= 1e-4 * expected[i] + 1.01 * (double)UPDATE_FLOOR)) {
            char text[160];
            (void)snprintf(text, sizeof text, "%s[%zu]: %.9g in double, %.9g", what, i, expected[i],
                           (double)actual[i]);
            TEST_FAIL_MESSAGE(text);
        }
    }
}

static void compare_one_iteration(struct bench *b, const struct update_tile *tile)
{
    struct nacre_error error = {0};
    bench_start(b, tile);
    for (int c = 0; c < b->responses.channels; c++) {
        double objective = 0, measured = 0;
        bench_read(b, c);
        struct reference reference = bench_reference(b, c);
        double expected = reference_objective(&reference), start = expected;
        bench_succeed(b->method->ops->step(b->method, c, &objective, &error), &error);
        /* Float sums of some hundred numbers each, added in double: 1e-5 leaves room for their roundings. */
        TEST_ASSERT_DOUBLE_WITHIN(1e-5 * expected, expected, objective);
        reference_update(&reference, false);
        reference_update(&reference, true);
        bench_read(b, c);
        assert_close(reference.f, b->f, b->count, "F");
        assert_close(reference.h, b->h, b->count, "H");
        expected = reference_objective(&reference);
        bench_succeed(b->method->ops->measure(b->method, c, &measured, &error), &error);
        /* Now F and H differ by roundings between the two, too; where the fit is exact that alone is left of it, 1e-6 of
         * the values squared. */
        TEST_ASSERT_DOUBLE_WITHIN(1e-4 * expected + 1e-12 * start, expected, measured);
        bench_reference_finish(&reference);
    }
}

struct shape {
    int width, height, window, terms, clusters, channels;
};

static void compare_shape(struct shape shape, int lanes)
{
    struct sample sample = sample_new(shape.width, shape.height, shape.channels, shape.window, 5);
    struct bench b = bench_new(&sample, shape.terms, shape.clusters, lanes);
    compare_one_iteration(&b, NULL);
    bench_finish(&b);
    sample_finish(&sample);
}

static void one_iteration_agrees_with_double_precision(void)
{
    /* width, height, window, terms, clusters, channels */
    static const struct shape shapes[] = {
        {1, 1, 1, 1, 1, 1},     {1, 1, 7, 1, 1, 1},     {1, 13, 5, 2, 1, 1},  {13, 1, 5, 2, 2, 1},
        {17, 11, 5, 4, 3, 3},   {16, 16, 9, 6, 4, 1},   {31, 7, 25, 3, 5, 1}, {5, 5, 25, 12, 5, 1},
        {37, 19, 11, 12, 1, 1}, {23, 29, 13, 20, 7, 1}, {33, 5, 3, 3, 6, 3},  {8, 3, 67, 2, 2, 1},
        {8, 3, 135, 2, 1, 1},
    };
    for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++) {
        compare_shape(shapes[i], layout_lanes(&opencl));
    }
}

static void every_tile_gives_the_same_result(void)
{
    static const struct update_tile tiles[] = {{1, 1, 1}, {3, 3, 5}};
    for (size_t i = 0; i < sizeof tiles / sizeof *tiles; i++) {
        struct sample sample = sample_new(21, 11, 1, 7, 5);
        struct bench b = bench_new(&sample, 5, i == 0 ? 1 : 2, layout_lanes(&opencl));
        compare_one_iteration(&b, &tiles[i]);
        bench_finish(&b);
        sample_finish(&sample);
    }
}

/* A tile tells how sums are spread over registers and work-items, not what is added to what: a trial may change it between
 * two runs that are to give the same bits. */
static void no_tile_changes_a_bit(void)
{
    static const struct update_tile tiles[] = {{2, 4, 2}, {1, 1, 1}, {3, 3, 5}, {4, 2, 1}};
    struct sample sample = sample_new(21, 11, 1, 7, 5);
    float *expected = NULL;
    for (size_t i = 0; i < sizeof tiles / sizeof *tiles; i++) {
        struct bench b = bench_new(&sample, 5, 2, layout_lanes(&opencl));
        bench_start(&b, &tiles[i]);
        bench_run(&b, 5);
        float *factors = bench_factors(&b);
        expected = expected ? expected : factors;
        TEST_ASSERT_EQUAL_MEMORY(expected, factors, 2 * b.count * sizeof *factors);
        if (factors != expected) {
            free(factors);
        }
        bench_finish(&b);
    }
    free(expected);
    sample_finish(&sample);
}

static void one_iteration_with_missing_entries_agrees_with_double_precision(void)
{
    for (int clusters = 1; clusters <= 3; clusters += 2) {
        struct sample sample = sample_new(19, 12, 3, 7, 5);
        sample_punch_holes(&sample);
        struct bench b = bench_new(&sample, 4, clusters, layout_lanes(&opencl));
        TEST_ASSERT_TRUE(b.responses.mask_needed);
        compare_one_iteration(&b, NULL);
        bench_finish(&b);
        sample_finish(&sample);
    }
}

static void one_iteration_with_negative_entries_agrees_with_double_precision(void)
{
    for (int holes = 0; holes < 2; holes++) {
        struct sample sample = sample_new(19, 12, 1, 7, 5);
        for (size_t i = 0; i < 19 * 12 * 49; i += 3) {
            sample.responses[i] -= 0.05F;
        }
        if (holes) {
            sample_punch_holes(&sample);
        }
        struct bench b = bench_new(&sample, 4, 2, layout_lanes(&opencl));
        TEST_ASSERT_TRUE(b.responses.negative);
        compare_one_iteration(&b, NULL);
        bench_finish(&b);
        sample_finish(&sample);
    }
}

/* Against the rounded responses half floats are held to what floats are. Against the true ones each entry of R is off by
 * 2^-11 at most, and so are the numerators of F, sums of nothing negative; those of H get both R's and F's error, its
 * denominators F's twice. */
static void half_floats_agree_with_double_precision(void)
{
    for (int variant = 0; variant < 4; variant++) {
        struct sample sample = sample_new(19, 12, 3, 7, 5);
        if (variant & 1) {
            sample_punch_holes(&sample);
        }
        struct bench b = bench_new(&sample, 4, variant & 2 ? 3 : 1, layout_lanes(&opencl));
        bench_start(&b, NULL);
        bench_read(&b, 0);
        struct reference true_one = bench_reference(&b, 0);
        method_free(b.method);
        responses_finish(&b.responses);
        b.responses = sample_load_half(&sample, layout_lanes(&opencl));
        compare_one_iteration(&b, NULL);
        bench_read(&b, 0);
        reference_update(&true_one, false);
        reference_update(&true_one, true);
        double worst = 0;
        for (size_t i = 0; i < b.count; i++) {
            /* These kernels are the same for both, so F takes the scale of half floats. */
            double difference = fabs(ldexp((double)b.f[i], -15) - true_one.f[i]);
            worst = fmax(worst, true_one.f[i] > 0 ? difference / true_one.f[i] : 0);
            TEST_ASSERT_DOUBLE_WITHIN(4 * 0x1p-11 * true_one.h[i] + (double)UPDATE_FLOOR,
                                      true_one.h[i], (double)b.h[i]);
        }
        TEST_ASSERT_TRUE(worst <= 0x1p-11 + 1e-5);
        TEST_ASSERT_TRUE(worst > 1e-5); /* it was half floats */
        bench_reference_finish(&true_one);
        bench_finish(&b);
        sample_finish(&sample);
    }
}

/* F and H of channel 0 after some steps, appended in memory the caller frees. */
static float *factors_after(struct bench *b, int steps)
{
    bench_start(b, NULL);
    bench_run(b, steps);
    return bench_factors(b);
}

static void what_stands_behind_the_mask_influences_nothing(void)
{
    static const float garbage[] = {NAN, INFINITY, -INFINITY, 1e30F, -7, 1e-42F};
    for (int clusters = 1; clusters <= 3; clusters += 2) {
        struct sample sample = sample_new(19, 12, 1, 7, 5);
        sample_punch_holes(&sample);
        struct bench a = bench_new(&sample, 4, clusters, layout_lanes(&opencl));
        struct bench b = bench_new(&sample, 4, clusters, layout_lanes(&opencl));
        size_t changed = 0;
        for (int i = 0; i < 19 * 12 * 49; i++) {
            size_t index =
                responses_index(&b.responses, i % 19, i / 19 % 12, i / 228 % 7, i / 1596);
            int xo = i % 19 + i / 228 % 7 - 3, yo = i / 19 % 12 + i / 1596 - 3;
            if (xo >= 0 && xo < 19 && yo >= 0 && yo < 12 &&
                !responses_is_measured(&b.responses, 0, index)) {
                b.responses.values[0][index] = garbage[i % 6];
                changed++;
            }
        }
        TEST_ASSERT_TRUE(changed > 1000);
        float *clean = factors_after(&a, 5), *dirty = factors_after(&b, 5);
        TEST_ASSERT_EQUAL_MEMORY(clean, dirty, 2 * a.count * sizeof *clean);
        free(clean);
        free(dirty);
        bench_finish(&a);
        bench_finish(&b);
        sample_finish(&sample);
    }
}

static void two_runs_give_the_same_bits(void)
{
    struct sample sample = sample_new(23, 9, 1, 9, 5);
    struct bench a = bench_new(&sample, 4, 2, layout_lanes(&opencl));
    struct bench b = bench_new(&sample, 4, 2, layout_lanes(&opencl));
    float *one = factors_after(&a, 20), *two = factors_after(&b, 20);
    TEST_ASSERT_EQUAL_MEMORY(one, two, 2 * a.count * sizeof *one);
    free(one);
    free(two);
    bench_finish(&a);
    bench_finish(&b);
    sample_finish(&sample);
}

/* Each lane adds the same numbers in the same order whatever the vector's width. */
static void the_width_of_vectors_does_not_change_a_bit(void)
{
    struct sample sample = sample_new(23, 9, 1, 9, 5);
    float *first = NULL;
    for (int lanes = 4; lanes <= 16; lanes *= 2) {
        struct update_tile tile = {2, 4, 2};
        struct bench b = bench_new(&sample, 4, 2, lanes);
        bench_start(&b, &tile);
        bench_run(&b, 5);
        bench_read(&b, 0);
        if (!first) {
            first = malloc(b.count * sizeof *first);
            memcpy(first, b.f, b.count * sizeof *first);
        }
        TEST_ASSERT_EQUAL_MEMORY(first, b.f, b.count * sizeof *first);
        bench_finish(&b);
    }
    free(first);
    sample_finish(&sample);
}

static void a_power_of_two_changes_nothing_but_the_scale(void)
{
    static const int exponents[] = {-60, -1, 7, 90};
    struct sample sample = sample_new(13, 9, 1, 9, 5);
    struct bench a = bench_new(&sample, 4, 2, layout_lanes(&opencl));
    float *expected = factors_after(&a, 10);
    for (size_t i = 0; i < sizeof exponents / sizeof *exponents; i++) {
        struct sample scaled = sample_new(13, 9, 1, 9, 5);
        sample_scale(&scaled, ldexpf(1, exponents[i]));
        struct bench b = bench_new(&scaled, 4, 2, layout_lanes(&opencl));
        float *actual = factors_after(&b, 10);
        TEST_ASSERT_EQUAL_INT(a.responses.exponent[0] + exponents[i], b.responses.exponent[0]);
        TEST_ASSERT_EQUAL_MEMORY(expected, actual, 2 * a.count * sizeof *actual);
        free(actual);
        bench_finish(&b);
        sample_finish(&scaled);
    }
    free(expected);
    bench_finish(&a);
    sample_finish(&sample);
}

static void check_descent(struct sample *sample, int terms, int clusters)
{
    struct nacre_error error = {0};
    struct bench b = bench_new(sample, terms, clusters, layout_lanes(&opencl));
    double previous = INFINITY, objective = 0, first = 0;
    bench_start(&b, NULL);
    for (int i = 0; i <= 200; i++) {
        bench_succeed(b.method->ops->step(b.method, 0, &objective, &error), &error);
        TEST_ASSERT_TRUE(isfinite(objective));
        TEST_ASSERT_TRUE(objective <= previous * (1 + 1e-6));
        first = i == 0 ? objective : first;
        previous = objective;
    }
    TEST_ASSERT_TRUE(objective <= first);
    bench_read(&b, 0);
    for (size_t i = 0; i < b.count; i++) {
        TEST_ASSERT_TRUE(isfinite(b.f[i]) && b.f[i] >= 0 && isfinite(b.h[i]) && b.h[i] >= 0);
    }
    bench_finish(&b);
}

static void the_objective_never_rises(void)
{
    struct sample plain = sample_new(24, 17, 1, 9, 5), holes = sample_new(24, 17, 1, 9, 6);
    struct sample dark_point = sample_new(24, 17, 1, 9, 7), dark = sample_new(24, 17, 1, 9, 8);
    struct sample spike = sample_new(24, 17, 1, 9, 9), negative = sample_new(24, 17, 1, 9, 10);
    sample_punch_holes(&holes);
    memset(sample_at(&dark_point, 5, 5), 0, 81 * sizeof(float));
    sample_scale(&dark, 0);
    for (size_t i = 0; i < 24 * 17 * 81; i++) {
        spike.responses[i] *= i / 81 == 100 ? 1e5F : 1;
        negative.responses[i] -= i % 5 ? 0 : 0.02F;
    }
    check_descent(&plain, 6, 1);
    check_descent(&plain, 4, 4);
    check_descent(&holes, 6, 2);
    check_descent(&dark_point, 6, 1);
    check_descent(&dark, 4, 1);
    check_descent(&spike, 6, 2);
    check_descent(&negative, 6, 1);
    sample_finish(&plain);
    sample_finish(&holes);
    sample_finish(&dark_point);
    sample_finish(&dark);
    sample_finish(&spike);
    sample_finish(&negative);
}

/* A sample of rank 2 under a known kernel is found again, with two terms to spare as multiplicative updates creep in the
 * end: the objective gets below what noise of 1 % (uniform, variance 1e-4 / 3) would leave of the squares, which are all
 * there is without factors. */
static void data_made_by_the_model_is_recovered(void)
{
    struct nacre_error error = {0};
    struct sample sample = sample_new(20, 15, 1, 7, 1);
    struct bench b = bench_new(&sample, 4, 1, layout_lanes(&opencl));
    double objective = 0, squares = 0;
    responses_finish(&b.responses);
    for (int y = 0; y < 15; y++) {
        for (int x = 0; x < 20; x++) {
            for (int i = 0; i < 49; i++) {
                int xo = x + i % 7 - 3, yo = y + i / 7 - 3;
                double product = (x < 10 ? 1 : 0.1) * (xo < 8 ? 1 : 0.2) +
                                 (y < 8 ? 0.1 : 2) * (yo < 9 ? 0.3 : 1);
                bool inside = xo >= 0 && xo < 20 && yo >= 0 && yo < 15;
                sample_at(&sample, x, y)[i] = inside ? (float)product * b.kernels[i] : 0;
            }
        }
    }
    b.responses = sample_load(&sample, layout_lanes(&opencl));
    for (size_t i = 0; i < 20 * 15 * 49; i++) {
        double value = ldexp((double)sample.responses[i], -b.responses.exponent[0]);
        squares += value * value / (double)b.kernels[i % 49] / 2;
    }
    bench_start(&b, NULL);
    bench_run(&b, 3000);
    bench_succeed(b.method->ops->measure(b.method, 0, &objective, &error), &error);
    TEST_ASSERT_TRUE(objective < 1e-4 / 3 * squares);
    bench_finish(&b);
    sample_finish(&sample);
}

/* (F * ratio / unit)^(1 + a) * unit, from the plain update: pow in float is good to 16 units in the last place. */
static void regularising_raises_each_update_to_a_power(void)
{
    struct nacre_error error = {0};
    struct sample sample = sample_new(9, 8, 1, 5, 5);
    struct bench a = bench_new(&sample, 4, 1, layout_lanes(&opencl));
    struct bench b = bench_new(&sample, 4, 1, layout_lanes(&opencl));
    b.problem.regularise = 0.01;
    bench_start(&a, NULL);
    bench_start(&b, NULL);
    bench_succeed(update_half_step(a.method, 0, false, &error), &error);
    bench_succeed(update_half_step(b.method, 0, false, &error), &error);
    bench_read(&a, 0);
    bench_read(&b, 0);
    for (size_t i = 0; i < a.count; i++) {
        double expected = 0.5 * pow((double)a.f[i] / 0.5, 1.01); /* unit = 1 / sqrt(terms) */
        TEST_ASSERT_DOUBLE_WITHIN(3e-6 * expected, expected, (double)b.f[i]);
    }
    bench_finish(&a);
    bench_finish(&b);
    sample_finish(&sample);
}

static void factors_written_are_read_back(void)
{
    struct nacre_error error = {0};
    struct sample sample = sample_new(9, 8, 3, 5, 5);
    struct bench b = bench_new(&sample, 3, 1, layout_lanes(&opencl));
    float *f = malloc(b.count * sizeof *f);
    bench_start(&b, NULL);
    for (size_t i = 0; i < b.count; i++) {
        f[i] = (float)i;
    }
    bench_succeed(b.method->ops->write(b.method, 1, f, f, &error), &error);
    bench_read(&b, 1);
    TEST_ASSERT_EQUAL_MEMORY(f, b.f, b.count * sizeof *f);
    TEST_ASSERT_EQUAL_MEMORY(f, b.h, b.count * sizeof *f);
    bench_read(&b, 0);
    TEST_ASSERT_TRUE(memcmp(f, b.f, b.count * sizeof *f) != 0);
    free(f);
    bench_finish(&b);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(one_iteration_agrees_with_double_precision);
    RUN_TEST(every_tile_gives_the_same_result);
    RUN_TEST(no_tile_changes_a_bit);
    RUN_TEST(one_iteration_with_missing_entries_agrees_with_double_precision);
    RUN_TEST(one_iteration_with_negative_entries_agrees_with_double_precision);
    RUN_TEST(half_floats_agree_with_double_precision);
    RUN_TEST(what_stands_behind_the_mask_influences_nothing);
    RUN_TEST(two_runs_give_the_same_bits);
    RUN_TEST(the_width_of_vectors_does_not_change_a_bit);
    RUN_TEST(a_power_of_two_changes_nothing_but_the_scale);
    RUN_TEST(the_objective_never_rises);
    RUN_TEST(data_made_by_the_model_is_recovered);
    RUN_TEST(regularising_raises_each_update_to_a_power);
    RUN_TEST(factors_written_are_read_back);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
