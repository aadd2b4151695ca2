/* QEMU's monitor, spoken to from inside the guest. */
#ifndef TESTS_LAB_MONITOR_H
#define TESTS_LAB_MONITOR_H

#include <stdint.h>

/* Do a command and wait until it is done; what it said is lost. */
void monitor_do(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* The picture on the screen of the guest's graphics card, 0xRRGGBB[height][width]; free frees. */
uint32_t *monitor_screen(int *width, int *height);

#endif
