/* station.yaml: the devices of a scanning station and what is known of them. */
#ifndef RIG_STATION_H
#define RIG_STATION_H

#include "base/settings.h"
#include "nacre/error.h"
#include "rig/bayer.h"
#include "rig/driver_settings.h"
#include "rig/virtual/settings.h"

#include <stdbool.h>

/* Values of each `driver`: indices into the names of the station schema, of which the first is always virtual. */
enum camera_driver { CAMERA_DRIVER_VIRTUAL, CAMERA_DRIVER_V4L2 };
enum projector_driver { PROJECTOR_DRIVER_VIRTUAL, PROJECTOR_DRIVER_EGL };
enum trigger_driver {
    TRIGGER_DRIVER_VIRTUAL,
    TRIGGER_DRIVER_USB,
    TRIGGER_DRIVER_GPIO,
    TRIGGER_DRIVER_NONE
};

struct station_sample {
    int width, height; /* surface points = projector pixels of the sample's region */
    double pitch_mm;   /* between surface points */
    double size_mm;    /* measured width of the region, which tells the pitch; 0: not given */
};

struct station_camera {
    int driver;          /* enum camera_driver */
    int width, height;   /* raw pixels kept of each frame */
    int bits;            /* a saturated pixel holds 2^bits - 1 */
    int bayer;           /* enum bayer */
    double pedestal;     /* raw value without light */
    double read_noise;   /* standard deviation, raw units; 0: none */
    double electrons;    /* photo-electrons in one raw unit, for the shot noise; 0: no shot noise */
    double tolerance_ms; /* by which a frame may begin before or after its trigger */
    struct v4l2_settings v4l2;           /* of the driver v4l2 */
    int read_noise_line, electrons_line; /* in the file, for messages */
};

struct station_projector {
    int driver;              /* enum projector_driver */
    double wheel_hz;         /* turns of the colour wheel a second; exposures are whole turns */
    struct egl_settings egl; /* of the driver egl */
};

struct station_trigger {
    int driver;                /* enum trigger_driver */
    struct gpio_settings gpio; /* of the driver gpio */
};

struct station {
    struct station_sample sample;
    struct station_camera camera;
    struct station_projector projector;
    struct station_trigger trigger;
    double white_reflectance[3]; /* R G B, of the white diffuse layer */
    char *plan;                  /* plan file that is used unless another is named; may be NULL */
    struct virtual_settings simulated; /* key `virtual`: of the drivers called virtual */
    char **without;                    /* names of effects that are not to be simulated; heap */
    size_t without_count;
    int without_line; /* in the file */
};

extern const struct settings_schema station_schema;

/* Read and check a station file; station_finish frees. Paths in it become absolute. */
int station_read(const char *path, struct station *station, struct nacre_error *error);
void station_finish(struct station *station);

/* Whether everything is simulated. */
bool station_is_virtual(const struct station *station);

#endif
