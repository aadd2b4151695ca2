/* The phase-locked loop that learns the wheel's period and phase from its index pulses. No hardware.
 *
 * Second order: each pulse corrects the phase by 2^-gain and the period by 2^-(2 gain + 2) of its error, which damps
 * critically with a time constant of 2^(gain + 1) turns. */
#ifndef FIRMWARE_LOOP_H
#define FIRMWARE_LOOP_H

#include <stdbool.h>
#include <stdint.h>

/* "Fine" times are ticks and 16 bits of fraction, so that 48-bit ticks fill 64 bits and both wrap as one. Whoever adds
 * less precisely loses the integral term of slow gains. */
#define LOOP_FINE_BITS 16

/* Wheels of 5 to 250 Hz, in ticks. */
#define LOOP_PERIOD_MAX 3200000UL
#define LOOP_PERIOD_MIN 64000UL

struct loop {
    uint64_t next;   /* fine: when turn `turn` begins */
    uint64_t period; /* fine */
    uint64_t first;  /* searching: fine, the first pulse of a run of like periods */
    uint32_t turn;   /* number of the turn that begins next */
    uint16_t locked_turns;
    uint16_t missed, spurious, unlocks;
    uint8_t gain, coast; /* see protocol.h */
    uint8_t like;        /* searching: periods of the run */
    uint8_t absent;      /* pulses missing in a row */
    bool running;        /* searching: `first` holds a pulse */
    bool locked;
};

/* Forget the wheel and search. */
void loop_start(struct loop *loop, uint8_t gain, uint8_t coast);

/* An index pulse came at `ticks`, with those before it told already. */
void loop_index(struct loop *loop, uint64_t ticks);

/* It is `ticks`, and all index pulses up to then have been told: pulses that are overdue did not come. */
void loop_advance(struct loop *loop, uint64_t ticks);

/* When turn loop->turn + `turns` is `phase` / 65536 old, fine. */
uint64_t loop_time(const struct loop *loop, int8_t turns, uint16_t phase);

#endif
