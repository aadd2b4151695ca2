/* GPIO chips of gpio-sim. */
#include "gpio_sim.h"

#include "guest.h"
#include "unity.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* At most so many lines of a chip have names. */
enum { NAMES = 4 };

static void make_folder(const char *path)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, mkdir(path, 0755), path);
}

struct gpio_sim gpio_sim_plug(const char *name, int count, const char *const *names)
{
    struct gpio_sim chip;
    char path[224];
    char text[32];
    guest_run(
        "modprobe gpio-sim && (mountpoint -q /sys/kernel/config || mount -t configfs configfs "
        "/sys/kernel/config)");
    (void)snprintf(chip.folder, sizeof chip.folder, "/sys/kernel/config/gpio-sim/%s", name);
    make_folder(chip.folder);
    (void)snprintf(path, sizeof path, "%s/bank", chip.folder);
    make_folder(path);
    (void)snprintf(path, sizeof path, "%s/bank/num_lines", chip.folder);
    (void)snprintf(text, sizeof text, "%d", count);
    guest_write(path, text);
    (void)snprintf(path, sizeof path, "%s/bank/label", chip.folder);
    guest_write(path, name);
    for (int i = 0; names && names[i] && i < NAMES; i++) {
        (void)snprintf(path, sizeof path, "%s/bank/line%d", chip.folder, i);
        make_folder(path);
        (void)snprintf(path, sizeof path, "%s/bank/line%d/name", chip.folder, i);
        guest_write(path, names[i]);
    }
    (void)snprintf(path, sizeof path, "%s/live", chip.folder);
    guest_write(path, "1");
    (void)snprintf(path, sizeof path, "%s/bank/chip_name", chip.folder);
    const char *node = guest_read(path);
    (void)snprintf(chip.path, sizeof chip.path, "/dev/%.40s", node);
    (void)snprintf(path, sizeof path, "%s/dev_name", chip.folder);
    (void)snprintf(chip.lines, sizeof chip.lines, "/sys/devices/platform/%.48s/%.40s",
                   guest_read(path), node);
    guest_wait_for(chip.path, true);
    return chip;
}

void gpio_sim_unplug(struct gpio_sim *chip)
{
    char path[224];
    if (chip->folder[0] == '\0') {
        return;
    }
    (void)snprintf(path, sizeof path, "%s/live", chip->folder);
    guest_write(path, "0");
    for (int i = 0; i < NAMES; i++) {
        (void)snprintf(path, sizeof path, "%s/bank/line%d", chip->folder, i);
        (void)rmdir(path); /* not every line has a name */
    }
    (void)snprintf(path, sizeof path, "%s/bank", chip->folder);
    TEST_ASSERT_EQUAL_INT(0, rmdir(path));
    TEST_ASSERT_EQUAL_INT(0, rmdir(chip->folder));
    guest_wait_for(chip->path, false);
    *chip = (struct gpio_sim){.folder = ""};
}

int gpio_sim_level(const struct gpio_sim *chip, int line)
{
    char path[224];
    (void)snprintf(path, sizeof path, "%s/sim_gpio%d/value", chip->lines, line);
    return guest_read(path)[0] == '1';
}

void gpio_sim_pull(const struct gpio_sim *chip, int line, int level)
{
    char path[224];
    (void)snprintf(path, sizeof path, "%s/sim_gpio%d/pull", chip->lines, line);
    guest_write(path, level ? "pull-up" : "pull-down");
}
