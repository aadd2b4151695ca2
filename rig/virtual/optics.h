/* The geometry of the virtual station: where surface points appear in the raw frame, and how bright. */
#ifndef RIG_VIRTUAL_OPTICS_H
#define RIG_VIRTUAL_OPTICS_H

#include "nacre/error.h"
#include "rig/station.h"

#include <stddef.h>
#include <stdint.h>

/* The linear map from radiosity[3][height][width] of the surface points to the signal of every raw pixel, as a sparse
 * matrix by rows. Zero-initialised it is empty. */
struct optics {
    size_t pixel_count;
    size_t *starts;   /* [pixel_count + 1], into the two below */
    uint32_t *points; /* indices into radiosity */
    float *weights;   /* raw units a second */
};

/* The homography from surface points to raw pixels: (u, v, w) = h (x, y, 1) is pixel (u / w, v / w). Point and pixel
 * (i, j) cover [i, i + 1] x [j, j + 1]. */
void optics_homography(const struct station *station, double h[3][3]);

/* The camera of the station: off-axis view, footprint of each pixel on the surface, vignetting, colour filters. */
int optics_init(const struct station *station, struct optics *optics, struct nacre_error *error);
void optics_finish(struct optics *optics);

/* signal[pixel], in raw units a second above the pedestal. */
void optics_apply(const struct optics *optics, const float *radiosity, float *signal);

/* The projector's light: irradiance[3][height][width] for levels[height][width], 1 where white falls in the centre. */
void optics_project(const struct station *station, const uint8_t *levels, float *irradiance);

#endif
