/* All surfaces of a scene as rays see them, through Embree. */
#ifndef RENDER_WORLD_H
#define RENDER_WORLD_H

#include "nacre/error.h"
#include "render/mesh.h"

#include <stdbool.h>
#include <stddef.h>

struct world;

struct world_hit {
    size_t object, triangle;
    double b1, b2; /* weights of the triangle's second and third corner */
};

/* Meshes must stay as they are while the world lives. An object's number is its place in the array. */
int world_new(const struct mesh *const *meshes, size_t count, struct world **world,
              struct nacre_error *error);
void world_free(struct world *world); /* NULL is allowed */

/* The middle and radius of a sphere round the meshes. */
void world_sphere(const struct mesh *const *meshes, size_t count, struct vec3 *centre,
                  double *radius_mm);

/* The same of all that is in the world. */
void world_bounds(const struct world *world, struct vec3 *centre, double *radius_mm);

/* Where on its mesh a ray met it. */
struct vec3 world_place(const struct mesh *mesh, const struct world_hit *hit);

/* Whether something stands between two points. The first is on a surface with unit normal `normal` on the side of the
 * second, and is lifted off it by what single precision needs. Thread-safe. */
bool world_blocked(const struct world *world, struct vec3 surface, struct vec3 normal,
                   struct vec3 other);

/* The first surface that a ray from a surface with unit normal `normal` meets, on the side of the direction; lifted off
 * like world_blocked's. Thread-safe. */
bool world_look(const struct world *world, struct vec3 surface, struct vec3 normal,
                struct vec3 direction, struct world_hit *hit);

/* The first surface that a ray meets. Thread-safe. */
bool world_trace(const struct world *world, struct vec3 origin, struct vec3 direction,
                 struct world_hit *hit);

#endif
