/* The projector's fall-off told from reciprocal responses. */
#include "made.h"
#include "rig/develop/falloff.h"
#include "unity.h"

#include <math.h>
#include <stdlib.h>

enum { WIDTH = 40, HEIGHT = 30, WINDOW = 9, HALF = WINDOW / 2 };

static struct nacre_error error;
static struct nacre_scan_info info;
static struct falloff_pairs pairs;
static struct falloff falloff;
static struct made_random random_numbers;
static double strength; /* of the fall-off */

void setUp(void)
{
    info = (struct nacre_scan_info){
        .width = WIDTH, .height = HEIGHT, .window = WINDOW, .channels = 3, .pixel = NACRE_FLOAT};
    random_numbers = (struct made_random){7};
    strength = 0.3;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, falloff_pairs_init(&pairs, WIDTH, HEIGHT, &error));
}

void tearDown(void)
{
    falloff_pairs_finish(&pairs);
    falloff_finish(&falloff);
}

/* E: brightest off the middle, with an edge that falls faster than a parabola. */
static double light(int x, int y)
{
    double across = (x - 14) / 26.0;
    double down = (y - 18) / 20.0;
    return pow(1 + across * across + 0.5 * down * down, -strength);
}

/* Reciprocal, but nowhere even: patches of two densities, and brighter to the right. */
static double transfer(int xi, int yi, int xo, int yo)
{
    double dense = ((xi / 5 + yi / 4) % 2 ? 0.5 : 1) * ((xo / 5 + yo / 4) % 2 ? 0.5 : 1);
    double trend = exp(0.02 * (xi + xo));
    return 0.2 * dense * trend * exp(-hypot(xi - xo, yi - yo) / 1.3);
}

static void respond(int x, int y, double noise, float *response)
{
    for (int k = 0; k < 3 * WINDOW * WINDOW; k++) {
        int xo = x + k % WINDOW - HALF;
        int yo = y + k / WINDOW % WINDOW - HALF;
        bool inside = xo >= 0 && yo >= 0 && xo < WIDTH && yo < HEIGHT;
        double exact = inside ? transfer(x, y, xo, yo) * light(x, y) / light(xo, yo) : 0;
        response[k] = inside ? (float)(exact * (1 + noise * made_normal(&random_numbers))) : 0;
    }
}

/* Every `step`-th point is measured. */
static void measure(double noise, int step)
{
    static float response[3 * WINDOW * WINDOW];
    for (int y = 0; y < HEIGHT; y += step) {
        for (int x = 0; x < WIDTH; x += step) {
            respond(x, y, noise, response);
            falloff_pairs_add(&pairs, &info, x, y, response);
        }
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, falloff_find(&pairs, &falloff, &error));
}

/* Largest departure of found from true E, both relative to their values in the middle. */
static double worst(void)
{
    double off = 0;
    float middle = falloff.light[HEIGHT / 2 * WIDTH + WIDTH / 2];
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double truth = light(i % WIDTH, i / WIDTH) / light(WIDTH / 2, HEIGHT / 2);
        off = fmax(off, fabs((double)(falloff.light[i] / middle) / truth - 1));
    }
    return off;
}

static void falloff_of_a_reciprocal_sample_is_found(void)
{
    measure(0, 1);
    /* Without noise what is left is how well a polynomial of degree 4 follows log E: 0.4 % in the farthest corner. */
    TEST_ASSERT_DOUBLE_WITHIN(0.006, 0, worst());
    TEST_ASSERT_TRUE(falloff.range > 0.2);
}

static void noise_moves_it_by_no_more_than_it_says(void)
{
    measure(0.05, 1);
    TEST_ASSERT_TRUE(falloff.doubt > 0.0005 && falloff.doubt < 0.02);
    TEST_ASSERT_DOUBLE_WITHIN(0.006 + 4 * falloff.doubt, 0, worst());
}

static void even_light_stays_even(void)
{
    strength = 0;
    measure(0.05, 1);
    TEST_ASSERT_DOUBLE_WITHIN(4 * falloff.doubt, 0, worst());
}

static void few_pairs_that_say_little_leave_light_even(void)
{
    measure(0, 4); /* no two measured points are within reach of each other */
    TEST_ASSERT_EQUAL_UINT(0, falloff.pairs);
    TEST_ASSERT_EQUAL_DOUBLE(0, falloff.range);
    TEST_ASSERT_EQUAL_FLOAT(1, falloff.light[0]);
}

static void applying_it_gives_responses_of_even_light(void)
{
    static float response[3 * WINDOW * WINDOW];
    measure(0, 1);
    respond(3, 4, 0, response);
    falloff_apply(&falloff, &info, 3, 4, response);
    for (int k = 0; k < 3 * WINDOW * WINDOW; k++) {
        int xo = 3 + k % WINDOW - HALF;
        int yo = 4 + k / WINDOW % WINDOW - HALF;
        double exact = xo >= 0 && yo >= 0 ? transfer(3, 4, xo, yo) : 0;
        TEST_ASSERT_DOUBLE_WITHIN(0.003 * exact, exact, (double)response[k]);
    }
}

static void points_not_measured_are_left_out(void)
{
    static float response[3 * WINDOW * WINDOW];
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        respond(i % WIDTH, i / WIDTH, 0, response);
        if (i % 7 == 0) {
            response[WINDOW + 3] = NAN;
        }
        if (i % 5 != 0) {
            falloff_pairs_add(&pairs, &info, i % WIDTH, i / WIDTH, response);
        }
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, falloff_find(&pairs, &falloff, &error));
    TEST_ASSERT_DOUBLE_WITHIN(0.007, 0, worst());
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(falloff_of_a_reciprocal_sample_is_found);
    RUN_TEST(noise_moves_it_by_no_more_than_it_says);
    RUN_TEST(even_light_stays_even);
    RUN_TEST(few_pairs_that_say_little_leave_light_even);
    RUN_TEST(applying_it_gives_responses_of_even_light);
    RUN_TEST(points_not_measured_are_left_out);
    return UNITY_END();
}
