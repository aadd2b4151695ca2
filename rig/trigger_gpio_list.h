/* The GPIO chips of this machine and their lines. */
#ifndef RIG_TRIGGER_GPIO_LIST_H
#define RIG_TRIGGER_GPIO_LIST_H

#include "nacre/error.h"

#include <stddef.h>

struct gpio_listed_line {
    char name[40];   /* empty: it has none */
    char holder[40]; /* what holds it, if that gave a name */
};

struct gpio_listed {
    char path[64]; /* of the device node */
    char label[64];
    struct gpio_listed_line *lines;
    size_t line_count;
    struct nacre_error problem; /* why no more is known; no text: none */
};

/* All chips, and those that may not be opened; the caller frees by gpio_list_free. */
int gpio_list(struct gpio_listed **chips, size_t *count, struct nacre_error *error);
void gpio_list_free(struct gpio_listed *chips, size_t count);

#endif
