/* Tests of the phase-locked loop against closed forms and against the same loop in double precision. */
#include "firmware/loop.h"

#include "firmware/protocol.h"
#include "unity.h"

#include <math.h>

enum { PERIOD = 533333, COAST = 8 };

static struct loop loop;
static uint64_t now; /* ticks */

void setUp(void)
{
    loop_start(&loop, BOARD_GAIN_DEFAULT, COAST);
    now = 1000;
}

void tearDown(void)
{
}

static const uint64_t mask = (UINT64_C(1) << 48) - 1;

static void pulse_after(uint64_t ticks)
{
    now = (now + ticks) & mask;
    loop_index(&loop, now);
}

static void lock(void)
{
    for (int i = 0; i < 5; i++) {
        pulse_after(PERIOD);
    }
    TEST_ASSERT_TRUE(loop.locked);
}

/* Ticks from `now` to the loop's prediction. */
static double ahead(void)
{
    return (double)(int64_t)(loop.next - (now << LOOP_FINE_BITS)) / 65536;
}

static double period(void)
{
    return (double)loop.period / 65536;
}

static void locks_after_four_like_periods(void)
{
    for (int i = 0; i < 4; i++) {
        pulse_after(PERIOD);
        TEST_ASSERT_FALSE(loop.locked);
    }
    pulse_after(PERIOD);
    TEST_ASSERT_TRUE(loop.locked);
    TEST_ASSERT_EQUAL_DOUBLE(PERIOD, ahead());
    TEST_ASSERT_EQUAL_DOUBLE(PERIOD, period());
}

static void starts_from_the_mean_of_its_periods(void)
{
    pulse_after(PERIOD);
    pulse_after(PERIOD + 40);
    pulse_after(PERIOD - 60);
    pulse_after(PERIOD + 10);
    pulse_after(PERIOD + 30);
    TEST_ASSERT_TRUE(loop.locked);
    TEST_ASSERT_EQUAL_DOUBLE(PERIOD + 5, period());
}

static void does_not_lock_while_the_wheel_spins_up(void)
{
    uint64_t spinning = 4 * PERIOD;
    while (spinning > PERIOD) {
        pulse_after(spinning);
        spinning -= spinning / 25;
        TEST_ASSERT_FALSE(loop.locked);
    }
    lock();
}

static void does_not_lock_to_wheels_it_cannot_serve(void)
{
    for (int i = 0; i < 20; i++) {
        pulse_after(LOOP_PERIOD_MAX + 1);
    }
    TEST_ASSERT_FALSE(loop.locked);
    for (int i = 0; i < 20; i++) {
        pulse_after(LOOP_PERIOD_MIN - 1);
    }
    TEST_ASSERT_FALSE(loop.locked);
    for (int i = 0; i < 20; i++) {
        pulse_after(LOOP_PERIOD_MIN);
    }
    TEST_ASSERT_TRUE(loop.locked);
}

/* The independent path: the difference equations in double precision. Floors of 2^-16 tick a turn, which the integral
 * term may add up over its time constant of 2^(gain + 1) turns, make 2^-16 x 2^(2 gain + 2) = 0.25 tick at gain 6. */
static void answers_a_step_of_the_phase_as_the_equations_say(void)
{
    for (uint8_t gain = BOARD_GAIN_MIN; gain <= BOARD_GAIN_MAX; gain++) {
        double next = 0;
        double rate = 0;
        double largest = 0;
        loop_start(&loop, gain, COAST);
        lock();
        uint64_t truth = now;
        for (int turn = 1; turn <= 40 << gain; turn++) {
            truth = (truth + PERIOD) & mask;
            pulse_after((truth + 2000 - now) &
                        mask); /* all pulses come 2000 ticks later from now on */
            double error = 2000 - next;
            next += ldexp(error, -gain) + rate + ldexp(error, -2 * gain - 2);
            rate += ldexp(error, -2 * gain - 2);
            double found = ahead() - PERIOD + 2000;
            largest = fmax(largest, fabs(found - next));
        }
        TEST_ASSERT_DOUBLE_WITHIN(0.3, 0, largest);
        /* It ends where the pulses are. */
        TEST_ASSERT_DOUBLE_WITHIN(0.5, PERIOD, ahead());
        TEST_ASSERT_DOUBLE_WITHIN(0.01, PERIOD, period());
    }
}

/* The lag of a second-order loop is the change of the period per turn over its integral gain; without the integral
 * term it would grow for ever. Pulses on whole ticks leave half a tick of noise, the step is 1 tick a turn. */
static void lags_a_steadily_slowing_wheel_by_the_closed_form(void)
{
    for (uint8_t gain = BOARD_GAIN_MIN; gain <= BOARD_GAIN_MAX; gain++) {
        loop_start(&loop, gain, COAST);
        lock();
        double lag = 0;
        double length = 0;
        for (int turn = 1; turn <= 30 << gain; turn++) {
            uint64_t before = loop.next;
            pulse_after(PERIOD + (uint64_t)turn);
            lag = (double)(int64_t)((now << LOOP_FINE_BITS) - before) / 65536;
            length = (double)(int64_t)(loop.next - before) / 65536 - (PERIOD + turn + 1);
        }
        double expected = ldexp(1, 2 * gain + 2);
        TEST_ASSERT_DOUBLE_WITHIN(expected * 0.01, expected, lag);
        /* The distance of its predictions, which makes an exposure, is one turn all the same. */
        TEST_ASSERT_DOUBLE_WITHIN(0.5, 0, length);
    }
}

static void finds_a_period_that_is_wrong_by_one_tick_at_the_slowest_gain(void)
{
    loop_start(&loop, BOARD_GAIN_MAX, COAST);
    lock();
    for (int turn = 0; turn < 2000; turn++) {
        pulse_after(PERIOD + 1);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.01, PERIOD + 1, period());
}

static void coasts_over_missing_pulses_and_unlocks_after_one_more(void)
{
    lock();
    for (int i = 0; i < COAST; i++) {
        now += PERIOD;
        loop_advance(&loop, now + PERIOD / 8 + 1);
    }
    TEST_ASSERT_TRUE(loop.locked);
    TEST_ASSERT_EQUAL_UINT16(COAST, loop.missed);
    TEST_ASSERT_EQUAL_DOUBLE(PERIOD, ahead());
    pulse_after(PERIOD); /* one pulse makes up for all */
    for (int i = 0; i <= COAST; i++) {
        TEST_ASSERT_TRUE(loop.locked);
        now += PERIOD;
        loop_advance(&loop, now + PERIOD / 8 + 1);
    }
    TEST_ASSERT_FALSE(loop.locked);
    TEST_ASSERT_EQUAL_UINT16(1, loop.unlocks);
    lock();
}

static void a_turn_is_not_missed_before_its_window_has_passed(void)
{
    lock();
    loop_advance(&loop, now + PERIOD + PERIOD / 8);
    TEST_ASSERT_EQUAL_UINT16(0, loop.missed);
    loop_advance(&loop, now + PERIOD + PERIOD / 8 + 1);
    TEST_ASSERT_EQUAL_UINT16(1, loop.missed);
}

static void ignores_pulses_at_impossible_times(void)
{
    lock();
    uint32_t turn = loop.turn;
    pulse_after(PERIOD / 3);
    pulse_after(PERIOD / 3);
    TEST_ASSERT_EQUAL_UINT16(2, loop.spurious);
    TEST_ASSERT_EQUAL_UINT32(turn, loop.turn);
    pulse_after(PERIOD - PERIOD / 3 * 2);
    TEST_ASSERT_EQUAL_UINT32(turn + 1, loop.turn);
    TEST_ASSERT_EQUAL_DOUBLE(PERIOD, ahead());
}

static void a_silence_of_days_is_one_lost_lock(void)
{
    lock();
    pulse_after(UINT64_C(1) << 43);
    TEST_ASSERT_FALSE(loop.locked);
    TEST_ASSERT_EQUAL_UINT16(1, loop.unlocks);
    lock();
}

static void time_may_wrap_at_32_and_48_bits(void)
{
    const uint64_t starts[] = {(UINT64_C(1) << 32) - 7 * PERIOD - 3,
                               (UINT64_C(1) << 48) - 7 * PERIOD - 3};
    for (int i = 0; i < 2; i++) {
        loop_start(&loop, 3, COAST);
        now = starts[i];
        lock();
        for (int turn = 0; turn < 10; turn++) {
            pulse_after(PERIOD);
            TEST_ASSERT_EQUAL_DOUBLE(PERIOD, ahead());
        }
        TEST_ASSERT_TRUE(loop.locked);
        TEST_ASSERT_EQUAL_UINT16(0, (uint16_t)(loop.missed + loop.spurious));
        /* It did wrap. */
        TEST_ASSERT_TRUE((uint32_t)now < (uint32_t)starts[i]);
    }
}

static void predicts_turns_and_phases(void)
{
    lock();
    TEST_ASSERT_TRUE(loop.next == loop_time(&loop, 0, 0));
    TEST_ASSERT_TRUE(loop.next + 2 * loop.period == loop_time(&loop, 2, 0));
    TEST_ASSERT_TRUE(loop.next - loop.period / 2 == loop_time(&loop, -1, 0x8000));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(locks_after_four_like_periods);
    RUN_TEST(starts_from_the_mean_of_its_periods);
    RUN_TEST(does_not_lock_while_the_wheel_spins_up);
    RUN_TEST(does_not_lock_to_wheels_it_cannot_serve);
    RUN_TEST(answers_a_step_of_the_phase_as_the_equations_say);
    RUN_TEST(lags_a_steadily_slowing_wheel_by_the_closed_form);
    RUN_TEST(finds_a_period_that_is_wrong_by_one_tick_at_the_slowest_gain);
    RUN_TEST(coasts_over_missing_pulses_and_unlocks_after_one_more);
    RUN_TEST(a_turn_is_not_missed_before_its_window_has_passed);
    RUN_TEST(ignores_pulses_at_impossible_times);
    RUN_TEST(a_silence_of_days_is_one_lost_lock);
    RUN_TEST(time_may_wrap_at_32_and_48_bits);
    RUN_TEST(predicts_turns_and_phases);
    return UNITY_END();
}
