/* The camera's map with a lens. */
#include "made.h"
#include "rig/develop/camera_map.h"
#include "unity.h"

#include <math.h>

enum { PAIRS = 300 };

static struct camera_map truth;
static struct point_pair pairs[PAIRS];
static struct made_random random_numbers;
static struct nacre_error error;

void setUp(void)
{
    truth = (struct camera_map){{{4.45, 0.16, 6.3, -0.14, 4.38, 10.2, 0.0006, 0.0011, 1}},
                                {{97, 82}, 127, -0.04, 0.012}};
    random_numbers = (struct made_random){5};
}

void tearDown(void)
{
}

static void shake(double deviation)
{
    for (int i = 0; i < PAIRS; i++) {
        struct point surface = {40 * made_uniform(&random_numbers),
                                36 * made_uniform(&random_numbers)};
        struct point seen = camera_map_apply(&truth, surface);
        pairs[i] = (struct point_pair){surface,
                                       {seen.x + deviation * made_normal(&random_numbers),
                                        seen.y + deviation * made_normal(&random_numbers)},
                                       false};
    }
}

/* From an ideal camera that is a little off, with the centre a few pixels from the true one. */
static struct camera_map refined(enum lens_model model)
{
    struct camera_map map = {truth.plane, {{95, 85}, 127, 0, 0}};
    map.plane.m[2] += 1;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera_map_refine(pairs, PAIRS, model, &map, &error),
                                  error.text);
    return map;
}

static void undistorting_undoes_the_lens(void)
{
    const struct camera_map same = {{{1, 0, 0, 0, 1, 0, 0, 0, 1}}, truth.lens};
    for (int i = 0; i < 400; i++) {
        struct point p = {i % 20 * 10, (double)i / 20 * 9};
        struct point back = lens_undistort(&truth.lens, camera_map_apply(&same, p));
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, p.x, back.x);
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, p.y, back.y);
    }
}

static void no_lens_changes_nothing(void)
{
    const struct lens none = {{0, 0}, 0, 0, 0};
    struct point p = lens_undistort(&none, (struct point){3, 4});
    TEST_ASSERT_EQUAL_DOUBLE(3, p.x);
    TEST_ASSERT_EQUAL_DOUBLE(4, p.y);
}

static void exact_pairs_give_the_exact_map(void)
{
    shake(0);
    struct camera_map map = refined(LENS_SHIFTED);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, camera_map_rms(&map, pairs, PAIRS));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 97, map.lens.centre.x);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 82, map.lens.centre.y);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, -0.04, map.lens.k1);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.012, map.lens.k2);
}

static void noise_leaves_what_parameters_cannot_take_up(void)
{
    shake(0.1);
    /* 600 coordinates of deviation 0.1 with 12 fitted: 0.1 sqrt(2) sqrt(588 / 600), known to 1 / sqrt(2 * 588). */
    struct camera_map map = refined(LENS_SHIFTED);
    TEST_ASSERT_DOUBLE_WITHIN(0.14 * 4 * 0.03, 0.14, camera_map_rms(&map, pairs, PAIRS));
    /* A plainer lens cannot. */
    map = refined(LENS_IDEAL);
    TEST_ASSERT_EQUAL_DOUBLE(0, map.lens.k1);
    TEST_ASSERT_TRUE(camera_map_rms(&map, pairs, PAIRS) > 0.3);
}

static void outliers_do_not_count(void)
{
    shake(0);
    for (int i = 0; i < PAIRS; i += 10) {
        pairs[i].camera.x += 20;
        pairs[i].outlier = true;
    }
    struct camera_map map = refined(LENS_SHIFTED);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, camera_map_rms(&map, pairs, PAIRS));
}

static void too_few_pairs_are_refused(void)
{
    struct camera_map map = truth;
    shake(0);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera_map_refine(pairs, 5, LENS_RADIAL, &map, &error));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(undistorting_undoes_the_lens);
    RUN_TEST(no_lens_changes_nothing);
    RUN_TEST(exact_pairs_give_the_exact_map);
    RUN_TEST(noise_leaves_what_parameters_cannot_take_up);
    RUN_TEST(outliers_do_not_count);
    RUN_TEST(too_few_pairs_are_refused);
    return UNITY_END();
}
