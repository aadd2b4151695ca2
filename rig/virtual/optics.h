/* The geometry of the virtual station: where surface points appear in the raw frame, and how bright. */
#ifndef RIG_VIRTUAL_OPTICS_H
#define RIG_VIRTUAL_OPTICS_H

#include "nacre/error.h"
#include "rig/station.h"
#include "rig/virtual/effects.h"

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
 * (i, j) cover [i, i + 1] x [j, j + 1]. Surface points are where the projector's parallel light falls, on a stage that
 * is tilted too. */
void optics_homography(const struct station *station, const struct effects *effects,
                       double h[3][3]);

/* Where projector and camera are seen from place (x, y) of the surface, in points: of length 1, with the surface's normal
 * along z. */
void optics_directions(const struct station *station, const struct effects *effects, double x,
                       double y, double to_light[3], double to_camera[3]);

/* What is left of the light at a place of a width x height field that loses `loss` in its corners. */
double optics_falloff(double loss, double x, double y, int width, int height);

/* The camera of the station: off-axis view, footprint of each pixel on the surface, colour filters, and what the effects
 * have of lens and pixels. */
int optics_init(const struct station *station, struct effects *effects, struct optics *optics,
                struct nacre_error *error);
void optics_finish(struct optics *optics);

/* signal[pixel], in raw units a second above the pedestal. */
void optics_apply(const struct optics *optics, const float *radiosity, float *signal);

#endif
