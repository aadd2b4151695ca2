/* Light on a surface, as points that each carry the flux of their share of it. */
#ifndef RENDER_SAMPLES_H
#define RENDER_SAMPLES_H

#include "base/progress.h"
#include "render/lights.h"
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
    uint64_t rays;
};

/* What is lit: one translucent object among the scene's surfaces. */
struct lit_surface {
    const struct mesh *mesh;
    const struct mapping *mapping;
    size_t object; /* its number in the world */
};

/* Points spread over the surface, `density` to the mm^2 and at least one in each triangle, each with `rays` shadow rays
 * to every area light and one to the others. Deterministic for a seed on any number of threads. */
int samples_spread(const struct lit_surface *surface, const struct world *world,
                   const struct light *lights, size_t light_count, double density, int rays,
                   uint64_t seed, struct progress *progress, struct light_samples *samples,
                   struct nacre_error *error);

/* `count` photons, shared among the lights, that end where they first meet a surface; those that end on this one are
 * kept. Unbiased, and the reference for samples_spread. */
int samples_shoot(const struct lit_surface *surface, const struct world *world,
                  const struct light *lights, size_t light_count, size_t count, uint64_t seed,
                  struct progress *progress, struct light_samples *samples,
                  struct nacre_error *error);

void samples_finish(struct light_samples *samples);

#endif
