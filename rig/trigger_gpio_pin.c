/* Finding and taking GPIO lines. */
#include "rig/trigger_gpio_pin.h"

#include <errno.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool is_refusal(int number)
{
    return number == EACCES || number == EPERM;
}

int gpio_chip_fail_open(const char *path, int number, struct nacre_error *error)
{
    if (is_refusal(number)) {
        return nacre_fail(
            error,
            "GPIO chip %s: may not be opened; install udev/70-nacre-gpio.rules, and be in the "
            "group nacre",
            path);
    }
    if (number == ENOENT) {
        return nacre_fail(error,
                          "GPIO chip %s: is not there; plug its board in or load its driver; "
                          "`gpiodetect` lists those that are",
                          path);
    }
    if (number == ENODEV || number == ENOTTY) {
        return nacre_fail(
            error, "GPIO chip %s: is no GPIO chip; `gpiodetect` lists those that are there", path);
    }
    return nacre_fail_errno(error, number, "GPIO chip %s: cannot be opened", path);
}

/* What was seen of the machine's chips. */
struct search {
    size_t chips;     /* that could be opened */
    bool called;      /* one has the wanted name */
    int number;       /* of the last failure to open one */
    char refused[64]; /* one that may not be opened */
};

static bool is_called(struct gpio_chip *chip, const char *path, const char *wanted)
{
    const char *name = strrchr(path, '/') + 1;
    return !wanted || strcmp(path, wanted) == 0 || strcmp(name, wanted) == 0 ||
           strcmp(gpio_chip_label(chip), wanted) == 0;
}

/* Look at one chip: whether it is the wanted one and has the line. Leaves it open if so. */
static bool look_at(const char *path, const struct gpio_place *place, struct search *search,
                    struct gpio_pin *pin, int *offset)
{
    int number = gpio_chip_open(path, &pin->chip);
    if (number != 0) {
        search->number = number;
        if (is_refusal(number)) {
            (void)snprintf(search->refused, sizeof search->refused, "%s", path);
        }
        return false;
    }
    search->chips++;
    if (is_called(pin->chip, path, place->chip)) {
        search->called = true;
        *offset = place->name ? gpio_chip_find_line(pin->chip, place->name) : place->offset;
        if (*offset >= 0) {
            return true;
        }
    }
    gpio_chip_close(pin->chip);
    pin->chip = NULL;
    return false;
}

static int fail_search(const struct gpio_place *place, const struct search *search,
                       struct nacre_error *error)
{
    if (search->called && place->chip) {
        return nacre_fail(error,
                          "GPIO chip %s: has no line called \"%s\"; `gpioinfo` lists its lines",
                          place->chip, place->name);
    }
    if (search->refused[0]) {
        return gpio_chip_fail_open(search->refused, EACCES, error);
    }
    if (search->chips == 0) {
        return nacre_fail(
            error, "GPIO: the machine has no GPIO chip; plug its board in or load its driver");
    }
    if (place->chip) {
        return gpio_chip_fail_open(place->chip, ENOENT, error);
    }
    return nacre_fail(error,
                      "GPIO line \"%s\": no chip has a line of this name; `gpioinfo` lists them",
                      place->name);
}

/* Open the chip that has the line. */
static int find(const struct gpio_place *place, struct gpio_pin *pin, char *path, size_t size,
                int *offset, struct nacre_error *error)
{
    struct search search = {0};
    glob_t nodes = {0};
    bool by_path = place->chip && place->chip[0] == '/';
    bool found = false;
    int status = NACRE_OK;
    if (glob(by_path ? place->chip : "/dev/gpiochip*", by_path ? GLOB_NOCHECK : 0, NULL, &nodes) ==
        0) {
        for (size_t i = 0; i < nodes.gl_pathc && !found; i++) {
            found = look_at(nodes.gl_pathv[i], place, &search, pin, offset);
            (void)snprintf(path, size, "%s", nodes.gl_pathv[i]);
        }
    }
    if (!found) {
        status = by_path && search.number != 0
                     ? gpio_chip_fail_open(place->chip, search.number, error)
                     : fail_search(place, &search, error);
    } else if (*offset >= gpio_chip_line_count(pin->chip)) {
        status =
            nacre_fail(error, "GPIO chip %s: has no line %d, as it has %d lines, counted from 0",
                       path, *offset, gpio_chip_line_count(pin->chip));
    }
    globfree(&nodes);
    return status;
}

static int fail_take(const struct gpio_pin *pin, int offset, int number, struct nacre_error *error)
{
    char holder[64];
    if (number != EBUSY) {
        return nacre_fail_errno(error, number, "%s: cannot be taken", pin->what);
    }
    gpio_chip_line_holder(pin->chip, offset, holder, sizeof holder);
    return nacre_fail(error, "%s: is held by %s%s%s; stop that, or choose another line", pin->what,
                      holder[0] ? "\"" : "something without a name", holder, holder[0] ? "\"" : "");
}

int gpio_pin_open(const struct gpio_place *place, enum gpio_use use, struct gpio_pin *pin,
                  struct nacre_error *error)
{
    char path[96] = "";
    int offset = -1;
    *pin = (struct gpio_pin){.chip = NULL};
    int status = find(place, pin, path, sizeof path, &offset, error);
    if (status != NACRE_OK) {
        goto out;
    }
    (void)snprintf(pin->what, sizeof pin->what, "GPIO line %d%s%.40s%s of %.80s", offset,
                   place->name ? " (" : "", place->name ? place->name : "", place->name ? ")" : "",
                   path);
    int number = use == GPIO_OUTPUT
                     ? gpio_line_take_output(pin->chip, offset, place->active_low, &pin->line)
                     : gpio_line_take_input(pin->chip, offset, place->active_low, &pin->line);
    if (number != 0) {
        status = fail_take(pin, offset, number, error);
    }
out:
    if (status != NACRE_OK) {
        gpio_pin_close(pin);
    }
    return status;
}

void gpio_pin_close(struct gpio_pin *pin)
{
    gpio_line_free(pin->line);
    gpio_chip_close(pin->chip);
    pin->line = NULL;
    pin->chip = NULL;
}
