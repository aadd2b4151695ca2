/* The trigger board in simavr: the real firmware, a colour wheel on its index pin, a scope on its trigger pin, and the
 * host's end of its USB cable. simavr is under the GPL, so only test programs link this. */
#ifndef TESTS_FIRMWARE_SIMULATED_H
#define TESTS_FIRMWARE_SIMULATED_H

#include "firmware/protocol.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* One cycle is one tick of the board, 62.5 ns. */
#define CYCLES_PER_SECOND 16e6

struct wheel {
    double period;            /* cycles */
    double jitter;            /* of pulses: uniform, so many cycles either way */
    double drift;             /* of the period, relative, per second */
    double missing, spurious; /* share of pulses that do not come; of turns with one too many */
    uint64_t seed;
    bool stopped;
};

struct pin_edge {
    uint64_t cycle;
    bool high;
};

enum { SIMULATED_EDGES = 8192, SIMULATED_TURNS = 8192 };

struct simulated {
    struct avr_t *avr;
    struct wheel wheel;
    double turn_at;                /* of the next turn to be planned */
    double turns[SIMULATED_TURNS]; /* when they truly began, cycles */
    size_t turn_count;
    double pulses[2]; /* planned, in order */
    int pulse, pulse_count;
    struct pin_edge edges[SIMULATED_EDGES];
    size_t edge_count;
    uint64_t handler_began,
        longest_handler; /* cycles from an interrupt's first instruction to its last */
    unsigned overflows;  /* address of the firmware's count of timer overflows */
    bool attached, unplugged;
};

/* Outcomes of the USB calls below 0; otherwise the number of bytes. */
enum { SIMULATED_TIMEOUT = -1, SIMULATED_STALL = -2, SIMULATED_GONE = -3 };

/* A board that runs the firmware that was built, until it has attached to the bus. NULL where it cannot. */
struct simulated *simulated_new(void);
void simulated_free(struct simulated *simulated);

void simulated_run(struct simulated *simulated, double cycles);

/* Start the wheel (or another one): its first turn begins now. */
void simulated_turn(struct simulated *simulated, struct wheel wheel);

/* Make the board's clock show about `ticks`, a multiple of 2^16, as if it had run so long. False where the firmware has
 * no such clock. */
bool simulated_set_clock(struct simulated *simulated, uint64_t ticks);

/* Bytes of RAM that are in use at the worst moment so far: variables and the deepest stack. */
int simulated_ram(const struct simulated *simulated);

/* As the host controller and the kernel would: reset, address, configuration 1. False where the board does not do it. */
bool simulated_enumerate(struct simulated *simulated);

/* Transfers; they give up after `timeout_ms` of the board's time. */
int simulated_control(struct simulated *simulated, uint8_t type, uint8_t request, uint16_t value,
                      uint16_t index, void *data, uint16_t size, int timeout_ms);
int simulated_out(struct simulated *simulated, uint8_t endpoint, const void *data, int size,
                  int timeout_ms);
int simulated_in(struct simulated *simulated, uint8_t endpoint, void *data, int size,
                 int timeout_ms);

#endif
