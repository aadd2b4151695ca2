/* Grid spacing and window from a pilot's responses. */
#include "made.h"
#include "rig/develop/pilot.h"
#include "unity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SIDE = 61, WINDOW = 41, HALF = WINDOW / 2, RESPONSES = 30 };

static struct nacre_error error;
static struct nacre_scan_info info;
static struct pilot pilot;
static struct made_random random_numbers;

void setUp(void)
{
    info = (struct nacre_scan_info){.width = SIDE, .height = SIDE, .window = WINDOW, .channels = 3};
    random_numbers = (struct made_random){11};
}

void tearDown(void)
{
    pilot_finish(&pilot);
}

/* The ring at chessboard distance r holds rate^r of the middle's energy. */
static double entry(double rate, int ring)
{
    return pow(rate, ring) / (ring ? 8 * ring : 1);
}

/* Responses at random places, whose channels fall by rate, rate + 0.02 and rate + 0.04. */
static void measure(double rate, double noise, int count)
{
    static float response[3 * WINDOW * WINDOW];
    TEST_ASSERT_EQUAL_INT(NACRE_OK, pilot_init(&pilot, &info, noise, &error));
    for (int n = 0; n < count; n++) {
        int x = (int)(SIDE * made_uniform(&random_numbers));
        int y = (int)(SIDE * made_uniform(&random_numbers));
        for (int k = 0; k < 3 * WINDOW * WINDOW; k++) {
            int u = abs(k % WINDOW - HALF);
            int v = abs(k / WINDOW % WINDOW - HALF);
            double channel = floor((double)k / (WINDOW * WINDOW));
            response[k] = (float)(entry(rate + 0.02 * channel, u > v ? u : v) +
                                  noise * made_normal(&random_numbers));
        }
        TEST_ASSERT_EQUAL_INT(NACRE_OK, pilot_add(&pilot, &info, x, y, response, &error));
    }
}

static void leak_of_a_geometric_fall_off_is_exact(void)
{
    measure(0.7, 0, RESPONSES);
    for (int half = 0; half < HALF + 10; half += 3) {
        /* Beyond ring `half` lies rate^(half + 1) of the whole, also where that is beyond the pilot's own window. */
        struct pilot_leak leak = pilot_leak(&pilot, half);
        TEST_ASSERT_DOUBLE_WITHIN(1e-5, pow(0.74, half + 1), leak.worst);
        TEST_ASSERT_DOUBLE_WITHIN(
            1e-5, (pow(0.7, half + 1) + pow(0.72, half + 1) + pow(0.74, half + 1)) / 3, leak.mean);
    }
}

static void smallest_window_within_the_bound_is_chosen(void)
{
    int half;
    measure(0.7, 0, RESPONSES);
    for (int k = 0; k < 8; k++) {
        double bound = 0.2 / pow(1.7, k);
        TEST_ASSERT_EQUAL_INT(NACRE_OK, pilot_choose(&pilot, bound, &half, &error));
        TEST_ASSERT_TRUE(pow(0.74, half + 1) <= bound + 1e-5);
        TEST_ASSERT_TRUE(pow(0.74, half) > bound - 1e-5);
    }
}

static void noise_does_not_hide_the_tail(void)
{
    /* An entry's noise is a thousandth of the middle: a single response loses its light at ring 8. */
    measure(0.7, 1e-3, RESPONSES);
    for (int half = 6; half < HALF; half += 2) {
        struct pilot_leak leak = pilot_leak(&pilot, half);
        double exact = (pow(0.7, half + 1) + pow(0.72, half + 1) + pow(0.74, half + 1)) / 3;
        /* The mean of 30 knows rings up to the 13th, and the rate by which the tail goes on from the 6th to the 13th to
         * 3 %: a fifth after 7 more rings. */
        TEST_ASSERT_DOUBLE_WITHIN(0.2 * exact + 0.002, exact, leak.mean);
        /* One response's light up to there is off by the noise of 27^2 entries, 0.027 of 3.8 in all, or 0.7 %; twice
         * that at the border, where half of a ring stands for all, and three times in the worst of 90. */
        TEST_ASSERT_DOUBLE_WITHIN(0.045, pow(0.74, half + 1), leak.worst);
    }
}

static void pilot_that_is_too_narrow_is_refused(void)
{
    int half;
    measure(0.9, 0, RESPONSES); /* 0.94^21 is 27 % */
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, pilot_choose(&pilot, 0.05, &half, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "wider window"), error.text);
}

static void pilot_without_responses_is_refused(void)
{
    int half;
    measure(0.7, 0, 0);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, pilot_choose(&pilot, 0.05, &half, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "more grids"), error.text);
}

static void many_responses_find_room(void)
{
    measure(0.7, 0, 300);
    TEST_ASSERT_EQUAL_UINT(300, pilot.responses);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, pow(0.74, 5), pilot_leak(&pilot, 4).worst);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(leak_of_a_geometric_fall_off_is_exact);
    RUN_TEST(smallest_window_within_the_bound_is_chosen);
    RUN_TEST(noise_does_not_hide_the_tail);
    RUN_TEST(pilot_that_is_too_narrow_is_refused);
    RUN_TEST(pilot_without_responses_is_refused);
    RUN_TEST(many_responses_find_room);
    return UNITY_END();
}
