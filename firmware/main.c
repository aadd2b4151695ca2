/* The trigger board's main loop: all decisions are made here, twice a millisecond; interrupts only stamp and move edges. */
#include "firmware/board.h"
#include "firmware/timer.h"
#include "firmware/usb.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/power.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

static struct board board;

/* The lamp (PC7) is on while the loop is locked. */
static void show_lock(void)
{
    if (board.loop.locked) {
        PORTC |= 1 << PC7;
    } else {
        PORTC &= (uint8_t) ~(1 << PC7);
    }
}

static void round_once(void)
{
    uint64_t ticks = 0;
    uint64_t now = timer_now();
    if (timer_edge(&ticks)) {
        board_edge(&board, ticks);
    }
    while (timer_index(&ticks)) {
        board_index(&board, ticks);
    }
    board_poll(&board, now);
    usb_poll(&board, now);
    show_lock();
}

int main(void)
{
    MCUSR = 0;
    wdt_disable();
    clock_prescale_set(clock_div_1);
    timer_start();
    DDRC |= 1 << PC7;
    usb_start();
    /* A firmware that hangs is reset, and the trigger goes low. */
    wdt_enable(WDTO_250MS);
    board_start(&board, 0);
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
    for (;;) {
        wdt_reset();
        round_once();
        sleep_mode();
    }
}
