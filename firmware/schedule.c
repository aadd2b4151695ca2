/* Choosing the turns of an exposure's edges. */
#include "firmware/schedule.h"

#define FINE(ticks) ((int64_t)(ticks) * (1L << LOOP_FINE_BITS))

void schedule_begin(struct schedule *schedule, const struct board_command *command)
{
    *schedule = (struct schedule){.command = *command, .state = SCHEDULE_RISE};
}

/* The first turn whose edge can still be armed. */
static void choose(struct schedule *schedule, const struct loop *loop, uint64_t now)
{
    int8_t turns = -1;
    while (turns < 2 && (int64_t)(loop_time(loop, turns, schedule->command.phase) -
                                  (now << LOOP_FINE_BITS)) < FINE(SCHEDULE_AHEAD)) {
        turns++;
    }
    schedule->turn = loop->turn + (uint32_t)(int32_t)turns;
    schedule->chosen = true;
}

bool schedule_due(struct schedule *schedule, const struct loop *loop, uint64_t now)
{
    if (schedule->state == SCHEDULE_IDLE || schedule->armed || !loop->locked) {
        return false;
    }
    if (!schedule->chosen) {
        choose(schedule, loop, now);
    }
    int32_t turns = (int32_t)(schedule->turn - loop->turn);
    if (turns > 1) {
        return false;
    }
    uint64_t time = loop_time(loop, (int8_t)(turns < -2 ? -2 : turns), schedule->command.phase);
    int64_t ahead = (int64_t)(time - (now << LOOP_FINE_BITS));
    if (ahead > FINE(SCHEDULE_AHEAD)) {
        return false;
    }
    if (ahead < FINE(SCHEDULE_LATE)) {
        if (schedule->state == SCHEDULE_RISE) {
            schedule->chosen = false;
            return false;
        }
        schedule->late = true;
        schedule->ticks = (now + SCHEDULE_LATE) & ((UINT64_C(1) << 48) - 1);
        return true;
    }
    schedule->ticks = (time + (UINT64_C(1) << (LOOP_FINE_BITS - 1))) >> LOOP_FINE_BITS;
    return true;
}

void schedule_edge(struct schedule *schedule)
{
    schedule->armed = false;
    if (schedule->state == SCHEDULE_RISE) {
        schedule->state = SCHEDULE_FALL;
        schedule->turn += schedule->command.turns;
    } else {
        schedule->state = SCHEDULE_IDLE;
    }
}

void schedule_restart(struct schedule *schedule)
{
    schedule->armed = false;
    schedule->chosen = false;
}
