/* The GPIO seam on libgpiod 2. */
#include "rig/trigger_gpio_line.h"

#include <errno.h>
#include <gpiod.h>
#include <stdio.h>
#include <stdlib.h>

static const char consumer[] = "nacre";

struct gpio_chip {
    struct gpiod_chip *chip;
    struct gpiod_chip_info *info;
};

struct gpio_line {
    struct gpiod_line_request *request;
    struct gpiod_edge_event_buffer *events; /* NULL: an output */
    unsigned offset;
};

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
    int number = 0;
    struct gpio_chip *made = calloc(1, sizeof *made);
    if (!made) {
        return ENOMEM;
    }
    made->chip = gpiod_chip_open(path);
    number = number_of(!made->chip);
    if (number != 0) {
        goto out;
    }
    made->info = gpiod_chip_get_info(made->chip);
    number = number_of(!made->info);
out:
    if (number != 0) {
        gpio_chip_close(made);
        made = NULL;
    }
    *chip = made;
    return number;
}

void gpio_chip_close(struct gpio_chip *chip)
{
    if (!chip) {
        return;
    }
    if (chip->info) {
        gpiod_chip_info_free(chip->info);
    }
    if (chip->chip) {
        gpiod_chip_close(chip->chip);
    }
    free(chip);
}

const char *gpio_chip_label(struct gpio_chip *chip)
{
    return gpiod_chip_info_get_label(chip->info);
}

int gpio_chip_line_count(struct gpio_chip *chip)
{
    return (int)gpiod_chip_info_get_num_lines(chip->info);
}

int gpio_chip_find_line(struct gpio_chip *chip, const char *name)
{
    return gpiod_chip_get_line_offset_from_name(chip->chip, name);
}

void gpio_chip_line_name(struct gpio_chip *chip, int offset, char *name, size_t size)
{
    struct gpiod_line_info *info = gpiod_chip_get_line_info(chip->chip, (unsigned)offset);
    const char *found = info ? gpiod_line_info_get_name(info) : NULL;
    (void)snprintf(name, size, "%s", found ? found : "");
    if (info) {
        gpiod_line_info_free(info);
    }
}

void gpio_chip_line_holder(struct gpio_chip *chip, int offset, char *holder, size_t size)
{
    struct gpiod_line_info *info = gpiod_chip_get_line_info(chip->chip, (unsigned)offset);
    const char *name =
        info && gpiod_line_info_is_used(info) ? gpiod_line_info_get_consumer(info) : NULL;
    (void)snprintf(holder, size, "%s", name ? name : "");
    if (info) {
        gpiod_line_info_free(info);
    }
}

static int request(struct gpio_chip *chip, struct gpio_line *line,
                   struct gpiod_line_settings *settings)
{
    int number = 0;
    struct gpiod_request_config *request_config = gpiod_request_config_new();
    struct gpiod_line_config *line_config = gpiod_line_config_new();
    number = number_of(
        !request_config || !line_config ||
        gpiod_line_config_add_line_settings(line_config, &line->offset, 1, settings) != 0);
    if (number != 0) {
        goto out;
    }
    gpiod_request_config_set_consumer(request_config, consumer);
    line->request = gpiod_chip_request_lines(chip->chip, request_config, line_config);
    number = number_of(!line->request);
out:
    if (line_config) {
        gpiod_line_config_free(line_config);
    }
    if (request_config) {
        gpiod_request_config_free(request_config);
    }
    return number;
}

static int take(struct gpio_chip *chip, int offset, bool output, bool active_low,
                struct gpio_line **taken)
{
    int number = 0;
    struct gpiod_line_settings *settings = gpiod_line_settings_new();
    struct gpio_line *line = calloc(1, sizeof *line);
    if (!settings || !line) {
        number = ENOMEM;
        goto out;
    }
    line->offset = (unsigned)offset;
    gpiod_line_settings_set_active_low(settings, active_low);
    if (output) {
        number = number_of(
            gpiod_line_settings_set_direction(settings, GPIOD_LINE_DIRECTION_OUTPUT) != 0);
    } else {
        line->events = gpiod_edge_event_buffer_new(1);
        number = number_of(
            !line->events ||
            gpiod_line_settings_set_direction(settings, GPIOD_LINE_DIRECTION_INPUT) != 0 ||
            gpiod_line_settings_set_edge_detection(settings, GPIOD_LINE_EDGE_RISING) != 0);
    }
    if (number == 0) {
        number = request(chip, line, settings);
    }
out:
    if (number != 0) {
        gpio_line_free(line);
        line = NULL;
    }
    if (settings) {
        gpiod_line_settings_free(settings);
    }
    *taken = line;
    return number;
}

int gpio_line_take_output(struct gpio_chip *chip, int offset, bool active_low,
                          struct gpio_line **line)
{
    return take(chip, offset, true, active_low, line);
}

int gpio_line_take_input(struct gpio_chip *chip, int offset, bool active_low,
                         struct gpio_line **line)
{
    return take(chip, offset, false, active_low, line);
}

void gpio_line_free(struct gpio_line *line)
{
    if (!line) {
        return;
    }
    if (line->request) {
        gpiod_line_request_release(line->request);
    }
    if (line->events) {
        gpiod_edge_event_buffer_free(line->events);
    }
    free(line);
}

int gpio_line_set(struct gpio_line *line, bool active)
{
    enum gpiod_line_value value = active ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
    return number_of(gpiod_line_request_set_value(line->request, line->offset, value) != 0);
}

int gpio_line_wait(struct gpio_line *line, int64_t timeout_ns, int64_t *edge_ns)
{
    int found = gpiod_line_request_wait_edge_events(line->request, timeout_ns);
    if (found == 0) {
        enum gpiod_line_value value = gpiod_line_request_get_value(line->request, line->offset);
        return value == GPIOD_LINE_VALUE_ERROR ? number_of(1) : ETIMEDOUT;
    }
    int number = number_of(found < 0 ||
                           gpiod_line_request_read_edge_events(line->request, line->events, 1) < 1);
    if (number == 0) {
        struct gpiod_edge_event *event = gpiod_edge_event_buffer_get_event(line->events, 0);
        *edge_ns = (int64_t)gpiod_edge_event_get_timestamp_ns(event);
    }
    return number;
}
