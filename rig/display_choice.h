/* Graphics cards, their connectors and modes as data, and which of them a station means. */
#ifndef RIG_DISPLAY_CHOICE_H
#define RIG_DISPLAY_CHOICE_H

#include "nacre/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <xf86drmMode.h>

struct display_mode {
    drmModeModeInfo timing; /* the kernel's own description */
    double refresh_hz;
};

struct display_connector {
    uint32_t id;
    char name[32]; /* "HDMI-A-1" */
    bool connected;
    struct display_mode *modes; /* the preferred first, as the kernel sorts them */
    size_t mode_count;
};

/* Room for a device node's path, and for it with a connector in a message. */
enum { DISPLAY_PATH = 256, DISPLAY_NAME = 320 };

struct display_card {
    char path[DISPLAY_PATH]; /* of the device node */
    char driver[32];         /* what the kernel's driver calls itself */
    struct display_connector *connectors;
    size_t connector_count;
};

/* What "1920x1080@60" says. */
struct display_mode_wish {
    int width, height;
    double refresh_hz; /* 0: any */
};

/* Read "WIDTHxHEIGHT" or "WIDTHxHEIGHT@HERTZ". */
int display_mode_parse(const char *text, struct display_mode_wish *wish, struct nacre_error *error);

/* Room for "32767x32767@1000.000". */
enum { DISPLAY_MODE_TEXT = 40 };

/* The text that display_mode_parse takes for this mode. */
void display_mode_print(const struct display_mode *mode, char text[DISPLAY_MODE_TEXT]);

/* The mode with these timings. */
struct display_mode display_mode_of(const drmModeModeInfo *timing);

/* Whether the whole of a picture is shown at every refresh, with one line for each of its rows. */
bool display_mode_is_whole(const struct display_mode *mode);

/* The first card that has the connector called `connector`, or without a name one that is connected. */
int display_choose_card(const struct display_card *cards, size_t count, const char *connector,
                        size_t *chosen, struct nacre_error *error);

/* The connector called `name`, which must be connected; without a name the one that is connected. */
int display_choose_connector(const struct display_card *card, const char *name, size_t *chosen,
                             struct nacre_error *error);

/* The mode that `text` asks for, the nearest of those within half a hertz; without a text the preferred one. */
int display_choose_mode(const struct display_connector *connector, const char *text, size_t *chosen,
                        struct nacre_error *error);

/* The pixels of a frame that patterns are drawn on, from its upper left corner. */
struct display_region {
    int left, top, width, height;
};

/* Whether a frame holds the region. */
bool display_region_fits(const struct display_region *region, int frame_width, int frame_height);

#endif
