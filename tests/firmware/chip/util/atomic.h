/* Nothing interrupts a test. */
#ifndef TESTS_FIRMWARE_CHIP_ATOMIC_H
#define TESTS_FIRMWARE_CHIP_ATOMIC_H

#define ATOMIC_BLOCK(type)

#endif
