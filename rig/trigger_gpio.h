/* A trigger on a GPIO line: pulses as long as the exposure, timed by the computer's clock. */
#ifndef RIG_TRIGGER_GPIO_H
#define RIG_TRIGGER_GPIO_H

#include "base/clock.h"
#include "rig/trigger.h"
#include "rig/trigger_gpio_pin.h"

struct trigger_gpio_settings {
    struct gpio_place output;
    struct gpio_place
        index; /* of the colour wheel's pulse; neither name nor chip: pulses begin at once */
    int64_t index_delay_ns; /* from the edge of the index until the pulse begins */
    int64_t index_limit_ns; /* an index that does not come within this is missing */
    int64_t jitter_ns; /* a pulse that begins later or whose length is wrong by more has failed */
};

/* Open the lines; they are held until the trigger is closed, and taken anew after their chip was unplugged. `clock` is
 * the system's monotonic one, on which the kernel stamps edges. The strings of `settings` are copied. */
int trigger_gpio_new(const struct trigger_gpio_settings *settings, struct clock *clock,
                     struct trigger **trigger, struct nacre_error *error);

#endif
