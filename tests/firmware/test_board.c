/* Tests of the board's decisions, with a model of its timer. */
#include "firmware/board.h"

#include "firmware/pin.h"
#include "unity.h"

#include <string.h>

/* A round of the main loop comes every ROUND ticks. */
enum { PERIOD = 533333, ROUND = 8000 };

static struct board board;
static struct {
    bool armed, armed_high, level;
    uint64_t ticks; /* of the armed edge */
    bool came;      /* the armed edge has come, untold */
} pin;
static uint64_t now, next_pulse;
static bool wheel_on;

bool pin_arm(uint64_t ticks, bool high)
{
    TEST_ASSERT_FALSE(pin.armed);
    TEST_ASSERT_TRUE(high != pin.level);
    TEST_ASSERT_TRUE(ticks > now && ticks - now < 32768);
    pin.armed = true;
    pin.armed_high = high;
    pin.ticks = ticks;
    return true;
}

bool pin_low(uint64_t *ticks)
{
    bool high = pin.level;
    pin.armed = pin.came = pin.level = false;
    *ticks = now;
    return high;
}

static void turn_pin(void)
{
    pin.armed = false;
    pin.came = true;
    pin.level = pin.armed_high;
}

/* As main.c does it. */
static void round_once(void)
{
    now += ROUND;
    if (pin.armed && pin.ticks <= now) {
        turn_pin();
    }
    if (pin.came) {
        pin.came = false;
        board_edge(&board, pin.ticks);
    }
    while (next_pulse <= now) {
        if (wheel_on) {
            board_index(&board, next_pulse);
        }
        next_pulse += PERIOD;
    }
    board_poll(&board, now);
}

static void run(double turns)
{
    for (uint64_t end = now + (uint64_t)(turns * PERIOD); now < end;) {
        round_once();
    }
}

static struct board_event next_event(void)
{
    struct board_event event = {.event = 0};
    (void)board_event(&board, &event);
    return event;
}

static struct board_event expect(uint8_t kind, uint16_t id)
{
    struct board_event event = next_event();
    TEST_ASSERT_EQUAL_UINT8(kind, event.event);
    TEST_ASSERT_EQUAL_UINT16(id, event.id);
    return event;
}

static void expect_none(void)
{
    TEST_ASSERT_EQUAL_UINT8(0, next_event().event);
}

static void send(uint8_t kind, uint16_t id, uint16_t turns)
{
    struct board_command command = {.command = kind, .id = id, .turns = turns, .phase = 0x4000};
    uint8_t bytes[sizeof command];
    memcpy(bytes, &command, sizeof command);
    board_packet(&board, bytes, sizeof bytes, now);
}

void setUp(void)
{
    memset(&pin, 0, sizeof pin);
    now = 5000;
    next_pulse = 100000;
    wheel_on = true;
    board_start(&board, now);
    expect(BOARD_STARTED, 0);
}

void tearDown(void)
{
}

static void lock(void)
{
    run(6);
    expect(BOARD_LOCK, 0);
    expect_none();
}

static void exposes_whole_turns_one_after_the_other(void)
{
    lock();
    send(BOARD_EXPOSE, 1, 1);
    send(BOARD_EXPOSE, 2, 3);
    run(8);
    uint64_t rise = board_get48(expect(BOARD_RISE, 1).stamp);
    uint64_t fall = board_get48(expect(BOARD_FALL, 1).stamp);
    TEST_ASSERT_EQUAL_UINT64(PERIOD, fall - rise);
    /* A quarter of a turn after an index pulse, as its phase asks; the period is known to 2^-2 tick. */
    TEST_ASSERT_UINT_WITHIN(1, PERIOD / 4, (unsigned)((rise - 100000) % PERIOD));
    rise = board_get48(expect(BOARD_RISE, 2).stamp);
    TEST_ASSERT_EQUAL_UINT64(PERIOD, rise - fall);
    fall = board_get48(expect(BOARD_FALL, 2).stamp);
    TEST_ASSERT_EQUAL_UINT64(3 * PERIOD, fall - rise);
    expect_none();
    TEST_ASSERT_FALSE(pin.level);
}

static void waits_for_the_lock(void)
{
    wheel_on = false;
    send(BOARD_EXPOSE, 1, 1);
    run(20);
    expect_none();
    wheel_on = true;
    run(9);
    expect(BOARD_LOCK, 0);
    expect(BOARD_RISE, 1);
    expect(BOARD_FALL, 1);
}

static void refuses_what_has_no_room(void)
{
    lock();
    for (uint16_t id = 1; id <= BOARD_WAITING_MAX + 1; id++) {
        send(BOARD_EXPOSE, id, 1);
    }
    struct board_event event = expect(BOARD_REFUSED, BOARD_WAITING_MAX + 1);
    TEST_ASSERT_EQUAL_UINT8(BOARD_FULL, event.detail);
    run(2.0 * BOARD_WAITING_MAX + 2);
    for (uint16_t id = 1; id <= BOARD_WAITING_MAX; id++) {
        expect(BOARD_RISE, id);
        expect(BOARD_FALL, id);
    }
    expect_none();
}

static void refuses_what_it_does_not_understand(void)
{
    const uint8_t junk[64] = {BOARD_EXPOSE, 0, 9, 0, 1, 0, 0, 0, 77};
    const uint8_t sizes[] = {0, 1, 7, 9, 15, 63};
    for (size_t i = 0; i < sizeof sizes; i++) {
        board_packet(&board, junk, sizes[i], now);
        TEST_ASSERT_EQUAL_UINT8(BOARD_MALFORMED, expect(BOARD_REFUSED, 0).detail);
        expect_none();
    }
    send(77, 5, 1);
    TEST_ASSERT_EQUAL_UINT8(BOARD_MALFORMED, expect(BOARD_REFUSED, 5).detail);
    send(BOARD_EXPOSE, 6, 0);
    TEST_ASSERT_EQUAL_UINT8(BOARD_BAD_TURNS, expect(BOARD_REFUSED, 6).detail);
    send(BOARD_EXPOSE, 7, BOARD_TURNS_MAX + 1);
    TEST_ASSERT_EQUAL_UINT8(BOARD_BAD_TURNS, expect(BOARD_REFUSED, 7).detail);
    send(BOARD_EXPOSE, 8, BOARD_TURNS_MAX);
    expect_none();
}

static void abort_ends_the_exposure_and_forgets_the_rest(void)
{
    lock();
    send(BOARD_EXPOSE, 1, 5);
    send(BOARD_EXPOSE, 2, 5);
    run(3);
    expect(BOARD_RISE, 1);
    TEST_ASSERT_TRUE(pin.level);
    send(BOARD_ABORT, 0, 0);
    TEST_ASSERT_FALSE(pin.level);
    TEST_ASSERT_EQUAL_UINT8(1, expect(BOARD_ABORTED, 1).detail);
    TEST_ASSERT_EQUAL_UINT8(0, expect(BOARD_ABORTED, 2).detail);
    run(10);
    expect_none();
    send(BOARD_EXPOSE, 3, 1);
    run(4);
    expect(BOARD_RISE, 3);
    expect(BOARD_FALL, 3);
}

static void abort_before_an_armed_edge_takes_it_back(void)
{
    lock();
    send(BOARD_EXPOSE, 1, 1);
    while (!pin.armed) {
        round_once();
    }
    send(BOARD_ABORT, 0, 0);
    TEST_ASSERT_EQUAL_UINT8(0, expect(BOARD_ABORTED, 1).detail);
    run(5);
    expect_none();
}

/* The hardware made the edge, and the abort is told before it. */
static void abort_just_after_the_rise_tells_both(void)
{
    lock();
    send(BOARD_EXPOSE, 1, 1);
    while (!pin.armed) {
        round_once();
    }
    uint64_t edge = pin.ticks;
    turn_pin();
    send(BOARD_ABORT, 0, 0);
    TEST_ASSERT_EQUAL_UINT64(edge, board_get48(expect(BOARD_RISE, 1).stamp));
    TEST_ASSERT_EQUAL_UINT8(1, expect(BOARD_ABORTED, 1).detail);
    TEST_ASSERT_FALSE(pin.level);
}

static void abort_just_after_the_fall_is_too_late(void)
{
    lock();
    send(BOARD_EXPOSE, 1, 1);
    while (!(pin.armed && pin.level)) {
        round_once();
    }
    turn_pin();
    send(BOARD_ABORT, 0, 0);
    expect(BOARD_RISE, 1);
    expect(BOARD_FALL, 1);
    expect_none();
}

static void a_lock_lost_in_an_exposure_ends_it_at_once(void)
{
    lock();
    send(BOARD_EXPOSE, 1, 100);
    send(BOARD_EXPOSE, 2, 1);
    run(3);
    expect(BOARD_RISE, 1);
    wheel_on = false;
    run(board.settings.coast + 2);
    expect(BOARD_UNLOCK, 0);
    TEST_ASSERT_EQUAL_UINT8(1, expect(BOARD_LOST, 1).detail);
    TEST_ASSERT_FALSE(pin.level);
    expect_none();
    /* The next one waits for a new lock. */
    wheel_on = true;
    run(10);
    expect(BOARD_LOCK, 0);
    expect(BOARD_RISE, 2);
    expect(BOARD_FALL, 2);
}

static void events_that_find_no_room_are_counted(void)
{
    for (uint16_t id = 0; id < BOARD_EVENTS + 5; id++) {
        send(77, id, 0);
    }
    struct board_status status;
    board_status(&board, now, &status);
    TEST_ASSERT_EQUAL_UINT16(5, status.lost);
    expect(BOARD_REFUSED, 0);
    send(77, 1000, 0);
    for (uint16_t id = 1; id < BOARD_EVENTS; id++) {
        TEST_ASSERT_EQUAL_UINT16(0, expect(BOARD_REFUSED, id).lost);
    }
    TEST_ASSERT_EQUAL_UINT16(5, expect(BOARD_REFUSED, 1000).lost);
}

static void index_events_leave_room_for_edges(void)
{
    const struct board_settings settings = {.gain = 3, .coast = 8, .report = BOARD_REPORT_INDEX};
    lock();
    TEST_ASSERT_TRUE(board_set(&board, &settings));
    run(3);
    TEST_ASSERT_EQUAL_UINT8(BOARD_INDEX, next_event().event);
    run(50); /* nobody fetches them */
    send(BOARD_EXPOSE, 1, 1);
    run(5);
    struct board_event event;
    int edges = 0;
    while (board_event(&board, &event)) {
        edges += event.event == BOARD_RISE || event.event == BOARD_FALL;
        TEST_ASSERT_EQUAL_UINT16(0, event.lost);
    }
    TEST_ASSERT_EQUAL_INT(2, edges);
}

static void settings_outside_their_limits_change_nothing(void)
{
    const struct board_settings wrong[] = {{0, 8, 0, 0},  {7, 8, 0, 0}, {3, 0, 0, 0},
                                           {3, 33, 0, 0}, {3, 8, 2, 0}, {3, 8, 0, 1}};
    const struct board_settings right = {6, 32, 1, 0};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        TEST_ASSERT_FALSE(board_set(&board, &wrong[i]));
        TEST_ASSERT_EQUAL_UINT8(BOARD_GAIN_DEFAULT, board.settings.gain);
    }
    TEST_ASSERT_TRUE(board_set(&board, &right));
    TEST_ASSERT_EQUAL_UINT8(6, board.loop.gain);
    TEST_ASSERT_EQUAL_UINT8(32, board.loop.coast);
}

/* Whatever comes, in whatever order, the trigger is high between its edges only and every command finds its end. */
static void random_packets_and_pulses_leave_it_sane(void)
{
    uint64_t seed = 12345;
    int began = 0;
    int ended = 0;
    for (int round = 0; round < 400000; round++) {
        struct board_event event;
        seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
        uint32_t dice = (uint32_t)(seed >> 33);
        if (dice % 64 == 0) {
            uint8_t bytes[64];
            for (size_t i = 0; i < sizeof bytes; i++) {
                bytes[i] = i % 8 == 0 ? (uint8_t)(1 + (dice >> 20) % 3)
                                      : (uint8_t)(i % 8 == 5 ? 0 : (seed >> (i % 50)) & 3);
            }
            board_packet(&board, bytes, (uint8_t)(dice % 3 ? 8 : (dice >> 8) % 65), now);
        }
        if (dice % 3001 == 1) {
            wheel_on = !wheel_on;
        }
        round_once();
        while (board_event(&board, &event)) {
            began += event.event == BOARD_RISE;
            ended += event.event == BOARD_FALL || (event.event == BOARD_LOST) ||
                     (event.event == BOARD_ABORTED && event.detail);
        }
        bool exposing = board.schedule.state == SCHEDULE_FALL;
        TEST_ASSERT_TRUE(pin.level == exposing || pin.came || pin.armed);
        TEST_ASSERT_EQUAL_INT(began, ended + exposing);
    }
    TEST_ASSERT_TRUE(began > 100);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(exposes_whole_turns_one_after_the_other);
    RUN_TEST(waits_for_the_lock);
    RUN_TEST(refuses_what_has_no_room);
    RUN_TEST(refuses_what_it_does_not_understand);
    RUN_TEST(abort_ends_the_exposure_and_forgets_the_rest);
    RUN_TEST(abort_before_an_armed_edge_takes_it_back);
    RUN_TEST(abort_just_after_the_rise_tells_both);
    RUN_TEST(abort_just_after_the_fall_is_too_late);
    RUN_TEST(a_lock_lost_in_an_exposure_ends_it_at_once);
    RUN_TEST(events_that_find_no_room_are_counted);
    RUN_TEST(index_events_leave_room_for_edges);
    RUN_TEST(settings_outside_their_limits_change_nothing);
    RUN_TEST(random_packets_and_pulses_leave_it_sane);
    return UNITY_END();
}
