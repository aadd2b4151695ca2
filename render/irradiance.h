/* Irradiance at points of surfaces: from lights by shadow rays, and from other surfaces by rays that look for them. */
#ifndef RENDER_IRRADIANCE_H
#define RENDER_IRRADIANCE_H

#include "render/lights.h"
#include "render/reflector.h"
#include "render/world.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* What was done, to be added up. */
struct light_work {
    uint64_t shadow_rays;            /* between surfaces and lights */
    uint64_t lookups[LIGHT_LOOKUPS]; /* samples of lights, by what they look up */
    uint64_t bounce_rays;            /* from surfaces to others, and of photons that go on */
    uint64_t photons;                /* sent out */
    uint64_t transmittances;         /* of light that enters, by its angle */
};

/* What lights surfaces: lights, or other surfaces that are lit, or both. */
struct lighting {
    const struct world *world;
    const struct light *lights;
    size_t light_count;
    bool shadows; /* false: nothing can stand between lights and surfaces */
    /* One for each object of the world; NULL: no light from other surfaces. With samples it is their radiosity that
     * counts, photons are passed on by their reflectance up to `bounces` times. */
    const struct reflector *reflectors;
    int bounces;
    int rays; /* to each soft light, and to other surfaces */
    uint64_t seed;
    double before; /* samples to the mm^2 that were spread already: others go on where they ended */
};

/* A point of a surface. `stream` numbers the points: neighbours in number share the light evenly between them. */
struct lit_point {
    struct vec3 position, normal;
    double index; /* of refraction: light that enters; 1: light on the surface */
    uint64_t stream;
};

/* Mean irradiance at a point: `rays` shadow rays to each soft light, one to every other light, `rays` to surfaces.
 * Adds to *work. Thread-safe. */
typedef void irradiance_way(const struct lighting *lighting, const struct lit_point *point,
                            double out[3], struct light_work *work);

/* The way to find it on a surface of that index, which does nothing for what is not there; chosen once for many points. */
irradiance_way *irradiance_choose(const struct lighting *lighting, double index);

/* The same for a single point. */
static inline void irradiance_at(const struct lighting *lighting, const struct lit_point *point,
                                 double out[3], struct light_work *work)
{
    irradiance_choose(lighting, point->index)(lighting, point, out, work);
}

/* The same for one soft light on a plain surface, where a quarter of the rays, and 36 at least, decides whether the
 * point lies in the penumbra: elsewhere the other rays are taken to agree with them. */
void irradiance_penumbra(const struct lighting *lighting, const struct light *light,
                         const struct lit_point *point, double out[3], struct light_work *work);

void light_work_add(struct light_work *sum, const struct light_work *more);

#endif
