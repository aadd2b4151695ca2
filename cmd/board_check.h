/* What nacre doctor says of a trigger board. */
#ifndef CMD_BOARD_CHECK_H
#define CMD_BOARD_CHECK_H

#include "base/clock.h"
#include "cmd/checks.h"
#include "rig/trigger.h"

/* Whether the wheel that an open trigger board has found, or finds within some seconds, is the station file's, and how clearly
 * the board sees it. */
void board_check(struct checks *checks, struct trigger *trigger, struct clock *clock,
                 double wheel_hz);

#endif
