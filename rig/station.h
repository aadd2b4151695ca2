/* station.yaml: the devices of a scanning station and what is known of them. */
#ifndef RIG_STATION_H
#define RIG_STATION_H

#include "base/settings.h"
#include "nacre/error.h"
#include "rig/bayer.h"
#include "rig/virtual/settings.h"

struct station {
    struct {
        int width, height; /* surface points = projector pixels of the sample's region */
        double pitch_mm;   /* between surface points */
    } sample;
    struct {
        int driver;        /* index into the drivers this build knows */
        int width, height; /* raw pixels kept of each frame */
        int bits;          /* a saturated pixel holds 2^bits - 1 */
        int bayer;         /* enum bayer */
        double pedestal;   /* raw value without light */
        double read_noise; /* standard deviation, raw units */
        double electrons;  /* photo-electrons in one raw unit, for the shot noise */
    } camera;
    struct {
        int driver;
        double wheel_hz; /* turns of the colour wheel a second; exposures are whole turns */
    } projector;
    struct {
        int driver;
    } trigger;
    double white_reflectance[3];       /* R G B, of the white diffuse layer */
    struct virtual_settings simulated; /* key `virtual`: of the drivers called virtual */
};

extern const struct settings_schema station_schema;

/* Read and check a station file; station_finish frees. */
int station_read(const char *path, struct station *station, struct nacre_error *error);
void station_finish(struct station *station);

#endif
