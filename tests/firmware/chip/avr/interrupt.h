/* Interrupts as functions that a test calls. */
#ifndef TESTS_FIRMWARE_CHIP_INTERRUPT_H
#define TESTS_FIRMWARE_CHIP_INTERRUPT_H

#define ISR(vector)                                                                                \
    void vector(void);                                                                             \
    void vector(void)
#define EMPTY_INTERRUPT(vector)                                                                    \
    ISR(vector)                                                                                    \
    {                                                                                              \
    }

#endif
