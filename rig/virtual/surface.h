/* What the sample's surface does to light outside the sample: reflects it without letting it in, and carries dust. */
#ifndef RIG_VIRTUAL_SURFACE_H
#define RIG_VIRTUAL_SURFACE_H

#include "nacre/error.h"
#include "rig/station.h"
#include "rig/virtual/effects.h"
#include "rig/virtual/sample.h"

/* Maps over the surface points [height][width]; one that nothing calls for is NULL. */
struct surface {
    float *
        local; /* pi times the radiance towards the camera that a point reflects, over its irradiance */
    float *clear; /* the part of each point that no dust covers */
};

int surface_init(const struct station *station, const struct sample *sample,
                 const struct effects *effects, struct surface *surface, struct nacre_error *error);
void surface_finish(struct surface *surface);

/* pi times the reflected radiance over the irradiance: a rough surface's facets, of Beckmann's distribution and
 * Smith's shadowing, each a mirror by Fresnel's formulas (Cook and Torrance 1982, Walter et al. 2007). Directions are of
 * length 1, from the surface, with the normal along z. */
double surface_reflection(double roughness, double index, const double to_light[3],
                          const double to_camera[3]);

#endif
