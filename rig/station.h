/* station.yaml: the devices of a scanning station and what is known of them. */
#ifndef RIG_STATION_H
#define RIG_STATION_H

#include "base/settings.h"
#include "nacre/error.h"
#include "rig/bayer.h"
#include "rig/virtual/settings.h"

/* Values of every `driver`: indices into the names of the station schema. */
enum station_driver { DRIVER_VIRTUAL };

struct station_sample {
    int width, height; /* surface points = projector pixels of the sample's region */
    double pitch_mm;   /* between surface points */
};

struct station_camera {
    int driver;        /* enum station_driver */
    int width, height; /* raw pixels kept of each frame */
    int bits;          /* a saturated pixel holds 2^bits - 1 */
    int bayer;         /* enum bayer */
    double pedestal;   /* raw value without light */
    double read_noise; /* standard deviation, raw units; 0: none */
    double electrons;  /* photo-electrons in one raw unit, for the shot noise; 0: no shot noise */
};

struct station_projector {
    int driver;      /* enum station_driver */
    double wheel_hz; /* turns of the colour wheel a second; exposures are whole turns */
};

struct station_trigger {
    int driver; /* enum station_driver */
};

struct station {
    struct station_sample sample;
    struct station_camera camera;
    struct station_projector projector;
    struct station_trigger trigger;
    double white_reflectance[3]; /* R G B, of the white diffuse layer */
    char *plan;                  /* plan file that is used unless another is named; may be NULL */
    struct virtual_settings simulated; /* key `virtual`: of the drivers called virtual */
};

extern const struct settings_schema station_schema;

/* Read and check a station file; station_finish frees. Paths in it become absolute. */
int station_read(const char *path, struct station *station, struct nacre_error *error);
void station_finish(struct station *station);

#endif
