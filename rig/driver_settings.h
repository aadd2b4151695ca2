/* The keys of a station file that are for one driver alone: `v4l2` of a camera, `egl` of a projector,
 * `gpio` of a trigger. Data only. */
#ifndef RIG_DRIVER_SETTINGS_H
#define RIG_DRIVER_SETTINGS_H

#include "base/settings.h"

#include <stdbool.h>

struct v4l2_settings {
    char *device;    /* node of the camera */
    char *subdevice; /* node of its sensor, where that has the controls; may be NULL */
    int frame_width, frame_height; /* of whole frames; 0: as much as is kept */
    int left, top;                 /* first pixel kept */
    int mode;                      /* enum camera_mode */
    int shutter;                   /* 0 global, 1 rolling */
    int gain;                      /* in the driver's unit; -1: as it is */
    double stamp_delay_ms;         /* from the exposure to the driver's stamp of its frame */
    int settle_frames; /* that may still have the exposure before, after it was changed */
    int line;          /* of the key in its file; 0: it is left out */
};

struct egl_settings {
    char *device;      /* node of the graphics card; NULL: the first with the connector */
    char *connector;   /* "HDMI-A-1"; NULL: the one that is connected */
    char *mode;        /* "1920x1080@60"; NULL: the preferred one */
    int left, top;     /* first pixel of the sample's region */
    double latency_ms; /* from the refresh that sends a pattern until it is whole on the glass */
    int line;          /* of the key in its file; 0: it is left out */
};

struct gpio_line_settings {
    char *line; /* by its name, or */
    char *chip; /* by the chip's path, name or label ... */
    int offset; /* ... and the line's number in it */
    bool active_low;
};

struct gpio_settings {
    struct gpio_line_settings output; /* to the camera */
    struct gpio_line_settings index;  /* from the colour wheel; all empty: there is none */
    double index_delay_us;            /* from the index until the pulse begins */
    double jitter_us;                 /* by which a pulse may be late, too long or too short */
    int line;                         /* of the key in its file; 0: it is left out */
};

extern const struct settings_schema v4l2_settings_schema, egl_settings_schema, gpio_settings_schema;

#endif
