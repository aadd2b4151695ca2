/* Printing cameras, displays and GPIO chips. */
#include "cmd/devices_rig.h"

#include <stdio.h>
#include <stdlib.h>

/* So many modes of a connector are printed for people. */
enum { MODES_PRINTED = 8 };

int rig_devices_find(struct rig_devices *devices, struct nacre_error *error)
{
    *devices = (struct rig_devices){.camera_count = 0};
    int status = camera_list(&devices->cameras, &devices->camera_count, error);
    if (status == NACRE_OK) {
        status = display_cards_list(&devices->cards, &devices->card_count, devices->refused,
                                    sizeof devices->refused, error);
    }
    if (status == NACRE_OK) {
        status = gpio_list(&devices->chips, &devices->chip_count, error);
    }
    if (status != NACRE_OK) {
        rig_devices_finish(devices);
    }
    return status;
}

void rig_devices_finish(struct rig_devices *devices)
{
    free(devices->cameras);
    display_cards_free(devices->cards, devices->card_count);
    gpio_list_free(devices->chips, devices->chip_count);
    *devices = (struct rig_devices){.camera_count = 0};
}

static void print_camera(const struct camera_listed *camera)
{
    if (camera->problem.text[0] != '\0') {
        (void)printf("  %s  %s\n", camera->path, camera->problem.text);
        return;
    }
    (void)printf("  %s  %s:", camera->path, camera->card);
    for (size_t i = 0; i < camera->format_count; i++) {
        const struct camera_format *format = camera->formats[i];
        (void)printf("%s %s %d bits (%s)", i > 0 ? "," : "", bayer_names[format->bayer],
                     format->bits, camera_code_text(format->code).text);
    }
    (void)printf("%s\n", camera->format_count == 0 ? " no raw format" : "");
}

static void print_connector(const struct display_connector *connector)
{
    (void)printf("    %s  %s", connector->name,
                 connector->connected ? "connected" : "disconnected");
    for (size_t i = 0; i < connector->mode_count; i++) {
        char text[DISPLAY_MODE_TEXT];
        display_mode_print(&connector->modes[i], text);
        if (i < MODES_PRINTED) {
            (void)printf("%s%s%s", i == 0 ? ": " : ", ", text,
                         connector->modes[i].timing.type & DRM_MODE_TYPE_PREFERRED ? " (preferred)"
                                                                                   : "");
        }
    }
    if (connector->mode_count > MODES_PRINTED) {
        (void)printf(" and %zu more", connector->mode_count - MODES_PRINTED);
    }
    (void)printf("\n");
}

static void print_card(const struct display_card *card)
{
    (void)printf("  %s  %s%s\n", card->path, card->driver,
                 card->connector_count == 0 ? ", without connectors" : "");
    for (size_t i = 0; i < card->connector_count; i++) {
        print_connector(&card->connectors[i]);
    }
}

static void print_chip(const struct gpio_listed *chip)
{
    if (chip->problem.text[0] != '\0') {
        (void)printf("  %s  %s\n", chip->path, chip->problem.text);
        return;
    }
    (void)printf("  %s  %s, %zu lines", chip->path, chip->label, chip->line_count);
    const char *before = ": ";
    for (size_t i = 0; i < chip->line_count; i++) {
        const struct gpio_listed_line *line = &chip->lines[i];
        if (line->name[0] != '\0' || line->holder[0] != '\0') {
            (void)printf("%s%zu%s%s", before, i, line->name[0] ? " " : "", line->name);
            before = ", ";
        }
        if (line->holder[0] != '\0') {
            (void)printf(" (held by %s)", line->holder);
        }
    }
    (void)printf("\n");
}

void rig_devices_print(const struct rig_devices *devices)
{
    (void)printf("Cameras:%s\n", devices->camera_count == 0 ? " none" : "");
    for (size_t i = 0; i < devices->camera_count; i++) {
        print_camera(&devices->cameras[i]);
    }
    bool refused = devices->refused[0] != '\0';
    (void)printf("Displays:%s\n", devices->card_count == 0 && !refused ? " none" : "");
    for (size_t i = 0; i < devices->card_count; i++) {
        print_card(&devices->cards[i]);
    }
    if (refused) {
        struct nacre_error problem;
        (void)display_fail_open(devices->refused, &problem);
        (void)printf("  %s\n", problem.text);
    }
    (void)printf("GPIO chips:%s\n", devices->chip_count == 0 ? " none" : "");
    for (size_t i = 0; i < devices->chip_count; i++) {
        print_chip(&devices->chips[i]);
    }
}

/* A driver's text that is no UTF-8 makes packing fail, and what it names is left out. */
static json_t *cameras_json(const struct rig_devices *devices)
{
    json_t *list = json_array();
    for (size_t i = 0; i < devices->camera_count; i++) {
        const struct camera_listed *camera = &devices->cameras[i];
        json_t *formats = json_array();
        for (size_t k = 0; k < camera->format_count; k++) {
            const struct camera_format *format = camera->formats[k];
            (void)json_array_append_new(
                formats, json_pack("{s:s, s:s, s:i}", "code", camera_code_text(format->code).text,
                                   "bayer", bayer_names[format->bayer], "bits", format->bits));
        }
        json_t *entry =
            camera->problem.text[0] == '\0'
                ? json_pack("{s:s, s:s, s:O}", "device", camera->path, "card", camera->card,
                            "formats", formats)
                : json_pack("{s:s, s:s}", "device", camera->path, "problem", camera->problem.text);
        json_decref(formats);
        (void)json_array_append_new(list, entry);
    }
    return list;
}

static json_t *connector_json(const struct display_connector *connector)
{
    json_t *modes = json_array();
    for (size_t i = 0; i < connector->mode_count; i++) {
        char text[DISPLAY_MODE_TEXT];
        display_mode_print(&connector->modes[i], text);
        (void)json_array_append_new(modes, json_string(text));
    }
    return json_pack("{s:s, s:b, s:o}", "name", connector->name, "connected", connector->connected,
                     "modes", modes);
}

static json_t *cards_json(const struct rig_devices *devices)
{
    json_t *list = json_array();
    for (size_t i = 0; i < devices->card_count; i++) {
        const struct display_card *card = &devices->cards[i];
        json_t *connectors = json_array();
        for (size_t k = 0; k < card->connector_count; k++) {
            (void)json_array_append_new(connectors, connector_json(&card->connectors[k]));
        }
        (void)json_array_append_new(list,
                                    json_pack("{s:s, s:s, s:o}", "device", card->path, "driver",
                                              card->driver, "connectors", connectors));
    }
    if (devices->refused[0] != '\0') {
        struct nacre_error problem;
        (void)display_fail_open(devices->refused, &problem);
        (void)json_array_append_new(
            list, json_pack("{s:s, s:s}", "device", devices->refused, "problem", problem.text));
    }
    return list;
}

static json_t *chips_json(const struct rig_devices *devices)
{
    json_t *list = json_array();
    for (size_t i = 0; i < devices->chip_count; i++) {
        const struct gpio_listed *chip = &devices->chips[i];
        json_t *lines = json_array();
        for (size_t k = 0; k < chip->line_count; k++) {
            (void)json_array_append_new(lines, json_pack("{s:s, s:s}", "name", chip->lines[k].name,
                                                         "holder", chip->lines[k].holder));
        }
        json_t *entry =
            chip->problem.text[0] == '\0'
                ? json_pack("{s:s, s:s, s:O}", "device", chip->path, "label", chip->label, "lines",
                            lines)
                : json_pack("{s:s, s:s}", "device", chip->path, "problem", chip->problem.text);
        json_decref(lines);
        (void)json_array_append_new(list, entry);
    }
    return list;
}

void rig_devices_json(const struct rig_devices *devices, json_t *object)
{
    (void)json_object_set_new(object, "cameras", cameras_json(devices));
    (void)json_object_set_new(object, "displays", cards_json(devices));
    (void)json_object_set_new(object, "gpio_chips", chips_json(devices));
}
