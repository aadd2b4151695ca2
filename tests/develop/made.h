/* A made station: exact pictures of a made material through a pinhole, a mosaic and a noisy sensor. It shares no code
 * with rig/develop/ nor with the virtual station. */
#ifndef TESTS_DEVELOP_MADE_H
#define TESTS_DEVELOP_MADE_H

#include "rig/session.h"

#include <stdbool.h>
#include <stdint.h>

/* Numbers that are the same everywhere. */
struct made_random {
    uint64_t state;
};
double made_uniform(struct made_random *random); /* in (0, 1) */
double made_normal(struct made_random *random);
double made_poisson(struct made_random *random, double mean); /* normal above 60 */

struct made_station {
    int width, height; /* surface points */
    int camera_width, camera_height, bits;
    enum bayer bayer;
    double pedestal, read_noise, electrons; /* 0: none */
    double map[9];                          /* surface to camera, row by row */
    double gain[3];    /* raw units a second of a pixel full of radiosity 1, before vignetting */
    double vignetting; /* loss in the camera's corners */
    double
        lens; /* share of the radius by which the lens moves what is half the frame's diagonal off */
    double lens_x, lens_y; /* its centre, px from the frame's middle */
    double blur_px;        /* the lens spreads light over so many pixels more than one */
    double soft_px; /* the sample's light is soft by as many pixels, seen by a lens that is sharp */
    double layer_soft_px; /* the white layer's light is */
    double black;         /* irradiance of a dark projector pixel; of a lit one it is 1 */
    double reach;         /* decay length of the material, surface points */
    double white[3];      /* reflectance of the white layer */
    int dead_x, dead_y;   /* a pixel that sees nothing; -1: none */
};

/* 40 x 36 points seen by 190 x 170 pixels of 10 bits from aside, with all kinds of noise. */
struct made_station made_station_usual(void);

/* R_d of the made material, (xi, yi) to (xo, yo): two materials, not symmetric about anything. */
double made_transfer(const struct made_station *station, int channel, int xi, int yi, int xo,
                     int yo);

/* radiosity[3][height][width] under levels[height][width] (0 or 255), on the bare sample or the white layer. */
void made_light(const struct made_station *station, const uint8_t *levels, bool white_layer,
                float *radiosity);

/* What the sensor gets of it: signal[camera_height][camera_width], raw units a second above the pedestal. */
void made_signal(const struct made_station *station, const float *radiosity, double *signal);

/* One exposure, raw[camera_height][camera_width]. */
void made_expose(const struct made_station *station, const double *signal, double seconds,
                 struct made_random *random, uint16_t *raw);

/* Write FOLDER/station.yaml and plan.yaml. */
void made_write_settings(const struct made_station *station, const char *folder,
                         const char *plan_text);

/* The usual plan: spacing and window 9, exposures of 1 to 64 turns of 0.1 ms. */
extern const char made_plan_text[];

/* Measure everything of a plan into the new session FOLDER/session and return its path (heap). */
char *made_session(const struct made_station *station, const char *folder, const char *plan_text);

/* Measure one pattern of the session at `path` (again), or with `fill` >= 0 write frames that hold that value alone. */
void made_measure(const struct made_station *station, const char *path, struct pattern pattern,
                  int fill);

#endif
