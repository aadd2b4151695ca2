/* Light on a surface, as points that each carry the flux of their share of it. */
#ifndef RENDER_SAMPLES_H
#define RENDER_SAMPLES_H

#include "base/progress.h"
#include "render/irradiance.h"
#include "render/mapping.h"
#include "render/mesh.h"
#include "render/world.h"

#include <stddef.h>
#include <stdint.h>

struct light_sample {
    float position[3], normal[3]; /* the triangle's own normal */
    float flux[3];                /* irradiance times mm^2 */
    float area_mm2;               /* of the share; 0: a photon */
    float x, y;                   /* unwrapped surface point of the material, see mapping.h */
    int32_t chart;
    uint32_t texel; /* y * width + x of the surface point of the material */
};

struct light_samples {
    size_t count;
    struct light_sample *list;
    struct light_work work;
};

struct gather_surface;

/* What is lit: one translucent object among the scene's surfaces. */
struct lit_surface {
    const struct mesh *mesh;
    const struct mapping *mapping;
    size_t object; /* its number in the world */
    double index;  /* of refraction, for light that enters; 1: for all light alike */
    struct gather_surface
        *kept; /* from one gather on it to the next (gather_surface.h); NULL: nothing */
};

/* Points spread over the surface, `density` to the mm^2 and at least one in each triangle, each lit as irradiance_at
 * does. With lighting->before, those that come behind so many of the same seed. Deterministic for a seed on any number
 * of threads. */
int samples_spread(const struct lit_surface *surface, const struct lighting *lighting,
                   double density, struct progress *progress, struct light_samples *samples,
                   struct nacre_error *error);

/* `count` photons, shared among the lights, each kept where it meets this surface: where it first meets any, and as
 * often as it is passed on. Unbiased, and the reference for samples_spread. Where photons are passed on, they leave
 * translucent surfaces where they met them. */
int samples_shoot(const struct lit_surface *surface, const struct lighting *lighting, size_t count,
                  struct progress *progress, struct light_samples *samples,
                  struct nacre_error *error);

void samples_finish(struct light_samples *samples);

#endif
