/* Tests of the schedule of edges, with a loop that stands still. */
#include "firmware/schedule.h"

#include "unity.h"

enum { PERIOD = 533333 };

static struct schedule schedule;
static struct loop loop;
static const struct board_command two_turns = {.command = BOARD_EXPOSE, .id = 7, .turns = 2};

/* Turn 100 begins at tick 10^9. */
enum { NEXT = 1000000000 };

void setUp(void)
{
    loop = (struct loop){.next = (uint64_t)NEXT << LOOP_FINE_BITS,
                         .period = (uint64_t)PERIOD << LOOP_FINE_BITS,
                         .turn = 100,
                         .locked = true};
    schedule_begin(&schedule, &two_turns);
}

void tearDown(void)
{
}

static void nothing_is_due_when_idle_or_unlocked_or_armed(void)
{
    struct schedule idle = {.state = SCHEDULE_IDLE};
    TEST_ASSERT_FALSE(schedule_due(&idle, &loop, NEXT - 10000));
    loop.locked = false;
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT - 30000));
    loop.locked = true;
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT - 30000));
    TEST_ASSERT_TRUE(schedule_due(&schedule, &loop, NEXT - 20000));
    schedule.armed = true;
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT - 20000));
}

static void rises_with_the_first_turn_that_leaves_time(void)
{
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT - SCHEDULE_AHEAD - 1));
    TEST_ASSERT_EQUAL_UINT32(100, schedule.turn);
    schedule_restart(&schedule);
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT - SCHEDULE_AHEAD + 1));
    TEST_ASSERT_EQUAL_UINT32(101, schedule.turn);
}

static void rises_in_the_present_turn_if_its_phase_is_to_come(void)
{
    schedule.command.phase = 0xc000;
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT - PERIOD / 2));
    TEST_ASSERT_EQUAL_UINT32(99, schedule.turn);
}

static void an_edge_is_due_at_its_very_tick(void)
{
    loop.next += 0x8000; /* half a tick rounds up */
    (void)schedule_due(&schedule, &loop, NEXT - PERIOD / 2);
    TEST_ASSERT_TRUE(schedule_due(&schedule, &loop, NEXT - SCHEDULE_LATE - 1));
    TEST_ASSERT_EQUAL_UINT64(NEXT + 1, schedule.ticks);
}

static void falls_whole_turns_after_it_rose(void)
{
    (void)schedule_due(&schedule, &loop, NEXT - PERIOD / 2);
    TEST_ASSERT_TRUE(schedule_due(&schedule, &loop, NEXT - 10000));
    schedule.armed = true;
    schedule_edge(&schedule);
    TEST_ASSERT_EQUAL_INT(SCHEDULE_FALL, schedule.state);
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT + 10)); /* two turns ahead: far */
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT + 2 * PERIOD - SCHEDULE_AHEAD - 1));
    loop.next += 2 * loop.period;
    loop.turn += 2;
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT + 2 * PERIOD - SCHEDULE_AHEAD - 1));
    TEST_ASSERT_TRUE(schedule_due(&schedule, &loop, NEXT + 2 * PERIOD - SCHEDULE_AHEAD));
    TEST_ASSERT_EQUAL_UINT64(NEXT + 2 * PERIOD, schedule.ticks);
    schedule_edge(&schedule);
    TEST_ASSERT_EQUAL_INT(SCHEDULE_IDLE, schedule.state);
}

static void a_late_rise_takes_the_next_turn(void)
{
    (void)schedule_due(&schedule, &loop, NEXT - PERIOD / 2);
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT - SCHEDULE_LATE + 1));
    TEST_ASSERT_FALSE(schedule_due(&schedule, &loop, NEXT - SCHEDULE_LATE + 2));
    TEST_ASSERT_EQUAL_UINT32(101, schedule.turn);
    TEST_ASSERT_FALSE(schedule.late);
}

static void a_late_fall_comes_at_once_and_is_said_to_be_late(void)
{
    schedule.state = SCHEDULE_FALL;
    schedule.chosen = true;
    schedule.turn = 100;
    TEST_ASSERT_TRUE(schedule_due(&schedule, &loop, NEXT + 5));
    TEST_ASSERT_EQUAL_UINT64(NEXT + 5 + SCHEDULE_LATE, schedule.ticks);
    TEST_ASSERT_TRUE(schedule.late);
    /* Even where its turn is long past. */
    schedule.turn = 50;
    TEST_ASSERT_TRUE(schedule_due(&schedule, &loop, NEXT + 5));
}

static void turns_and_ticks_wrap(void)
{
    uint64_t next = (UINT64_C(1) << 48) - 5000; /* rises just before the wrap, falls after it */
    loop.next = next << LOOP_FINE_BITS;
    loop.turn = UINT32_MAX;
    (void)schedule_due(&schedule, &loop, next - PERIOD / 2);
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, schedule.turn);
    TEST_ASSERT_TRUE(schedule_due(&schedule, &loop, next - 10000));
    TEST_ASSERT_EQUAL_UINT64(next, schedule.ticks);
    schedule_edge(&schedule);
    TEST_ASSERT_EQUAL_UINT32(1, schedule.turn);
    loop.next += 2 * loop.period;
    loop.turn += 2;
    TEST_ASSERT_TRUE(schedule_due(&schedule, &loop, 2 * PERIOD - 5000 - 10000));
    TEST_ASSERT_EQUAL_UINT64(2 * PERIOD - 5000, schedule.ticks);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(nothing_is_due_when_idle_or_unlocked_or_armed);
    RUN_TEST(rises_with_the_first_turn_that_leaves_time);
    RUN_TEST(rises_in_the_present_turn_if_its_phase_is_to_come);
    RUN_TEST(an_edge_is_due_at_its_very_tick);
    RUN_TEST(falls_whole_turns_after_it_rose);
    RUN_TEST(a_late_rise_takes_the_next_turn);
    RUN_TEST(a_late_fall_comes_at_once_and_is_said_to_be_late);
    RUN_TEST(turns_and_ticks_wrap);
    return UNITY_END();
}
