/* Sampling a material with a kernel per term, against sums over all x_o in double precision. */
#include "made_material.h"
#include "nacre/evaluate.h"

#include <math.h>
#include <string.h>
#include <unity.h>

enum { K = 5, AREA = K * K, DRAWS = 20000 };

void setUp(void)
{
}

void tearDown(void)
{
}

static const struct made_material terms = {.layout = NACRE_KERNEL_PER_TERM,
                                           .pixel = NACRE_FLOAT,
                                           .channels = 3,
                                           .factor_channels = 1,
                                           .with_centre = true};

static struct nacre_sampler *make(const struct nacre_material *material)
{
    struct nacre_error error = {0};
    struct nacre_sampler *sampler = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_sampler_new(material, &sampler, &error),
                                  error.text);
    return sampler;
}

/* Two numbers in [0, 1) of 24 bits. */
static void next(uint64_t *state, float u[2])
{
    for (int i = 0; i < 2; i++) {
        *state = *state * 6364136223846793005u + 1442695040888963407u;
        u[i] = (float)(*state >> 40) * 0x1p-24f;
    }
}

/* What the draws of one point come to. */
struct draws {
    double counts[AREA];
    double sum[2], square[2]; /* of weight, and weight times a function of x_o */
};

static double seen(int xo, int yo)
{
    return 1 + xo + 0.5 * yo * yo;
}

static struct draws draw(const struct nacre_sampler *sampler, int channel, int xi, int yi)
{
    struct draws draws = {.counts = {0}};
    uint64_t state = 5;
    for (int i = 0; i < DRAWS; i++) {
        float u[2];
        int xo = -9, yo = -9;
        next(&state, u);
        double weight = (double)nacre_sampler_draw(sampler, channel, xi, yi, u, &xo, &yo);
        TEST_ASSERT_TRUE(weight >= 0 && xo - xi >= -2 && xo - xi <= 2 && yo - yi >= -2 &&
                         yo - yi <= 2);
        draws.counts[(yo - yi + 2) * K + xo - xi + 2]++;
        double values[2] = {weight, weight * seen(xo, yo)};
        for (int f = 0; f < 2; f++) {
            draws.sum[f] += values[f];
            draws.square[f] += values[f] * values[f];
        }
    }
    return draws;
}

/* Of one point: probabilities sum to 1 and are above 0 wherever R is; draws follow them; and weights give sums of R.
 * 25 probabilities of a float's rounding sum to 1 within 25 * 6e-8. A chi-square of 24 degrees of freedom is 24 with a
 * deviation of sqrt(48) = 6.9: 66 is six of them, of a chance below 1e-5 (its tail at 66 is 8e-6). A mean of 20000 draws is
 * off by more than 4.5 of its deviations once in 150000. The draws are the same in every run. */
static void expect_sampled(const struct nacre_material *m, int channel, int xi, int yi)
{
    struct nacre_sampler *sampler = make(m);
    struct draws draws = draw(sampler, channel, xi, yi);
    double sum = 0, chi_square = 0, exact[2] = {0};
    for (int i = 0; i < AREA; i++) {
        int xo = xi + i % K - 2, yo = yi + i / K - 2;
        double p = (double)nacre_sampler_probability(sampler, channel, xi, yi, xo, yo);
        double value = (double)nacre_material_evaluate(m, channel, xi, yi, xo, yo);
        TEST_ASSERT_TRUE(p > 0 || !(value > 0));
        sum += p;
        exact[0] += value;
        exact[1] += value * seen(xo, yo);
        if (p > 0) {
            chi_square += pow(draws.counts[i] - p * DRAWS, 2) / (p * DRAWS);
        } else {
            TEST_ASSERT_TRUE(draws.counts[i] == 0);
        }
    }
    TEST_ASSERT_DOUBLE_WITHIN(25 * 6e-8, 1, sum);
    TEST_ASSERT_TRUE(chi_square < 66);
    for (int f = 0; f < 2; f++) {
        double mean = draws.sum[f] / DRAWS;
        double deviation = sqrt(fmax(0, draws.square[f] / DRAWS - mean * mean) / DRAWS);
        TEST_ASSERT_DOUBLE_WITHIN(4.5 * deviation + 1e-6 * exact[f], exact[f], mean);
        TEST_ASSERT_TRUE(deviation < 0.02 * exact[f]); /* or the check would say little */
    }
    nacre_sampler_free(sampler);
}

/* In the middle and in two corners, where half of the window and more lies outside the sample. */
static void draws_follow_the_probabilities_and_give_sums_of_the_response(void)
{
    for (int variant = 0; variant < 8; variant++) {
        struct made_material wanted = terms;
        wanted.factor_channels = variant & 1 ? 3 : 1;
        wanted.with_h = variant & 2;
        wanted.with_centre = variant & 4;
        struct nacre_material m = made_material(wanted);
        expect_sampled(&m, 0, 5, 4);
        expect_sampled(&m, 2, 0, 0);
        expect_sampled(&m, 1, 10, 8);
        nacre_material_finish(&m);
    }
}

/* A term's scale may stand in H or in its kernel: the same lobes, hence the same draws, whose weights are off by a few
 * roundings, as 1024 is a power of two. */
static void spreading_a_scale_differently_changes_nothing(void)
{
    struct made_material wanted = terms;
    wanted.with_h = true;
    struct nacre_material m = made_material(wanted), spread = made_material(wanted);
    for (int i = 0; i < 11 * 9; i++) {
        spread.h[11 * 9 + i] *= 1024; /* of term 1 */
    }
    for (int i = 0; i < 3 * AREA; i++) {
        spread.kernels[3 * AREA + i] /= 1024;
    }
    struct nacre_sampler *one = make(&m), *other = make(&spread);
    struct draws plain = draw(one, 1, 4, 4), same = draw(other, 1, 4, 4);
    TEST_ASSERT_EQUAL_MEMORY(plain.counts, same.counts, sizeof plain.counts);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 * plain.sum[1], plain.sum[1], same.sum[1]);
    nacre_sampler_free(one);
    nacre_sampler_free(other);
    nacre_material_finish(&m);
    nacre_material_finish(&spread);
}

static void terms_that_died_are_never_chosen(void)
{
    struct made_material wanted = terms;
    wanted.with_h = true;
    struct nacre_material m = made_material(wanted);
    memset(m.kernels, 0, (size_t)(3 * AREA) * sizeof *m.kernels); /* term 0 */
    memset(m.h + 99, 0, 99 * sizeof *m.h);                        /* term 1 */
    for (int c = 0; c < 3; c++) {
        m.kernels[(6 + c) * AREA] = 0; /* an entry of term 2, and the last */
        m.kernels[(6 + c) * AREA + AREA - 1] = 0;
    }
    expect_sampled(&m, 2, 5, 4);
    nacre_material_finish(&m);
}

/* All of the light leaves at the centre, or none does. */
static void points_without_terms_have_their_centre_or_nothing(void)
{
    static const float u[2] = {0x1.fffffep-1f, 0x1.fffffep-1f};
    struct nacre_material m = made_material(terms);
    size_t point = 4 * 11 + 5;
    for (size_t t = 0; t < 3; t++) {
        m.f[t * 99 + point] = 0;
    }
    struct nacre_sampler *sampler = make(&m);
    int xo = -9, yo = -9;
    TEST_ASSERT_EQUAL_FLOAT(m.centre[99 + point],
                            nacre_sampler_draw(sampler, 1, 5, 4, u, &xo, &yo));
    TEST_ASSERT_EQUAL_INT(5, xo);
    TEST_ASSERT_EQUAL_INT(4, yo);
    TEST_ASSERT_EQUAL_FLOAT(1, nacre_sampler_probability(sampler, 1, 5, 4, 5, 4));
    m.centre[99 + point] = 0; /* no table is made of it */
    TEST_ASSERT_TRUE(nacre_sampler_draw(sampler, 1, 5, 4, u, &xo, &yo) == 0);
    TEST_ASSERT_EQUAL_INT(5, xo);
    TEST_ASSERT_TRUE(nacre_sampler_probability(sampler, 1, 5, 4, 5, 4) == 0);
    nacre_sampler_free(sampler);
    nacre_material_finish(&m);
}

static void nothing_is_chosen_beyond_the_window(void)
{
    struct nacre_material m = made_material(terms);
    struct nacre_sampler *sampler = make(&m);
    TEST_ASSERT_TRUE(nacre_sampler_probability(sampler, 0, 5, 4, 8, 4) == 0);
    TEST_ASSERT_TRUE(nacre_sampler_probability(sampler, 0, 5, 4, 5, -2147483647) == 0);
    TEST_ASSERT_TRUE(nacre_sampler_probability(sampler, 0, 5, 4, 7, 6) > 0);
    nacre_sampler_free(sampler);
    nacre_material_finish(&m);
}

static void other_layouts_are_refused(void)
{
    struct nacre_error error = {0};
    struct made_material wanted = terms;
    struct nacre_sampler *sampler = (struct nacre_sampler *)&error;
    wanted.layout = NACRE_KERNEL_SINGLE;
    wanted.mixed = 1;
    struct nacre_material m = made_material(wanted);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, nacre_sampler_new(&m, &sampler, &error));
    TEST_ASSERT_NULL(sampler);
    TEST_ASSERT_NOT_NULL(strstr(error.text, "nacre_material_sample"));
    nacre_sampler_free(NULL);
    nacre_material_finish(&m);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(draws_follow_the_probabilities_and_give_sums_of_the_response);
    RUN_TEST(spreading_a_scale_differently_changes_nothing);
    RUN_TEST(terms_that_died_are_never_chosen);
    RUN_TEST(points_without_terms_have_their_centre_or_nothing);
    RUN_TEST(nothing_is_chosen_beyond_the_window);
    RUN_TEST(other_layouts_are_refused);
    return UNITY_END();
}
