/* Each hard case by each method, and what must hold of all of them. */
#include "run.h"

#include "bench.h"
#include "device.h"

#include "factor/layout.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unity.h>

static struct opencl opencl;
static const struct hard_case *current;
static struct hard_how how;

void setUp(void)
{
}

void tearDown(void)
{
}

/* A run in single precision ends where one in double does: not above its objective by more than 1e-3, as steps that are
 * taken or not by a rounding lead elsewhere, and for the updates, which decide nothing, within 1e-4 on either side; below
 * the noise of single precision both are zero. */
static void check_figures(const struct hard_figures *f)
{
    double noise = hard_noise() * f->energy + 1e-30;
    double allowed = (how.method == FACTOR_METHOD_MU ? 1e-4 : 1e-3) * f->reference + noise;
    TEST_ASSERT_TRUE_MESSAGE(f->finite, "a factor or the objective is not finite");
    TEST_ASSERT_TRUE_MESSAGE(f->positive, "a factor is negative");
    TEST_ASSERT_TRUE_MESSAGE(f->rise <= 1e-6, "the objective rose");
    TEST_ASSERT_TRUE_MESSAGE(f->device <= 1, "the device misjudges its objective");
    TEST_ASSERT_TRUE_MESSAGE(f->objective <= f->reference + allowed, "worse than in double");
    TEST_ASSERT_TRUE_MESSAGE(how.method == FACTOR_METHOD_HALS ||
                                 f->objective >= f->reference - allowed,
                             "other than in double");
}

/* Every number in the file is one, none is negative, and each point is counted. Single
 * points may be worse off than with no model at all, as the paper's weights care little for them. */
static void check_material(void)
{
    struct sample sample = hard_sample(current);
    struct nacre_material m = {0};
    struct factor_summary summary = {0};
    hard_material(&sample, current, &opencl, how, FACTOR_STORE_HALF, &m, &summary);
    size_t points = (size_t)m.width * (size_t)m.height,
           planes = (size_t)m.terms * (size_t)m.channels;
    size_t kernels = (size_t)nacre_material_kernel_count(&m) * (size_t)m.channels *
                     (size_t)m.window * (size_t)m.window;
    for (size_t i = 0; i < points * planes; i++) {
        TEST_ASSERT_TRUE(isfinite(m.f[i]) && m.f[i] >= 0 && isfinite(m.h[i]) && m.h[i] >= 0);
    }
    for (size_t i = 0; i < kernels; i++) {
        TEST_ASSERT_TRUE(isfinite(m.kernels[i]) && m.kernels[i] > 0);
    }
    const struct error_range *whole = &summary.error.whole;
    TEST_ASSERT_EQUAL_INT(points, whole->points + summary.error.not_measured + summary.error.dark);
    TEST_ASSERT_TRUE(whole->points == 0 ||
                     (whole->minimum >= 0 && whole->mean <= hard_error(current)));
    TEST_ASSERT_TRUE(isfinite(whole->maximum));
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void a_hard_case_stays_stable(void)
{
    how.half = false;
    struct hard_figures floats = hard_run(current, &opencl, how);
    check_figures(&floats);
    how.half = true;
    struct hard_figures halves = hard_run(current, &opencl, how);
    check_figures(&halves);
    how.half = false;
    check_material();
}

static void run_case(const struct hard_case *hard, char name[80])
{
    current = hard;
    (void)snprintf(name, 80, "%s by %s stays stable%s", hard->name,
                   how.method == FACTOR_METHOD_MU ? "mu" : "hals",
                   how.weight == FACTOR_WEIGHT_RESPONSE ? " with relative errors" : "");
    UnityDefaultTestRun(a_hard_case_stays_stable, name, __LINE__);
}

static void run_cases(void)
{
    static char names[160][80];
    size_t count = 0;
    for (size_t i = 0; i < hard_case_count; i++) {
        for (int m = 0; m < 4; m++) {
            how.method = m % 2 ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS;
            how.weight = m / 2 ? FACTOR_WEIGHT_RESPONSE : FACTOR_WEIGHT_KERNEL;
            /* Relative errors are of all channels together, which the check in double precision is not. */
            if (how.weight == FACTOR_WEIGHT_KERNEL ||
                (hard_cases[i].channels == 1 && hard_steps(&hard_cases[i]) <= 100)) {
                run_case(&hard_cases[i], names[count++]);
            }
        }
    }
}

static void assert_same_bits(const struct hard_case *hard, bool dirty)
{
    struct sample sample = hard_sample(hard);
    size_t count = 0, clean = 0, changed = 0;
    float *first = hard_factors(&sample, hard, &opencl, how, false, &count, &clean);
    float *second = hard_factors(&sample, hard, &opencl, how, dirty, &count, &changed);
    TEST_ASSERT_TRUE(!dirty || changed > 0);
    TEST_ASSERT_EQUAL_MEMORY(first, second, count * sizeof *first);
    free(first);
    free(second);
    sample_finish(&sample);
}

static void the_same_seed_gives_the_same_bits(void)
{
    for (int m = 0; m < 2; m++) {
        how = (struct hard_how){.method = m ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS};
        for (size_t i = 0; i < hard_case_count; i++) {
            if (hard_steps(&hard_cases[i]) <= 100) {
                assert_same_bits(&hard_cases[i], false);
            }
        }
    }
}

static void what_stands_behind_the_mask_influences_nothing(void)
{
    static const char *const names[] = {"entries missing", "responses missing", "row missing",
                                        "infinite entries"};
    for (int m = 0; m < 2; m++) {
        how = (struct hard_how){.method = m ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS};
        for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
            assert_same_bits(hard_case_of(names[i]), true);
        }
    }
}

/* Responses of points beside a hole are factored as well as before: their neighbours' loss does them no harm. */
static void missing_responses_leave_their_neighbours_unharmed(void)
{
    const struct hard_case *ordinary = hard_case_of("ordinary"),
                           *holes = hard_case_of("responses missing");
    for (int m = 0; m < 2; m++) {
        struct sample whole = hard_sample(ordinary), part = hard_sample(holes);
        struct nacre_material a = {0}, b = {0};
        struct factor_summary of_whole = {0}, of_part = {0};
        how = (struct hard_how){.method = m ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS};
        hard_material(&whole, ordinary, &opencl, how, FACTOR_STORE_HALF, &a, &of_whole);
        hard_material(&part, holes, &opencl, how, FACTOR_STORE_HALF, &b, &of_part);
        TEST_ASSERT_TRUE(of_part.error.not_measured > 30);
        /* Fewer responses are easier to fit; some slack, as clusters differ. */
        TEST_ASSERT_TRUE(of_part.error.whole.mean <= 1.1 * of_whole.error.whole.mean);
        factor_summary_finish(&of_whole);
        factor_summary_finish(&of_part);
        nacre_material_finish(&a);
        nacre_material_finish(&b);
        sample_finish(&whole);
        sample_finish(&part);
    }
}

/* The scale of the responses is a unit and nothing else: powers of two change no bit of F and H. */
static void a_power_of_two_changes_no_bit(void)
{
    static const int exponents[] = {-100, -17, 1, 17, 100};
    const struct hard_case *hard = hard_case_of("ordinary");
    for (int m = 0; m < 2; m++) {
        size_t count = 0, changed = 0;
        struct sample plain = hard_sample(hard);
        how = (struct hard_how){.method = m ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS};
        float *expected = hard_factors(&plain, hard, &opencl, how, false, &count, &changed);
        for (size_t i = 0; i < sizeof exponents / sizeof *exponents; i++) {
            struct sample scaled = hard_sample(hard);
            sample_scale(&scaled, ldexpf(1, exponents[i]));
            float *actual = hard_factors(&scaled, hard, &opencl, how, false, &count, &changed);
            TEST_ASSERT_EQUAL_MEMORY(expected, actual, count * sizeof *actual);
            free(actual);
            sample_finish(&scaled);
        }
        free(expected);
        sample_finish(&plain);
    }
}

/* Other factors change roundings, of which forty steps make 1e-5 of the error at most. */
static void any_scale_gives_the_same_error(void)
{
    static const float scales[] = {1e-30F, 1e-5F, 3, 1e5F, 1e30F};
    const struct hard_case *hard = hard_case_of("ordinary");
    for (int m = 0; m < 2; m++) {
        double expected = 0;
        how = (struct hard_how){.method = m ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS};
        for (size_t i = 0; i <= sizeof scales / sizeof *scales; i++) {
            struct sample sample = hard_sample(hard);
            struct nacre_material material = {0};
            struct factor_summary summary = {0};
            if (i > 0) {
                sample_scale(&sample, scales[i - 1]);
            }
            hard_material(&sample, hard, &opencl, how, FACTOR_STORE_FLOAT, &material, &summary);
            expected = i > 0 ? expected : summary.error.whole.mean;
            TEST_ASSERT_DOUBLE_WITHIN(1e-5 * expected, expected, summary.error.whole.mean);
            factor_summary_finish(&summary);
            nacre_material_finish(&material);
            sample_finish(&sample);
        }
    }
}

/* With the weight 1 / ||R_i|| the objective is half the sum of squared relative errors: another program's sum, of all
 * channels and as read from the file, in floats. */
static void the_objective_of_relative_errors_is_theirs(void)
{
    static const char *const names[] = {"ordinary", "dark channel", "entries missing", "vein"};
    for (size_t i = 0; i < 2 * sizeof names / sizeof *names; i++) {
        const struct hard_case *hard = hard_case_of(names[i / 2]);
        struct sample sample = hard_sample(hard);
        struct nacre_material material = {0};
        struct factor_summary summary = {0};
        double sum = 0;
        how = (struct hard_how){.method = i % 2 ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS,
                                .weight = FACTOR_WEIGHT_RESPONSE};
        hard_material(&sample, hard, &opencl, how, FACTOR_STORE_FLOAT, &material, &summary);
        for (int p = 0; p < hard->width * hard->height; p++) {
            double error = (double)summary.error.map[p];
            sum += isnan(error) ? 0 : error * error;
        }
        TEST_ASSERT_DOUBLE_WITHIN(1e-5 * sum, sum / 2, summary.objective);
        factor_summary_finish(&summary);
        nacre_material_finish(&material);
        sample_finish(&sample);
    }
}

/* Where it is called so, extrapolation really overshoots. */
static void extrapolation_that_overshoots_is_taken_back(void)
{
    how = (struct hard_how){.method = FACTOR_METHOD_HALS};
    struct hard_figures f = hard_run(hard_case_of("alternating columns"), &opencl, how);
    TEST_ASSERT_TRUE(f.refusals > 0);
}

static void tests(void)
{
    run_cases();
    RUN_TEST(the_same_seed_gives_the_same_bits);
    RUN_TEST(what_stands_behind_the_mask_influences_nothing);
    RUN_TEST(missing_responses_leave_their_neighbours_unharmed);
    RUN_TEST(a_power_of_two_changes_no_bit);
    RUN_TEST(any_scale_gives_the_same_error);
    RUN_TEST(the_objective_of_relative_errors_is_theirs);
    RUN_TEST(extrapolation_that_overshoots_is_taken_back);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
