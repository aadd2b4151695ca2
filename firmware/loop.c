/* The phase-locked loop: search, lock, coast, unlock. */
#include "firmware/loop.h"

/* Periods in a row that must be alike before the loop locks; a power of two, as their mean is the first guess. */
enum { LIKE_BITS = 2, LIKE_PERIODS = 1 << LIKE_BITS };

void loop_start(struct loop *loop, uint8_t gain, uint8_t coast)
{
    *loop = (struct loop){.gain = gain, .coast = coast};
}

/* How far from its prediction a pulse may be: an eighth of a turn. */
static int64_t window(const struct loop *loop)
{
    return (int64_t)(loop->period >> 3);
}

static void unlock(struct loop *loop)
{
    loop->locked = false;
    loop->running = false;
    loop->like = 0;
    loop->locked_turns = 0;
    loop->unlocks++;
}

static void pass_turn(struct loop *loop)
{
    loop->next += loop->period;
    loop->turn++;
    if (loop->locked_turns < UINT16_MAX) {
        loop->locked_turns++;
    }
}

/* Take pulses that are overdue at `time` as missing. */
static void coast(struct loop *loop, uint64_t time)
{
    while (loop->locked && (int64_t)(time - loop->next) > window(loop)) {
        loop->missed++;
        loop->absent++;
        pass_turn(loop);
        if (loop->absent > loop->coast) {
            unlock(loop);
        }
    }
}

/* A pulse while searching: the run goes on if the mean period of the run foretold it within 1/32. */
static void search(struct loop *loop, uint64_t time)
{
    const uint64_t longest = (uint64_t)LOOP_PERIOD_MAX << LOOP_FINE_BITS;
    const uint64_t shortest = (uint64_t)LOOP_PERIOD_MIN << LOOP_FINE_BITS;
    uint64_t interval = time - loop->next; /* `next` holds the pulse before */
    int64_t difference = (int64_t)(interval - loop->period);
    int64_t allowed = (int64_t)(loop->period >> 5);
    bool like = loop->running && interval >= shortest && interval <= longest;
    if (like && loop->like > 0 && (difference > allowed || difference < -allowed)) {
        loop->like = 0;
        loop->first = loop->next;
    }
    if (!like) {
        loop->like = 0;
        loop->first = time;
    } else {
        loop->like++;
        loop->period = loop->like == 1 ? interval : loop->period;
    }
    loop->running = true;
    loop->next = time;
    if (loop->like < LIKE_PERIODS) {
        return;
    }
    loop->period = (time - loop->first) >> LIKE_BITS;
    loop->next = time + loop->period;
    loop->turn++;
    loop->locked = true;
    loop->absent = 0;
}

void loop_index(struct loop *loop, uint64_t ticks)
{
    uint64_t time = ticks << LOOP_FINE_BITS;
    coast(loop, time);
    if (!loop->locked) {
        search(loop, time);
        return;
    }
    int64_t error = (int64_t)(time - loop->next);
    if (error < -window(loop)) {
        loop->spurious++;
        return;
    }
    loop->absent = 0;
    loop->next += (uint64_t)(error >> loop->gain);
    loop->period += (uint64_t)(error >> (2 * loop->gain + 2));
    pass_turn(loop);
    if (loop->period > (uint64_t)LOOP_PERIOD_MAX << LOOP_FINE_BITS ||
        loop->period < (uint64_t)LOOP_PERIOD_MIN << LOOP_FINE_BITS) {
        unlock(loop);
    }
}

void loop_advance(struct loop *loop, uint64_t ticks)
{
    coast(loop, ticks << LOOP_FINE_BITS);
}

uint64_t loop_time(const struct loop *loop, int8_t turns, uint16_t phase)
{
    uint64_t time = loop->next + ((loop->period * phase) >> 16);
    for (; turns > 0; turns--) {
        time += loop->period;
    }
    for (; turns < 0; turns++) {
        time -= loop->period;
    }
    return time;
}
