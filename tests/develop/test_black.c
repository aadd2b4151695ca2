/* Statistics over frames and the black level. */
#include "made.h"
#include "rig/develop/black.h"
#include "unity.h"

#include <math.h>
#include <string.h>

enum { PIXELS = 400, FRAMES = 100 };

static struct made_random noise;
static struct moments values, variances;
static float frame[PIXELS], variance[PIXELS];
static struct nacre_error error;

/* Level 50 + pixel, deviation 2. */
static void draw_black(void)
{
    for (int i = 0; i < PIXELS; i++) {
        frame[i] = (float)(50 + i + 2 * made_normal(&noise));
        variance[i] = 4;
    }
}

void setUp(void)
{
    noise = (struct made_random){7};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, moments_init(&values, PIXELS, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, moments_init(&variances, PIXELS, &error));
}

void tearDown(void)
{
    moments_finish(&values);
    moments_finish(&variances);
}

static void gather(int frames)
{
    for (int n = 0; n < frames; n++) {
        draw_black();
        moments_add(&values, frame);
        moments_add(&variances, variance);
    }
}

static void one_pass_equals_two_passes(void)
{
    /* A level that is large against its spread is where sums of squares lose all digits. */
    static float all[50];
    double mean = 0;
    double square = 0;
    struct moments one;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, moments_init(&one, 1, &error));
    for (int n = 0; n < 50; n++) {
        all[n] = (float)(1e6 + made_normal(&noise));
        mean += (double)all[n] / 50;
        moments_add(&one, &all[n]);
    }
    for (int n = 0; n < 50; n++) {
        square += (all[n] - mean) * (all[n] - mean) / 49;
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, mean, moments_mean(&one, 0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, square, moments_variance(&one, 0));
    moments_finish(&one);
}

static void values_not_measured_are_left_out(void)
{
    const float numbers[] = {3, NAN, 5};
    struct moments one;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, moments_init(&one, 1, &error));
    TEST_ASSERT_TRUE(isnan(moments_mean(&one, 0)));
    for (int n = 0; n < 3; n++) {
        moments_add(&one, &numbers[n]);
        TEST_ASSERT_TRUE(isnan(moments_variance(&one, 0)) == (n < 2));
    }
    TEST_ASSERT_EQUAL_DOUBLE(4, moments_mean(&one, 0));
    TEST_ASSERT_EQUAL_DOUBLE(2, moments_variance(&one, 0));
    moments_finish(&one);
}

static void quantiles_are_those_of_the_normal_distribution(void)
{
    /* Published values (Abramowitz and Stegun, table 26.5). */
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 2.3263479, normal_quantile(0.99));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 1.2815516, normal_quantile(0.9));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0, normal_quantile(0.5));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, -1.6448536, normal_quantile(0.05));
}

/* Mean and share of zeros of black frames after the level is taken off. */
static void take_off(enum black_mode mode, double *mean, double *zeros)
{
    struct black_level level;
    int count = 0;
    *mean = 0;
    *zeros = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          black_level_init(&level, &values, &variances, mode, 0.99, &error));
    for (int n = 0; n < 100; n++) {
        draw_black();
        black_level_subtract(&level, frame);
        for (int i = 0; i < PIXELS; i++) {
            *mean += (double)frame[i];
            *zeros += frame[i] == 0 ? 1 : 0;
            count++;
        }
    }
    *mean /= count;
    *zeros /= count;
    black_level_finish(&level);
}

static void subtracting_leaves_black_at_zero_on_average(void)
{
    double mean;
    double zeros;
    gather(FRAMES);
    take_off(BLACK_SUBTRACT, &mean, &zeros);
    /* Each pixel's mean is known to 2/sqrt(100), that of 400 pixels to 0.01, the frames add as much again. */
    TEST_ASSERT_DOUBLE_WITHIN(0.06, 0, mean);
    TEST_ASSERT_TRUE(zeros < 0.001);
}

static void clipping_makes_99_percent_of_black_zero(void)
{
    double mean;
    double zeros;
    gather(FRAMES);
    take_off(BLACK_CLIP, &mean, &zeros);
    /* The limit scatters with the 100 frames it is made of: the share that passes rises from 1 to 1.2 %. */
    TEST_ASSERT_DOUBLE_WITHIN(0.003, 0.988, zeros);
    /* What passes lies above 2.33 deviations, so black is bright by about 0.01 * 2.7 * 2. */
    TEST_ASSERT_DOUBLE_WITHIN(0.03, 0.06, mean);
}

static void few_frames_lean_on_the_foretold_variance(void)
{
    struct black_level level;
    gather(2);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          black_level_init(&level, &values, &variances, BLACK_CLIP, 0.99, &error));
    for (int i = 0; i < PIXELS; i++) {
        /* Two frames alone would put the limit anywhere from the mean upwards. The foretold variance counts 8 of 9. */
        TEST_ASSERT_TRUE(level.limit[i] - level.mean[i] > 2.3263 * 2 * sqrt(8.0 / 9) - 1e-4);
    }
    black_level_finish(&level);
}

static void not_measured_stays_not_measured(void)
{
    struct black_level level;
    gather(4);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          black_level_init(&level, &values, &variances, BLACK_CLIP, 0.99, &error));
    draw_black();
    frame[3] = NAN;
    black_level_subtract(&level, frame);
    TEST_ASSERT_TRUE(isnan(frame[3]));
    black_level_finish(&level);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(one_pass_equals_two_passes);
    RUN_TEST(values_not_measured_are_left_out);
    RUN_TEST(quantiles_are_those_of_the_normal_distribution);
    RUN_TEST(subtracting_leaves_black_at_zero_on_average);
    RUN_TEST(clipping_makes_99_percent_of_black_zero);
    RUN_TEST(few_frames_lean_on_the_foretold_variance);
    RUN_TEST(not_measured_stays_not_measured);
    return UNITY_END();
}
