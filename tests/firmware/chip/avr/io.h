/* The registers that firmware/timer.c uses, as memory of the host. */
#ifndef TESTS_FIRMWARE_CHIP_IO_H
#define TESTS_FIRMWARE_CHIP_IO_H

#include <stdint.h>

extern volatile uint16_t TCNT1, OCR1A, ICR1;
extern volatile uint8_t PORTB, PINB, DDRB, TCCR1A, TCCR1B, TCCR1C, TIMSK1, TIFR1;
extern volatile uint8_t OCR0A, TCCR0A, TCCR0B, TIMSK0;

enum { PB5 = 5, COM1A0 = 6, COM1A1 = 7, FOC1A = 7, ICNC1 = 7, ICES1 = 6, CS10 = 0 };
enum { TOV1 = 0, TOIE1 = 0, OCIE1A = 1, ICIE1 = 5, OCIE0A = 1, WGM01 = 1, CS00 = 0, CS01 = 1 };

#endif
