/* The trigger of stations whose camera takes frame after frame and needs none. */
#ifndef RIG_TRIGGER_NONE_H
#define RIG_TRIGGER_NONE_H

#include "base/clock.h"
#include "rig/trigger.h"

/* Firing does nothing but tell the time. */
int trigger_none_new(struct clock *clock, struct trigger **trigger, struct nacre_error *error);

#endif
