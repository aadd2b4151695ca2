/* Irradiance at points of surfaces, by shadow rays. */
#ifndef RENDER_IRRADIANCE_H
#define RENDER_IRRADIANCE_H

#include "render/lights.h"
#include "render/world.h"

#include <stddef.h>
#include <stdint.h>

/* Mean irradiance at a point with unit normal: `rays` shadow rays to each area light, one to every
 * other light. `stream` numbers the points; neighbours in number share the light evenly between
 * them. Returns the number of rays cast. Thread-safe. */
uint64_t irradiance_at(const struct world *world, const struct light *lights, size_t light_count,
                       struct vec3 point, struct vec3 normal, int rays, uint64_t seed,
                       uint64_t stream, double out[3]);

/* The same for one area light, where a quarter of the rays decides whether the point lies in the
 * penumbra: elsewhere the other rays are taken to agree with them. */
uint64_t irradiance_penumbra(const struct world *world, const struct light *light,
                             struct vec3 point, struct vec3 normal, int rays, uint64_t seed,
                             uint64_t stream, double out[3]);

#endif
