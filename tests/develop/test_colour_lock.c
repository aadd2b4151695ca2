/* Tests of what the trigger board is for: colours under a spinning wheel, with exposures that it makes and with others. */
#include "colour_lock.h"

#include "unity.h"

#include <stdio.h>

static struct colour_lock_sums truth, sums;
static struct colour_lock_trigger board;
static double worst_ns; /* of the board's lengths */

void setUp(void)
{
}

void tearDown(void)
{
}

static struct colour_lock_error scan(const struct colour_lock_trigger *trigger)
{
    colour_lock_scan(trigger, &sums);
    struct colour_lock_error error = colour_lock_judge(&sums, &truth);
    printf("error of colour: %.0f ppm rms, %.0f ppm at most, %.0f ppm without brightness\n",
           error.rms * 1e6, error.worst * 1e6, error.hue_rms * 1e6);
    return error;
}

static void exposures_of_exactly_whole_turns_see_no_wheel_wherever_they_begin(void)
{
    const int64_t none = 0;
    struct colour_lock_trigger exact;
    colour_lock_free(&none, 1, 1, &exact);
    TEST_ASSERT_TRUE(scan(&exact).worst < 1e-9);
}

/* A length that is off by d of n turns gives up to 2 d / n too much of the colour that passes, a third of the wheel, and
 * d / n too little of the others; patterns, white and black take part, the shortest exposure most. */
static void a_locked_scan_is_as_good_as_its_lengths(void)
{
    struct colour_lock_error error = scan(&board);
    double shortest_ns = 1e9 / COLOUR_LOCK_HZ;
    TEST_ASSERT_TRUE(worst_ns < 10000);
    TEST_ASSERT_TRUE(error.rms > 0);
    TEST_ASSERT_TRUE(error.worst < 2 * 3 * worst_ns / shortest_ns);
    TEST_ASSERT_TRUE(error.rms < 200e-6);
}

static void a_scan_that_is_not_locked_is_worse_by_far(void)
{
    /* A tenth of a millisecond either way is a good machine's. */
    const int64_t off_ns[] = {100000, -60000, 30000, -100000, 60000, -30000, 80000, -80000};
    struct colour_lock_error locked = scan(&board);
    struct colour_lock_trigger fair;
    colour_lock_free(off_ns, 8, 1, &fair);
    struct colour_lock_error wild = scan(&fair);
    TEST_ASSERT_TRUE(wild.rms > 20 * locked.rms);
    TEST_ASSERT_TRUE(wild.hue_rms > 20 * locked.hue_rms);
}

int main(void)
{
    UNITY_BEGIN();
    colour_lock_scan(NULL, &truth);
    worst_ns = colour_lock_board(20, 3, &board);
    RUN_TEST(exposures_of_exactly_whole_turns_see_no_wheel_wherever_they_begin);
    RUN_TEST(a_locked_scan_is_as_good_as_its_lengths);
    RUN_TEST(a_scan_that_is_not_locked_is_worse_by_far);
    return UNITY_END();
}
