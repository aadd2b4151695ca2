/* Timer 1: free-running, input capture for the index, output compare for the trigger.
 *
 * The trigger toggles at compare matches (set and clear modes are wrong in simavr) and the compare unit is connected
 * from arming until the interrupt after the match only, so one match cannot become two. TIFR1 is never written. */
#include "firmware/timer.h"

#include "firmware/pin.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <stddef.h>
#include <util/atomic.h>

enum { TRIGGER = 1 << PB5, LAST_STAMP = 8 };

struct stamp {
    uint32_t high;
    uint16_t low;
};

static volatile uint32_t overflows;
static volatile struct stamp pulses[LAST_STAMP];
static volatile uint8_t pulse_first, pulse_count;
static volatile bool armed, came, armed_high;
static uint64_t armed_ticks;

/* The upper bits of a time whose lower ones are `low`, interrupts off. */
static inline uint32_t high_of(uint16_t low)
{
    return overflows + ((TIFR1 & (1 << TOV1)) && low < 0x8000);
}

ISR(TIMER1_OVF_vect)
{
    overflows++;
}

/* With the ring full a pulse is dropped: the loop takes it as missing. */
ISR(TIMER1_CAPT_vect)
{
    uint16_t low = ICR1;
    if (pulse_count < LAST_STAMP) {
        volatile struct stamp *stamp = &pulses[(pulse_first + pulse_count) % LAST_STAMP];
        stamp->high = high_of(low);
        stamp->low = low;
        pulse_count++;
    }
}

/* The pin has toggled: the port takes over its level. A flag from before arming is told by the time. */
ISR(TIMER1_COMPA_vect)
{
    if (!armed || (int16_t)(TCNT1 - OCR1A) < 0) {
        return;
    }
    if (armed_high) {
        PORTB |= TRIGGER;
    } else {
        PORTB &= (uint8_t)~TRIGGER;
    }
    TCCR1A = 0;
    TIMSK1 &= (uint8_t) ~(1 << OCIE1A);
    armed = false;
    came = true;
}

/* Only to wake the main loop. */
EMPTY_INTERRUPT(TIMER0_COMPA_vect)

void timer_start(void)
{
    PORTB &= (uint8_t)~TRIGGER;
    DDRB |= TRIGGER;
    TCCR1A = 1 << COM1A1; /* clear at match, */
    TCCR1C = 1 << FOC1A;  /* and match now: the compare unit's own level is low too */
    TCCR1A = 0;
    TCCR1B = 1 << ICNC1 | 1 << ICES1 | 1 << CS10;
    TIMSK1 = 1 << ICIE1 | 1 << TOIE1;
    OCR0A = F_CPU / 64 / 2000 - 1;
    TCCR0A = 1 << WGM01;
    TCCR0B = 1 << CS01 | 1 << CS00;
    TIMSK0 = 1 << OCIE0A;
}

uint64_t timer_now(void)
{
    uint16_t low = 0;
    uint32_t high = 0;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        low = TCNT1;
        high = high_of(low);
    }
    return (uint64_t)high << 16 | low;
}

bool timer_index(uint64_t *ticks)
{
    bool any = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        if (pulse_count > 0) {
            *ticks = (uint64_t)pulses[pulse_first].high << 16 | pulses[pulse_first].low;
            pulse_first = (pulse_first + 1) % LAST_STAMP;
            pulse_count--;
            any = true;
        }
    }
    return any;
}

bool timer_edge(uint64_t *ticks)
{
    bool any = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        any = came;
        came = false;
    }
    *ticks = armed_ticks;
    return any;
}

bool pin_arm(uint64_t ticks, bool high)
{
    bool in_time = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        uint16_t ahead = (uint16_t)ticks - TCNT1;
        in_time = ahead > 64 && ahead < 0x7f00;
        if (in_time) {
            OCR1A = (uint16_t)ticks;
            TCCR1A = 1 << COM1A0;
            armed_high = high;
            armed = true;
            came = false;
            TIMSK1 |= 1 << OCIE1A;
        }
    }
    if (in_time) {
        armed_ticks = ticks;
    }
    return in_time;
}

bool pin_low(uint64_t *ticks)
{
    bool high = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        OCR1A = TCNT1 - 1; /* no match for the next 4 ms */
        high = PINB & TRIGGER;
        if (high) {
            TCCR1A = 1 << COM1A0;
            TCCR1C = 1 << FOC1A;
        }
        PORTB &= (uint8_t)~TRIGGER;
        TCCR1A = 0;
        TIMSK1 &= (uint8_t) ~(1 << OCIE1A);
        armed = false;
        came = false;
    }
    *ticks = timer_now();
    return high;
}
