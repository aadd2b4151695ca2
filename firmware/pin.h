/* What the board asks of its timer, whose hardware makes the trigger's edges: timer.c on the chip, a model in tests. */
#ifndef FIRMWARE_PIN_H
#define FIRMWARE_PIN_H

#include <stdbool.h>
#include <stdint.h>

/* Let the trigger go to the other level, `high` or low, at `ticks`, at most 32767 from now. False when it is too late
 * for that; the edge then does not come. */
bool pin_arm(uint64_t ticks, bool high);

/* Take the trigger low now and forget the armed edge. Returns whether it was high; writes the time. */
bool pin_low(uint64_t *ticks);

#endif
