/* The model with a kernel per term on samples of known kinds. */
#include "device.h"
#include "recipe.h"

#include "factor/layout.h"
#include "factor/terms.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

static struct opencl opencl;

void setUp(void)
{
}

void tearDown(void)
{
}

/* Fit a recipe and return the mean relative error of the material as stored. */
static double error_of(const struct recipe *recipe, const struct factor_options *options,
                       int channels)
{
    struct sample sample = recipe_make(recipe, 20, 16, channels, 7);
    struct factor_summary summary;
    struct nacre_material m = recipe_fit(&opencl, &sample, options, &summary);
    double error = summary.error.whole.mean;
    recipe_check_history(&m);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
    return error;
}

/* What is fitted are half floats: each entry, and the centre, is off by 2^-12 of itself at most. The planes are constant,
 * which eight bits hold exactly. */
static void one_term_suffices_for_a_homogeneous_sample(void)
{
    struct recipe recipe = {.homogeneous = true, .scale = 1};
    struct factor_options options = recipe_options(1, 10);
    /* Both of the recipe's terms have the same planes: one kernel is their sum. */
    TEST_ASSERT_DOUBLE_WITHIN(0x1p-11, 0, error_of(&recipe, &options, 3));
    options.kernels = FACTOR_KERNELS_FULL;
    TEST_ASSERT_DOUBLE_WITHIN(0x1p-11, 0, error_of(&recipe, &options, 1));
}

/* Eight bits in the square root move a plane by at most a 255th of itself where it is 1, and both ends by twice that; the
 * centre's logarithm, here over less than a factor of 4, by log(4) / 254 / 2. */
static void planes_of_two_kinds_are_found(void)
{
    struct recipe recipe = {.checks = true, .scale = 1};
    struct factor_options options = recipe_options(2, 60);
    TEST_ASSERT_TRUE(error_of(&recipe, &options, 1) < 0.01);
    TEST_ASSERT_TRUE(error_of(&recipe, &options, 3) < 0.01);
    options.planes = FACTOR_PLANES_SEPARATE;
    TEST_ASSERT_TRUE(error_of(&recipe, &options, 3) < 0.01);
    options.weight = FACTOR_WEIGHT_KERNEL;
    TEST_ASSERT_TRUE(error_of(&recipe, &options, 1) < 0.01);
}

/* The data's scale moves no digit but by the power of two nearest to it: 1e-8 and 1e8 are none, so that roundings
 * differ; half of the error of one unit in float32's last digit a step would be 60 * 6e-8. */
static void scale_does_not_matter(void)
{
    struct recipe recipe = {.noise = true, .scale = 1};
    struct factor_options options = recipe_options(2, 20);
    double plain = error_of(&recipe, &options, 1);
    recipe.scale = 0x1p-30;
    TEST_ASSERT_DOUBLE_WITHIN(1e-3 * plain, plain, error_of(&recipe, &options, 1));
    recipe.scale = 0x1p30;
    TEST_ASSERT_DOUBLE_WITHIN(1e-3 * plain, plain, error_of(&recipe, &options, 1));
}

static void more_terms_than_the_data_supports_do_no_harm(void)
{
    struct recipe recipe = {.homogeneous = true, .scale = 1};
    struct factor_options options = recipe_options(12, 30);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0, error_of(&recipe, &options, 1));
}

/* A gain of exp(0.4) over the sample makes neighbours differ by 2 %, and points 3 apart by 6 %. Divided out, what is left
 * is the planes' eight bits, as above; not divided out, it would be all of 2 %. */
static void a_gain_at_both_ends_is_found(void)
{
    struct recipe recipe = {.slope = 0.4, .scale = 1};
    struct factor_options options = recipe_options(2, 60);
    struct sample sample = recipe_make(&recipe, 20, 16, 1, 7);
    struct factor_summary summary;
    struct nacre_material m = recipe_fit(&opencl, &sample, &options, &summary);
    TEST_ASSERT_NOT_NULL(m.gain);
    TEST_ASSERT_TRUE(summary.error.whole.mean < 0.01);
    /* R(x_i, x_o) has exp(-slope (x_o - x_i) / width): gain(x) = exp(-slope x / width) up to a constant. Cosines up to
     * the fourth bend a straight line by about 2 % of its rise. */
    double ratio = log((double)m.gain[2] / (double)m.gain[17]);
    TEST_ASSERT_DOUBLE_WITHIN(0.03, -0.4 * (2 - 17) / 20.0, ratio * (ratio > 0 ? 1 : -1));
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void what_is_not_reciprocal_gets_planes_for_both_ends(void)
{
    struct recipe recipe = {.one_way = true, .scale = 1};
    struct factor_options options = recipe_options(3, 40);
    struct sample sample = recipe_make(&recipe, 20, 16, 1, 7);
    struct factor_summary summary;
    struct nacre_material m = recipe_fit(&opencl, &sample, &options, &summary);
    TEST_ASSERT_NULL(m.gain);
    TEST_ASSERT_NOT_NULL(m.h);
    recipe_check_history(&m);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    options.kernels =
        FACTOR_KERNELS_FULL; /* and a kernel that is not even fits it: eight bits are what is left */
    m = recipe_fit(&opencl, &sample, &options, &summary);
    TEST_ASSERT_TRUE(summary.error.whole.mean < 0.01);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void holes_are_filled(void)
{
    struct recipe recipe = {.noise = true, .scale = 1};
    struct factor_options options = recipe_options(3, 20);
    struct sample sample = recipe_make(&recipe, 20, 16, 3, 7);
    struct factor_summary summary;
    sample_punch_holes(&sample);
    struct nacre_material m = recipe_fit(&opencl, &sample, &options, &summary);
    recipe_check_history(&m);
    TEST_ASSERT_TRUE(summary.error.not_measured > 0);
    TEST_ASSERT_TRUE(summary.error.whole.mean < 0.1);
    for (int i = 0; i < m.width * m.height * m.channels; i++) {
        TEST_ASSERT_TRUE(m.centre[i] > 0);
    }
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void what_does_not_belong_together_is_refused(void)
{
    struct recipe recipe = {.scale = 1};
    struct sample sample = recipe_make(&recipe, 8, 8, 1, 5);
    struct responses responses = sample_load(&sample, layout_lanes(&opencl));
    struct factor_summary summary;
    struct nacre_material m;
    for (int i = 0; i < 3; i++) {
        struct factor_options options = recipe_options(i == 2 ? TERMS_MOST + 1 : 2, 5);
        struct nacre_error error = {0};
        options.clusters = i == 0 ? 3 : 0;
        options.method = i == 1 ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS;
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, factorize_responses(&responses, 0.5, &options, &opencl,
                                                                NULL, &m, &summary, &error));
        TEST_ASSERT_NOT_NULL(strstr(error.text, "--model clusters"));
    }
    responses_finish(&responses);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(one_term_suffices_for_a_homogeneous_sample);
    RUN_TEST(planes_of_two_kinds_are_found);
    RUN_TEST(scale_does_not_matter);
    RUN_TEST(more_terms_than_the_data_supports_do_no_harm);
    RUN_TEST(a_gain_at_both_ends_is_found);
    RUN_TEST(what_is_not_reciprocal_gets_planes_for_both_ends);
    RUN_TEST(holes_are_filled);
    RUN_TEST(what_does_not_belong_together_is_refused);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
