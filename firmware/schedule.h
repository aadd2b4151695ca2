/* When the next edge of an exposure is due: it rises with one turn of the wheel and falls with a later one. No hardware. */
#ifndef FIRMWARE_SCHEDULE_H
#define FIRMWARE_SCHEDULE_H

#include "firmware/loop.h"
#include "firmware/protocol.h"

/* An edge is armed from AHEAD to LATE ticks before it: less than half a wrap of the timer's 16 bits, at least two rounds
 * of the main loop (8000 ticks), and time enough to decide and to write the registers. */
#define SCHEDULE_AHEAD 24000
#define SCHEDULE_LATE  3000

enum schedule_state {
    SCHEDULE_IDLE,
    SCHEDULE_RISE, /* the exposure has not begun */
    SCHEDULE_FALL, /* the trigger is high */
};

struct schedule {
    struct board_command command; /* BOARD_EXPOSE */
    uint64_t ticks;               /* when the armed edge comes */
    uint32_t turn;                /* that the coming edge belongs to */
    uint8_t state;                /* enum schedule_state */
    bool chosen;                  /* RISE: `turn` has been chosen */
    bool armed;                   /* the edge is in the timer's hands */
    bool late;                    /* FALL: its turn was over before it could be armed */
};

/* Take up an exposure; the schedule must be idle. */
void schedule_begin(struct schedule *schedule, const struct board_command *command);

/* Whether an edge must be armed now, for schedule->ticks. Nothing is due while the loop is not locked. */
bool schedule_due(struct schedule *schedule, const struct loop *loop, uint64_t now);

/* The armed edge has come. */
void schedule_edge(struct schedule *schedule);

/* The lock is lost before the exposure began: choose again once there is a lock. */
void schedule_restart(struct schedule *schedule);

#endif
