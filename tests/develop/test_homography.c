/* Fitting homographies. */
#include "made.h"
#include "rig/develop/homography.h"
#include "unity.h"

#include <math.h>
#include <string.h>

enum { PAIRS = 300 };

/* Off-axis, turned, 4.4 pixels a point. */
static const struct homography truth = {{4.4, 0.3, 12, -0.2, 4.1, 20, 0.0008, 0.0015, 1}};
static struct point_pair pairs[PAIRS];
static struct made_random noise;
static struct nacre_error error;

void setUp(void)
{
    noise = (struct made_random){3};
    for (int i = 0; i < PAIRS; i++) {
        struct point p = {48 * made_uniform(&noise), 40 * made_uniform(&noise)};
        pairs[i] = (struct point_pair){p, homography_apply(&truth, p), false};
    }
}

void tearDown(void)
{
}

static void shake(double deviation)
{
    for (int i = 0; i < PAIRS; i++) {
        pairs[i].camera.x += deviation * made_normal(&noise);
        pairs[i].camera.y += deviation * made_normal(&noise);
    }
}

/* Largest distance between the images under both over the surface. */
static double difference(const struct homography *found)
{
    double largest = 0;
    for (int y = 0; y <= 40; y += 4) {
        for (int x = 0; x <= 48; x += 4) {
            struct point_pair pair = {
                {x, y}, homography_apply(&truth, (struct point){x, y}), false};
            largest = fmax(largest, homography_distance(found, &pair));
        }
    }
    return largest;
}

static void exact_pairs_give_the_exact_map(void)
{
    struct homography found;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, homography_fit(pairs, PAIRS, &found, &error));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0, difference(&found));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0, homography_rms(&found, pairs, PAIRS));
}

static void four_pairs_are_enough_and_three_are_not(void)
{
    struct homography found;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, homography_fit(pairs, 4, &found, &error));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, difference(&found));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, homography_fit(pairs, 3, &found, &error));
    pairs[0].outlier = true;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, homography_fit(pairs, 4, &found, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, homography_refine(pairs, 4, &found, &error));
}

static void pairs_on_a_line_are_refused(void)
{
    struct homography found;
    for (int i = 0; i < PAIRS; i++) {
        pairs[i].surface = (struct point){i * 0.1, 3 + i * 0.05};
        pairs[i].camera = homography_apply(&truth, pairs[i].surface);
    }
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, homography_fit(pairs, PAIRS, &found, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "line"));
}

static void refining_reaches_the_accuracy_that_noise_allows(void)
{
    struct homography found;
    shake(0.1);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, homography_fit(pairs, PAIRS, &found, &error));
    double before = homography_rms(&found, pairs, PAIRS);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, homography_refine(pairs, PAIRS, &found, &error));
    double after = homography_rms(&found, pairs, PAIRS);
    TEST_ASSERT_TRUE(after <= before);
    /* Residuals of 600 coordinates less 8 parameters, each of deviation 0.1: their root mean square scatters by 2 %. */
    TEST_ASSERT_DOUBLE_WITHIN(0.1 * sqrt(2) * 0.06, 0.1 * sqrt(2 * 592.0 / 600), after);
    /* A map of 8 parameters from 600 coordinates: 0.1 sqrt(8/600) on average, and up to some 4 times that at a corner. */
    TEST_ASSERT_TRUE(difference(&found) < 0.1 * sqrt(8.0 / 600) * 5);
}

static void refining_minimises_distance_in_the_camera(void)
{
    /* Compared with plain coordinate descent over the 8 parameters: no small step of any makes the sum smaller. */
    struct homography found;
    shake(0.5);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, homography_fit(pairs, PAIRS, &found, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, homography_refine(pairs, PAIRS, &found, &error));
    double least = homography_rms(&found, pairs, PAIRS);
    for (int i = 0; i < 9; i++) {
        for (int sign = -1; sign <= 1; sign += 2) {
            struct homography other = found;
            other.m[i] *= 1 + sign * 1e-4;
            TEST_ASSERT_TRUE(homography_rms(&other, pairs, PAIRS) > least);
        }
    }
}

static void refining_recovers_from_a_poor_start(void)
{
    struct homography found = {{4, 0, 15, 0, 4.3, 15, 0, 0, 1}};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, homography_refine(pairs, PAIRS, &found, &error));
    TEST_ASSERT_DOUBLE_WITHIN(1e-7, 0, difference(&found));
}

static void outliers_do_not_count(void)
{
    struct homography found;
    for (int i = 0; i < PAIRS; i += 10) {
        pairs[i].camera.x += 30;
        pairs[i].outlier = true;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, homography_fit(pairs, PAIRS, &found, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, homography_refine(pairs, PAIRS, &found, &error));
    TEST_ASSERT_DOUBLE_WITHIN(1e-8, 0, difference(&found));
    for (int i = 0; i < PAIRS; i++) {
        pairs[i].outlier = false;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, homography_fit(pairs, PAIRS, &found, &error));
    TEST_ASSERT_TRUE(difference(&found) > 1);
}

static void inverse_undoes_the_map(void)
{
    struct homography back;
    struct homography flat = {{1, 2, 3, 2, 4, 6, 0, 0, 1}};
    TEST_ASSERT_TRUE(homography_invert(&truth, &back));
    struct point there = homography_apply(&truth, (struct point){17, 31});
    struct point again = homography_apply(&back, there);
    TEST_ASSERT_DOUBLE_WITHIN(1e-11, 17, again.x);
    TEST_ASSERT_DOUBLE_WITHIN(1e-11, 31, again.y);
    TEST_ASSERT_FALSE(homography_invert(&flat, &back));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(exact_pairs_give_the_exact_map);
    RUN_TEST(four_pairs_are_enough_and_three_are_not);
    RUN_TEST(pairs_on_a_line_are_refused);
    RUN_TEST(refining_reaches_the_accuracy_that_noise_allows);
    RUN_TEST(refining_minimises_distance_in_the_camera);
    RUN_TEST(refining_recovers_from_a_poor_start);
    RUN_TEST(outliers_do_not_count);
    RUN_TEST(inverse_undoes_the_map);
    return UNITY_END();
}
