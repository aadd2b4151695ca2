/* Cameras, displays and GPIO chips, printed. */
#ifndef CMD_DEVICES_RIG_H
#define CMD_DEVICES_RIG_H

#include "rig/camera_list.h"
#include "rig/display_list.h"
#include "rig/trigger_gpio_list.h"

#include <jansson.h>

struct rig_devices {
    struct camera_listed *cameras;
    size_t camera_count;
    struct display_card *cards;
    size_t card_count;
    char refused[DISPLAY_PATH]; /* a card that may not be opened; may be empty */
    struct gpio_listed *chips;
    size_t chip_count;
};

/* Look for all; rig_devices_finish frees. */
int rig_devices_find(struct rig_devices *devices, struct nacre_error *error);
void rig_devices_finish(struct rig_devices *devices);

void rig_devices_print(const struct rig_devices *devices);

/* Put them into the object, as `cameras`, `displays` and `gpio_chips`. */
void rig_devices_json(const struct rig_devices *devices, json_t *object);

#endif
