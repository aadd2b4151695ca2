/* A lit surface as a source of light for others. */
#ifndef RENDER_REFLECTOR_H
#define RENDER_REFLECTOR_H

#include "render/mapping.h"
#include "render/mesh.h"
#include "render/world.h"

#include <stdbool.h>

struct reflector {
    const struct mesh *mesh;
    const float (*radiosity)[3]; /* per vertex, pi times the radiance that leaves; NULL: dark */
    double color[3];             /* diffuse reflectance of a plain object */
    /* Of a translucent one the reflectance of each surface point, [height][width][3], and how they lie; else NULL. */
    const float *albedo;
    const struct mapping *mapping;
};

/* The radiosity where a ray met the surface; false from its inner side, which is dark. */
bool reflector_shines(const struct reflector *reflector, const struct world_hit *hit,
                      struct vec3 direction, double radiosity[3]);

/* The reflectance there. */
void reflector_reflectance(const struct reflector *reflector, const struct world_hit *hit,
                           double reflectance[3]);

#endif
