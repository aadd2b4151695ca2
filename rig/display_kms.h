/* A display of the kernel's mode setting, taken from everyone else: pictures on it, one by one, and when each appeared.
 * By the calls that every driver has, with atomic commits or without. */
#ifndef RIG_DISPLAY_KMS_H
#define RIG_DISPLAY_KMS_H

#include "base/clock.h"
#include "rig/display_choice.h"

struct display_settings {
    const char *device;    /* node of the card; NULL: the first that has the connector */
    const char *connector; /* NULL: the one that is connected */
    const char *mode;      /* NULL: the preferred one */
};

struct display_flip {
    int64_t stamp_ns;  /* when the picture's first pixel was sent, on CLOCK_MONOTONIC */
    uint32_t sequence; /* of the refresh */
    bool counted; /* false: the driver counts no refreshes, and the stamp is when it was done */
};

struct display;

/* Take the display. `clock` is the system's monotonic one and outlives it; the strings of `settings` are not kept. */
int display_open(const struct display_settings *settings, struct clock *clock,
                 struct display **display, struct nacre_error *error);

/* Set mode, picture and properties back as they were, and free; overlays and pointers that were there are for their
 * programs to show again. NULL is allowed. */
void display_close(struct display *display);

int display_file(const struct display *display);
const char *display_name(
    const struct display *display); /* "projector HDMI-A-1 (/dev/dri/card0)", for messages */
const struct display_mode *display_mode(const struct display *display);
int64_t display_refresh_ns(const struct display *display);

/* What the driver did not let us set; empty if there is nothing. */
const char *display_remarks(const struct display *display);

/* Show a framebuffer of the mode's size and return when it has been sent for the first time. After a failure the one
 * before, or none, may be shown; the next call sets the mode anew. */
int display_flip(struct display *display, uint32_t framebuffer, struct display_flip *flip,
                 struct nacre_error *error);

/* Whether the last one that was shown still is, as far as the kernel knows. */
int display_check(struct display *display, struct nacre_error *error);

#endif
