/* Timer 1 of the ATmega32U4: stamps index pulses and moves the trigger's pin at exact ticks. Also implements pin.h. */
#ifndef FIRMWARE_TIMER_H
#define FIRMWARE_TIMER_H

#include <stdbool.h>
#include <stdint.h>

/* Trigger low, timers running; interrupts are still off. */
void timer_start(void);

/* Ticks since the start, modulo 2^48. */
uint64_t timer_now(void);

/* The oldest index pulse that has not been taken; false when there is none. */
bool timer_index(uint64_t *ticks);

/* The armed edge, once it has come and if it has not been taken. */
bool timer_edge(uint64_t *ticks);

#endif
