/* Asking for GPIO chips and lines. */
#include "rig/trigger_gpio_list.h"

#include "rig/trigger_gpio_line.h"
#include "rig/trigger_gpio_pin.h"

#include <glob.h>
#include <stdio.h>
#include <stdlib.h>

static int list_lines(struct gpio_chip *chip, struct gpio_listed *listed)
{
    int lines = gpio_chip_line_count(chip);
    size_t count = lines > 0 ? (size_t)lines : 0;
    (void)snprintf(listed->label, sizeof listed->label, "%s", gpio_chip_label(chip));
    listed->lines = calloc(count + 1, sizeof *listed->lines);
    if (!listed->lines) {
        return nacre_fail_memory(&listed->problem, "the list of GPIO lines");
    }
    listed->line_count = count;
    for (size_t i = 0; i < count; i++) {
        struct gpio_listed_line *line = &listed->lines[i];
        gpio_chip_line_name(chip, (int)i, line->name, sizeof line->name);
        gpio_chip_line_holder(chip, (int)i, line->holder, sizeof line->holder);
    }
    return NACRE_OK;
}

static void look_at(const char *path, struct gpio_listed *listed)
{
    struct gpio_chip *chip = NULL;
    (void)snprintf(listed->path, sizeof listed->path, "%s", path);
    int number = gpio_chip_open(path, &chip);
    if (number != 0) {
        (void)gpio_chip_fail_open(path, number, &listed->problem);
    } else {
        (void)list_lines(chip, listed); /* what failed is in the problem */
    }
    gpio_chip_close(chip);
}

int gpio_list(struct gpio_listed **chips, size_t *count, struct nacre_error *error)
{
    glob_t nodes = {0};
    int status = NACRE_OK;
    *count = 0;
    (void)glob("/dev/gpiochip[0-9]*", 0, NULL, &nodes); /* no match leaves no paths */
    *chips = calloc(nodes.gl_pathc + 1, sizeof **chips);
    if (!*chips) {
        status = nacre_fail_memory(error, "the list of GPIO chips");
        goto out;
    }
    for (size_t i = 0; i < nodes.gl_pathc; i++) {
        look_at(nodes.gl_pathv[i], &(*chips)[i]);
    }
    *count = nodes.gl_pathc;
out:
    globfree(&nodes);
    return status;
}

void gpio_list_free(struct gpio_listed *chips, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        free(chips[i].lines);
    }
    free(chips);
}
