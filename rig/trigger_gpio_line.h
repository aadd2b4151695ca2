/* The GPIO seam: what the trigger needs of chips and lines. One of trigger_gpio1.c and trigger_gpio2.c is behind it, as
 * the build finds libgpiod 1 or 2. */
#ifndef RIG_TRIGGER_GPIO_LINE_H
#define RIG_TRIGGER_GPIO_LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Functions that can fail return 0 or errno's value; the caller knows what for and writes the text. */

struct gpio_chip;

/* Open the chip with the device node `path`. */
int gpio_chip_open(const char *path, struct gpio_chip **chip);
void gpio_chip_close(struct gpio_chip *chip); /* NULL is allowed */

const char *gpio_chip_label(struct gpio_chip *chip);
int gpio_chip_line_count(struct gpio_chip *chip);

/* The offset of the line called `name`, or -1. */
int gpio_chip_find_line(struct gpio_chip *chip, const char *name);

/* The name of a line, empty if it has none. */
void gpio_chip_line_name(struct gpio_chip *chip, int offset, char *name, size_t size);

/* What holds a line calls itself so: empty if nothing holds it or it gave no name. */
void gpio_chip_line_holder(struct gpio_chip *chip, int offset, char *holder, size_t size);

struct gpio_line;

/* Take an inactive output, or an input whose edges from inactive to active are told. The chip stays open until the line
 * is freed. */
int gpio_line_take_output(struct gpio_chip *chip, int offset, bool active_low,
                          struct gpio_line **line);
int gpio_line_take_input(struct gpio_chip *chip, int offset, bool active_low,
                         struct gpio_line **line);
void gpio_line_free(struct gpio_line *line); /* NULL is allowed */

int gpio_line_set(struct gpio_line *line, bool active);

/* The next edge of an input and when the kernel saw it, on CLOCK_MONOTONIC. ETIMEDOUT: there was none; ENODEV: the chip
 * is gone, of which no waiter is told until it asks. */
int gpio_line_wait(struct gpio_line *line, int64_t timeout_ns, int64_t *edge_ns);

#endif
