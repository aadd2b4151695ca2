/* A GPIO chip of the kernel's gpio-sim driver, whose lines a test sees from the other side. */
#ifndef TESTS_LAB_GPIO_SIM_H
#define TESTS_LAB_GPIO_SIM_H

struct gpio_sim {
    char folder[128]; /* in configfs */
    char path[64];    /* of the chip's device node */
    char lines[160];  /* in sysfs: where the lines are seen and driven */
};

/* Plug in a chip NAME with `count` lines; the first ones get names as far as the NULL-terminated list goes. */
struct gpio_sim gpio_sim_plug(const char *name, int count, const char *const *names);
void gpio_sim_unplug(struct gpio_sim *chip); /* a chip that is not plugged in is left alone */

/* The level of a line, and pulling an input up or down. */
int gpio_sim_level(const struct gpio_sim *chip, int line);
void gpio_sim_pull(const struct gpio_sim *chip, int line, int level);

#endif
