/* The board's decisions: which command is taken, which event is told, what a lost lock ends. */
#include "firmware/board.h"

#include "firmware/pin.h"

#include <string.h>

/* Index pulses are told only while the events of this many exposures have room. */
enum { EVENTS_RESERVED = 2 * (BOARD_WAITING_MAX + 1) };

static void tell(struct board *board, uint8_t kind, uint8_t detail, uint16_t id, uint64_t ticks)
{
    struct board_event event = {.event = kind,
                                .detail = detail,
                                .id = id,
                                .lost = board->lost_before,
                                .turn = board->loop.turn};
    board_put48(event.stamp, ticks);
    if (queue_push(&board->events, &event)) {
        board->lost_before = 0;
    } else {
        board->lost_before++;
        board->lost++;
    }
}

void board_start(struct board *board, uint64_t now)
{
    memset(board, 0, sizeof *board);
    board->settings = (struct board_settings){.gain = BOARD_GAIN_DEFAULT, .coast = 8};
    board->commands = (struct queue){.bytes = board->command_bytes,
                                     .size = sizeof(struct board_command),
                                     .capacity = BOARD_WAITING_MAX};
    board->events = (struct queue){
        .bytes = board->event_bytes, .size = sizeof(struct board_event), .capacity = BOARD_EVENTS};
    loop_start(&board->loop, board->settings.gain, board->settings.coast);
    tell(board, BOARD_STARTED, 0, 0, now);
}

void board_edge(struct board *board, uint64_t ticks)
{
    struct schedule *schedule = &board->schedule;
    if (schedule->state == SCHEDULE_RISE) {
        tell(board, BOARD_RISE, 0, schedule->command.id, ticks);
    } else {
        tell(board, BOARD_FALL, schedule->late, schedule->command.id, ticks);
    }
    schedule_edge(schedule);
}

/* Take the trigger low. An armed edge that has just come, untold as yet, is told first. Returns whether it was high. */
static bool cut(struct board *board, uint64_t *ended)
{
    struct schedule *schedule = &board->schedule;
    bool high = pin_low(ended);
    if (schedule->armed && high == (schedule->state == SCHEDULE_RISE)) {
        board_edge(board, schedule->ticks);
    }
    return high;
}

/* What follows from the loop's having gained or lost its lock. */
static void lock_changed(struct board *board, bool was_locked, uint64_t now)
{
    struct schedule *schedule = &board->schedule;
    if (board->loop.locked == was_locked) {
        return;
    }
    tell(board, was_locked ? BOARD_UNLOCK : BOARD_LOCK, 0, 0, now);
    if (!was_locked || schedule->state == SCHEDULE_IDLE) {
        return;
    }
    uint64_t ended = now;
    if (cut(board, &ended)) {
        tell(board, BOARD_LOST, 1, schedule->command.id, ended);
        schedule->state = SCHEDULE_IDLE;
    }
    schedule_restart(schedule);
}

void board_index(struct board *board, uint64_t ticks)
{
    bool was_locked = board->loop.locked;
    loop_index(&board->loop, ticks);
    if ((board->settings.report & BOARD_REPORT_INDEX) &&
        board->events.count < board->events.capacity - EVENTS_RESERVED) {
        tell(board, BOARD_INDEX, 0, 0, ticks);
    }
    lock_changed(board, was_locked, ticks);
}

void board_poll(struct board *board, uint64_t now)
{
    struct schedule *schedule = &board->schedule;
    bool was_locked = board->loop.locked;
    loop_advance(&board->loop, now);
    lock_changed(board, was_locked, now);
    if (schedule->state == SCHEDULE_IDLE) {
        struct board_command command;
        if (queue_pop(&board->commands, &command)) {
            schedule_begin(schedule, &command);
        }
    }
    if (schedule_due(schedule, &board->loop, now)) {
        schedule->armed = pin_arm(schedule->ticks, schedule->state == SCHEDULE_RISE);
    }
}

/* End the present exposure and forget those that wait; each is told of. */
static void abort_all(struct board *board, uint64_t now)
{
    struct schedule *schedule = &board->schedule;
    struct board_command command;
    if (schedule->state != SCHEDULE_IDLE) {
        uint64_t ended = now;
        bool high = cut(board, &ended);
        if (schedule->state != SCHEDULE_IDLE) {
            tell(board, BOARD_ABORTED, high, schedule->command.id, ended);
        }
        *schedule = (struct schedule){.state = SCHEDULE_IDLE};
    }
    while (queue_pop(&board->commands, &command)) {
        tell(board, BOARD_ABORTED, 0, command.id, now);
    }
}

static void take(struct board *board, const struct board_command *command, uint64_t now)
{
    if (command->command == BOARD_ABORT) {
        abort_all(board, now);
    } else if (command->command != BOARD_EXPOSE) {
        tell(board, BOARD_REFUSED, BOARD_MALFORMED, command->id, now);
    } else if (command->turns < 1 || command->turns > BOARD_TURNS_MAX) {
        tell(board, BOARD_REFUSED, BOARD_BAD_TURNS, command->id, now);
    } else if (!queue_push(&board->commands, command)) {
        tell(board, BOARD_REFUSED, BOARD_FULL, command->id, now);
    }
}

void board_packet(struct board *board, const uint8_t *bytes, uint8_t size, uint64_t now)
{
    struct board_command command;
    if (size == 0 || size % sizeof command != 0) {
        tell(board, BOARD_REFUSED, BOARD_MALFORMED, 0, now);
        return;
    }
    for (uint8_t at = 0; at < size; at = (uint8_t)(at + sizeof command)) {
        memcpy(&command, bytes + at, sizeof command);
        take(board, &command, now);
    }
}

bool board_set(struct board *board, const struct board_settings *settings)
{
    if (settings->gain < BOARD_GAIN_MIN || settings->gain > BOARD_GAIN_MAX || settings->coast < 1 ||
        settings->coast > BOARD_COAST_MAX || settings->report > BOARD_REPORT_INDEX ||
        settings->reserved != 0) {
        return false;
    }
    board->settings = *settings;
    board->loop.gain = settings->gain;
    board->loop.coast = settings->coast;
    return true;
}

void board_status(const struct board *board, uint64_t now, struct board_status *status)
{
    const struct loop *loop = &board->loop;
    *status = (struct board_status){
        .protocol = BOARD_PROTOCOL,
        .size = sizeof *status,
        .state = (uint8_t)((loop->locked ? BOARD_LOCKED : 0) |
                           (board->schedule.state == SCHEDULE_FALL ? BOARD_EXPOSING : 0) |
                           (board->schedule.state == SCHEDULE_RISE ? BOARD_PENDING : 0)),
        .waiting = board->commands.count,
        .settings = board->settings,
        .tick_hz = BOARD_TICK_HZ,
        .turn = loop->turn,
        .locked_turns = loop->locked_turns,
        .missed = loop->missed,
        .spurious = loop->spurious,
        .unlocks = loop->unlocks,
        .lost = board->lost};
    board_put48(status->now, now);
    board_put48(status->period, loop->locked ? loop->period : 0);
}

bool board_event(struct board *board, struct board_event *event)
{
    return queue_pop(&board->events, event);
}
