/* The GPIO seam on libgpiod 1. */
#include "rig/trigger_gpio_line.h"

#include <errno.h>
#include <gpiod.h>
#include <stdio.h>
#include <stdlib.h>

static const char consumer[] = "nacre";

/* A gpio_chip or gpio_line is libgpiod's own by another name. */
static struct gpiod_chip *chip_of(struct gpio_chip *chip)
{
    return (struct gpiod_chip *)chip;
}

static struct gpiod_line *line_of(struct gpio_line *line)
{
    return (struct gpiod_line *)line;
}

/* errno where a call failed, which it may have left at zero. */
static int number_of(int failed)
{
    if (!failed) {
        return 0;
    }
    return errno ? errno : EIO;
}

int gpio_chip_open(const char *path, struct gpio_chip **chip)
{
    *chip = (struct gpio_chip *)gpiod_chip_open(path);
    return number_of(!*chip);
}

void gpio_chip_close(struct gpio_chip *chip)
{
    if (chip) {
        gpiod_chip_close(chip_of(chip));
    }
}

const char *gpio_chip_label(struct gpio_chip *chip)
{
    return gpiod_chip_label(chip_of(chip));
}

int gpio_chip_line_count(struct gpio_chip *chip)
{
    return (int)gpiod_chip_num_lines(chip_of(chip));
}

int gpio_chip_find_line(struct gpio_chip *chip, const char *name)
{
    struct gpiod_line *line = gpiod_chip_find_line(chip_of(chip), name);
    return line ? (int)gpiod_line_offset(line) : -1;
}

void gpio_chip_line_name(struct gpio_chip *chip, int offset, char *name, size_t size)
{
    struct gpiod_line *line = gpiod_chip_get_line(chip_of(chip), (unsigned)offset);
    const char *found = line ? gpiod_line_name(line) : NULL;
    (void)snprintf(name, size, "%s", found ? found : "");
}

void gpio_chip_line_holder(struct gpio_chip *chip, int offset, char *holder, size_t size)
{
    struct gpiod_line *line = gpiod_chip_get_line(chip_of(chip), (unsigned)offset);
    const char *name = line && gpiod_line_is_used(line) ? gpiod_line_consumer(line) : NULL;
    (void)snprintf(holder, size, "%s", name ? name : "");
}

static int take(struct gpio_chip *chip, int offset, int type, bool active_low,
                struct gpio_line **taken)
{
    struct gpiod_line_request_config config = {
        .consumer = consumer,
        .request_type = type,
        .flags = active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0,
    };
    struct gpiod_line *line = gpiod_chip_get_line(chip_of(chip), (unsigned)offset);
    int number = number_of(!line || gpiod_line_request(line, &config, 0) != 0);
    *taken = number == 0 ? (struct gpio_line *)line : NULL;
    return number;
}

int gpio_line_take_output(struct gpio_chip *chip, int offset, bool active_low,
                          struct gpio_line **line)
{
    return take(chip, offset, GPIOD_LINE_REQUEST_DIRECTION_OUTPUT, active_low, line);
}

int gpio_line_take_input(struct gpio_chip *chip, int offset, bool active_low,
                         struct gpio_line **line)
{
    return take(chip, offset, GPIOD_LINE_REQUEST_EVENT_RISING_EDGE, active_low, line);
}

void gpio_line_free(struct gpio_line *line)
{
    if (line) {
        gpiod_line_release(line_of(line));
    }
}

int gpio_line_set(struct gpio_line *line, bool active)
{
    return number_of(gpiod_line_set_value(line_of(line), active) != 0);
}

int gpio_line_wait(struct gpio_line *line, int64_t timeout_ns, int64_t *edge_ns)
{
    struct timespec timeout = {.tv_sec = timeout_ns / 1000000000,
                               .tv_nsec = timeout_ns % 1000000000};
    struct gpiod_line_event event = {.event_type = 0};
    int found = gpiod_line_event_wait(line_of(line), &timeout);
    if (found == 0) {
        return gpiod_line_get_value(line_of(line)) < 0 ? number_of(1) : ETIMEDOUT;
    }
    int number = number_of(found < 0 || gpiod_line_event_read(line_of(line), &event) != 0);
    if (number == 0) {
        *edge_ns = (int64_t)event.ts.tv_sec * 1000000000 + event.ts.tv_nsec;
    }
    return number;
}
