/* Tests of the chip's timer code with registers of the host's memory: what simavr does not model, as flags that were raised
 * before the trigger was armed. */
#include "firmware/timer.h"

#include "firmware/pin.h"
#include "unity.h"

#include <avr/io.h>

enum { TRIGGER = 1 << PB5 };

volatile uint16_t TCNT1, OCR1A, ICR1;
volatile uint8_t PORTB, PINB, DDRB, TCCR1A, TCCR1B, TCCR1C, TIMSK1, TIFR1;
volatile uint8_t OCR0A, TCCR0A, TCCR0B, TIMSK0;

void TIMER1_COMPA_vect(void);
void TIMER1_CAPT_vect(void);
void TIMER1_OVF_vect(void);

void setUp(void)
{
    uint64_t ticks;
    PORTB = PINB = TCCR1A = TIMSK1 = TIFR1 = 0;
    timer_start();
    (void)pin_low(&ticks);
    TCNT1 = 1000;
}

void tearDown(void)
{
}

/* The pin toggles as OCR1A is reached, and the interrupt follows at once. */
static void match(bool high)
{
    TCNT1 = OCR1A;
    PINB = high ? TRIGGER : 0;
    TIMER1_COMPA_vect();
}

static void an_edge_is_told_once_it_has_come(void)
{
    uint64_t ticks = 0;
    uint64_t now = timer_now();
    TEST_ASSERT_TRUE(pin_arm(now + 5000, true));
    TEST_ASSERT_FALSE(timer_edge(&ticks));
    TEST_ASSERT_EQUAL_HEX8(1 << COM1A0, TCCR1A);
    match(true);
    TEST_ASSERT_EQUAL_HEX8(TRIGGER, PORTB & TRIGGER);
    TEST_ASSERT_EQUAL_HEX8(0, TCCR1A);
    TEST_ASSERT_EQUAL_HEX8(0, TIMSK1 & 1 << OCIE1A);
    TEST_ASSERT_TRUE(timer_edge(&ticks));
    TEST_ASSERT_EQUAL_UINT64(now + 5000, ticks);
    TEST_ASSERT_FALSE(timer_edge(&ticks));
}

/* OCF1A is raised at every match of the free-running timer, every 4 ms, whether anything is armed or not, and its interrupt
 * comes as soon as arming allows it. Were it believed, the port would go high without a match, and the exposure begin early
 * by up to 4 ms. */
static void a_flag_from_before_arming_is_no_edge(void)
{
    for (unsigned ahead = 65; ahead < 0x7f00; ahead += 37) {
        uint64_t ticks = 0;
        setUp();
        TCNT1 = (uint16_t)(ahead * 7919);
        TEST_ASSERT_TRUE(pin_arm(timer_now() + ahead, true));
        TIMER1_COMPA_vect();
        TEST_ASSERT_EQUAL_HEX8(0, PORTB & TRIGGER);
        TEST_ASSERT_EQUAL_HEX8(1 << COM1A0, TCCR1A);
        TEST_ASSERT_EQUAL_HEX8(1 << OCIE1A, TIMSK1 & 1 << OCIE1A);
        TEST_ASSERT_FALSE(timer_edge(&ticks));
        match(true);
        TEST_ASSERT_EQUAL_HEX8(TRIGGER, PORTB & TRIGGER);
        TEST_ASSERT_TRUE(timer_edge(&ticks));
    }
}

static void what_is_too_near_or_too_far_is_not_armed(void)
{
    uint64_t now = timer_now();
    TEST_ASSERT_FALSE(pin_arm(now + 64, true));
    TEST_ASSERT_FALSE(pin_arm(now + 0x7f00, true));
    TEST_ASSERT_FALSE(pin_arm(now - 1, true));
    TEST_ASSERT_EQUAL_HEX8(0, TCCR1A);
    TEST_ASSERT_TRUE(pin_arm(now + 0x7eff, true));
}

static void an_armed_edge_that_is_taken_back_does_not_come(void)
{
    uint64_t ticks = 0;
    TEST_ASSERT_TRUE(pin_arm(timer_now() + 5000, true));
    TEST_ASSERT_FALSE(pin_low(&ticks));
    TEST_ASSERT_EQUAL_HEX8(0, TCCR1A);
    match(false);
    TEST_ASSERT_EQUAL_HEX8(0, PORTB & TRIGGER);
    TEST_ASSERT_FALSE(timer_edge(&ticks));
}

/* The overflow's interrupt has not run yet when a pulse is stamped, or it has. */
static void stamps_at_the_overflow_are_right_either_way(void)
{
    uint64_t before = 0;
    uint64_t after = 0;
    TCNT1 = 0xfff0;
    uint64_t now = timer_now();
    ICR1 = 0xfff8;
    TIFR1 = 1 << TOV1; /* raised after the capture */
    TIMER1_CAPT_vect();
    TEST_ASSERT_TRUE(timer_index(&before));
    TEST_ASSERT_EQUAL_UINT64(now + 8, before);
    ICR1 = 4;
    TIMER1_CAPT_vect();
    TEST_ASSERT_TRUE(timer_index(&after));
    TEST_ASSERT_EQUAL_UINT64(now + 20, after);
    TIFR1 = 0;
    TIMER1_OVF_vect();
    TIMER1_CAPT_vect();
    TEST_ASSERT_TRUE(timer_index(&after));
    TEST_ASSERT_EQUAL_UINT64(now + 20, after);
    TEST_ASSERT_FALSE(timer_index(&after));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(an_edge_is_told_once_it_has_come);
    RUN_TEST(a_flag_from_before_arming_is_no_edge);
    RUN_TEST(what_is_too_near_or_too_far_is_not_armed);
    RUN_TEST(an_armed_edge_that_is_taken_back_does_not_come);
    RUN_TEST(stamps_at_the_overflow_are_right_either_way);
    return UNITY_END();
}
