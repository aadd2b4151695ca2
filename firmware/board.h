/* The board without its hardware: commands in, exposures through loop and schedule, events out. */
#ifndef FIRMWARE_BOARD_H
#define FIRMWARE_BOARD_H

#include "firmware/loop.h"
#include "firmware/protocol.h"
#include "firmware/queue.h"
#include "firmware/schedule.h"

#define BOARD_EVENTS 20

struct board {
    struct loop loop;
    struct schedule schedule;
    struct queue commands, events;
    struct board_settings settings;
    uint16_t lost;        /* events since the start */
    uint16_t lost_before; /* the next event that finds room */
    uint8_t command_bytes[BOARD_WAITING_MAX * sizeof(struct board_command)];
    uint8_t event_bytes[BOARD_EVENTS * sizeof(struct board_event)];
};

void board_start(struct board *board, uint64_t now);

/* An index pulse came. */
void board_index(struct board *board, uint64_t ticks);

/* The armed edge came. */
void board_edge(struct board *board, uint64_t ticks);

/* To be called at least every half millisecond, after all pulses and edges up to `now` have been told. */
void board_poll(struct board *board, uint64_t now);

/* A packet from the host. */
void board_packet(struct board *board, const uint8_t *bytes, uint8_t size, uint64_t now);

/* False when a setting is outside its limits; nothing is changed then. */
bool board_set(struct board *board, const struct board_settings *settings);

void board_status(const struct board *board, uint64_t now, struct board_status *status);

/* The next event for the host; false when there is none. */
bool board_event(struct board *board, struct board_event *event);

#endif
