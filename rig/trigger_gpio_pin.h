/* A GPIO line as a person names it, found among the machine's chips and taken. */
#ifndef RIG_TRIGGER_GPIO_PIN_H
#define RIG_TRIGGER_GPIO_PIN_H

#include "nacre/error.h"
#include "rig/trigger_gpio_line.h"

/* Either a line's name, which is looked for on all chips, or on `chip` only if that is not NULL; or a chip and a line's
 * offset in it. */
struct gpio_place {
    const char *name; /* NULL: by offset */
    const char
        *chip; /* path of its device node, its name there ("gpiochip0") or its label; NULL: any */
    int offset;
    bool active_low;
};

enum gpio_use { GPIO_OUTPUT, GPIO_INPUT };

struct gpio_pin {
    struct gpio_chip *chip; /* NULL: not open */
    struct gpio_line *line;
    char what[160]; /* for messages: "GPIO line 3 of /dev/gpiochip0" */
};

/* Take the line. A message names the line, what holds it and the remedy. */
int gpio_pin_open(const struct gpio_place *place, enum gpio_use use, struct gpio_pin *pin,
                  struct nacre_error *error);
void gpio_pin_close(struct gpio_pin *pin); /* one that is not open is allowed */

/* Fail for a chip that could not be opened, by errno. */
int gpio_chip_fail_open(const char *path, int number, struct nacre_error *error);

#endif
