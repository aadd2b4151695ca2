/* Each hard case with a kernel per term, and those that are hard for it alone. */
#include "terms_run.h"

#include "device.h"
#include "run.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

static struct opencl opencl;
static const struct hard_case *current;

void setUp(void)
{
}

void tearDown(void)
{
}

/* What holds at every step, by sums in double precision.
 *
 * Slope: kernels are found by sweeps of coordinate descent until one changes numbers v by d with sum A_ii d_i^2 <= 1e-13 sum
 * A_ii v_i^2. Then the gradient of v_i is what later changes of its sweep made it, at most sqrt(A_ii) sum_j sqrt(A_jj) |d_j|
 * over the 3 M numbers at its own and the neighbouring distances. Along a term's kernel, which has 3 numbers beside each j,
 * that is at most 3 sqrt(M) sqrt(1e-13) times the roots of sum A_ii v_i^2 of this term and of all. As nothing is negative,
 * these are at most the energies of the term and of the model, and that at most the responses'. 3 sqrt(20) 3.2e-7 = 4.2e-6;
 * the equations are floats of sums with Kahan's correction, 6e-8 of each of their parts, M of them: 1.2e-6. Together below
 * 1e-5. */
static void check_figures(const struct hard_terms_figures *f)
{
    TEST_ASSERT_TRUE_MESSAGE(f->finite, "a plane, a kernel or the objective is not finite");
    TEST_ASSERT_TRUE_MESSAGE(f->positive, "a plane or a kernel is negative");
    TEST_ASSERT_TRUE_MESSAGE(f->rise <= 1e-6, "the objective rose");
    TEST_ASSERT_TRUE_MESSAGE(f->device <= 1, "the device misjudges its objective");
    TEST_ASSERT_TRUE_MESSAGE(f->slope <= 1e-5, "the kernels are not the best for their planes");
}

/* Every number in the file is one, none is negative, each point is counted, and the model is better than none. */
static void check_material(void)
{
    struct factor_summary summary = {0};
    struct nacre_material m = {0};
    /* Eight bits in square root reach down to 1/65025 of a plane's largest value, which a spike of 1e5 is beyond. */
    int bits = strcmp(current->name, "spike") == 0 ? 0 : 8;
    hard_terms_material(current, bits, &opencl, &m, &summary);
    size_t points = (size_t)m.width * (size_t)m.height;
    size_t window = (size_t)m.window * (size_t)m.window;
    for (size_t i = 0; i < points * (size_t)m.terms * (size_t)m.factor_channels; i++) {
        TEST_ASSERT_TRUE(isfinite(m.f[i]) && m.f[i] >= 0);
        TEST_ASSERT_TRUE(!m.h || (isfinite(m.h[i]) && m.h[i] >= 0));
    }
    for (size_t i = 0; i < (size_t)m.terms * (size_t)m.channels * window; i++) {
        TEST_ASSERT_TRUE(isfinite(m.kernels[i]) && m.kernels[i] >= 0);
    }
    TEST_ASSERT_EQUAL_INT(points, summary.error.whole.points + summary.error.not_measured +
                                      summary.error.dark);
    TEST_ASSERT_TRUE(isfinite(summary.error.whole.maximum) && summary.error.whole.mean <= 1);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
}

static void a_hard_case_stays_stable(void)
{
    struct hard_terms_figures f = hard_terms_run(current, &opencl, HARD_AS_FOUND, 0, 0);
    check_figures(&f);
    check_material();
}

static void run_cases(void)
{
    static char names[64][80];
    for (size_t i = 0; i < hard_case_count && i < 64; i++) {
        current = &hard_cases[i];
        (void)snprintf(names[i], sizeof names[i], "%s with a kernel per term stays stable",
                       current->name);
        UnityDefaultTestRun(a_hard_case_stays_stable, names[i], __LINE__);
    }
}

/* A term that is 0 stays so, as does all else: the other two go where two go that start as they do. Terms are taken in
 * twos, so sums of two and of three run alike but for their roundings, which forty steps can make 1e-3 of. */
static void a_dead_term_does_no_harm(void)
{
    const struct hard_case *hard = hard_case_of("ordinary");
    struct hard_terms_figures f = hard_terms_run(hard, &opencl, HARD_DEAD, 3, 0);
    check_figures(&f);
    TEST_ASSERT_TRUE(f.objective < 0.5 * f.energy);
}

/* Of two that are one, the objective is no worse than of one; and they part, as points' values are set one after the
 * other: it is better. */
static void identical_terms_part(void)
{
    const struct hard_case *hard = hard_case_of("ordinary");
    struct hard_terms_figures one = hard_terms_run(hard, &opencl, HARD_AS_FOUND, 1, 0);
    struct hard_terms_figures two = hard_terms_run(hard, &opencl, HARD_IDENTICAL, 2, 0);
    check_figures(&two);
    TEST_ASSERT_TRUE(two.objective < one.objective);
}

/* More terms than there are points are no worse than one. */
static void more_terms_than_points_do_no_harm(void)
{
    const struct hard_case *hard = hard_case_of("terms above points");
    struct hard_terms_figures one = hard_terms_run(hard, &opencl, HARD_AS_FOUND, 1, 0);
    struct hard_terms_figures many = hard_terms_run(hard, &opencl, HARD_AS_FOUND, 0, 0);
    TEST_ASSERT_TRUE(many.objective <= one.objective);
}

/* In a window wide enough most steps visit its middle alone: what holds at every step holds here too, and as many steps
 * come farther than such that each visit all. */
static void steps_on_the_middle_of_the_window_stay_stable(void)
{
    struct hard_case wide = *hard_case_of("ordinary");
    wide.window = 25;
    wide.width = 20;
    struct hard_terms_figures f = hard_terms_run(&wide, &opencl, HARD_RECIPROCAL, 0, 12);
    struct hard_terms_figures whole = hard_terms_run(&wide, &opencl, HARD_WHOLE, 0, 12);
    TEST_ASSERT_TRUE(f.reach < wide.window / 2);
    TEST_ASSERT_EQUAL_INT(wide.window / 2, whole.reach);
    check_figures(&f);
    TEST_ASSERT_TRUE(f.objective < whole.objective);
}

/* The right half takes in and lets out a hundred-thousandth of what the left half does. */
static void darken_half(struct sample *s)
{
    int half = s->window / 2, area = s->window * s->window;
    for (int point = 0; point < s->width * s->height; point++) {
        int x = point % s->width;
        float *response = sample_at(s, x, point / s->width);
        for (int i = 0; i < area * s->channels; i++) {
            int ends = (x >= s->width / 2) + (x + i % s->window - half >= s->width / 2);
            response[i] *= ends == 0 ? 1.0F : ends == 1 ? 1e-5F : 1e-10F;
        }
    }
}

/* A material as it is stored, and whether it is said to want finer bits. */
struct stored {
    int bits;
    double error;
    bool warned;
};

static struct stored store(struct hard_case hard, int bits)
{
    struct factor_summary summary = {0};
    struct nacre_material m = {0};
    hard_terms_material(&hard, bits, &opencl, &m, &summary);
    struct stored stored = {.bits = m.bits, .error = summary.error.whole.mean};
    for (size_t i = 0; i < m.warning_count; i++) {
        stored.warned = stored.warned || strstr(m.warnings[i], "raise the mean error");
    }
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    return stored;
}

/* Of planes that span 1e5 to 1, eight bits in square root, 65025 to 1, hold one level where it is dark, half as much again
 * as is wanted: its light off the centre, a square, is off by more than itself. Where bits are to be chosen these are half
 * floats: ten bits, 1e6 to 1, hold three levels there, a seventh off. What is noise of a tenth is as good with eight, a step of
 * which is a 127th of a value at most where it is a quarter of the largest or more. */
static void bits_of_planes_are_told_to_be_too_few_or_chosen(void)
{
    struct hard_case dark = *hard_case_of("ordinary");
    dark.change = darken_half;
    struct stored coarse = store(dark, 8), chosen = store(dark, FACTOR_BITS_AUTO);
    TEST_ASSERT_TRUE(coarse.warned);
    TEST_ASSERT_FALSE(chosen.warned);
    TEST_ASSERT_EQUAL_INT(0, chosen.bits);
    TEST_ASSERT_TRUE(chosen.error < 0.25 * coarse.error);
    chosen = store(*hard_case_of("negative values"), FACTOR_BITS_AUTO);
    TEST_ASSERT_EQUAL_INT(8, chosen.bits);
    TEST_ASSERT_FALSE(store(*hard_case_of("ordinary"), 8).warned);
}

static void tests(void)
{
    run_cases();
    RUN_TEST(a_dead_term_does_no_harm);
    RUN_TEST(identical_terms_part);
    RUN_TEST(more_terms_than_points_do_no_harm);
    RUN_TEST(steps_on_the_middle_of_the_window_stay_stable);
    RUN_TEST(bits_of_planes_are_told_to_be_too_few_or_chosen);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
