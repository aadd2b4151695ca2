/* Triangle meshes in memory: checked, placed in the scene, with normals and texture coordinates in mm. */
#ifndef RENDER_MESH_H
#define RENDER_MESH_H

#include "nacre/error.h"
#include "render/vector.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct mesh {
    size_t vertex_count, triangle_count;
    float (*positions)[3];    /* mm */
    float (*normals)[3];      /* unit, on the outer side */
    float (*uv)[2];           /* mm along the surface, or NULL; a seam has its vertices twice */
    uint32_t (*triangles)[3]; /* counter-clockwise seen from outside */
    size_t degenerate_count;  /* triangles that mesh_check removed */
    /* How a loaded mesh came to its size: position = (the file's - middle) * scale, uv = the file's * uv_mm. 0 and 1
     * for built-in shapes. */
    struct vec3 middle;
    double scale, uv_mm;
};

enum { MESH_TRIANGLES_MAXIMUM = 20000000 };

/* Arrays of the given sizes, uninitialised. */
int mesh_allocate(struct mesh *mesh, size_t vertices, size_t triangles, bool with_uv,
                  struct nacre_error *error);
void mesh_finish(struct mesh *mesh);

/* Twice a triangle's area along its outer normal. */
static inline struct vec3 mesh_triangle_cross(const struct mesh *mesh, size_t triangle)
{
    const uint32_t *corners = mesh->triangles[triangle];
    struct vec3 a = vec3_from(mesh->positions[corners[0]]);
    return vec3_cross(vec3_subtract(vec3_from(mesh->positions[corners[1]]), a),
                      vec3_subtract(vec3_from(mesh->positions[corners[2]]), a));
}

/* Load any file that Assimp reads: all its meshes as one, in the file's own unit, texture coordinates as they stand. */
int mesh_load(const char *path, struct mesh *mesh, struct nacre_error *error);

/* Refuse coordinates that are not finite and indices out of range, drop triangles of no area, and mend normals that
 * are missing. `name` is the mesh's in messages. */
int mesh_check(struct mesh *mesh, const char *name, struct nacre_error *error);

/* Edges that have one triangle, and those that have more than two; vertices at the same place count as one. */
int mesh_count_edges(const struct mesh *mesh, size_t *open, size_t *crowded,
                     struct nacre_error *error);

/* Least and greatest corner. */
void mesh_bounds(const struct mesh *mesh, struct vec3 *low, struct vec3 *high);
double mesh_area_mm2(const struct mesh *mesh);

/* Scale so that the largest extent is size_mm. Texture coordinates of a loaded mesh, which have no unit, are scaled so
 * that the area they cover is that of the surface. */
int mesh_scale(struct mesh *mesh, double size_mm, const char *name, struct nacre_error *error);

/* How to turn the mesh by degrees about x, y and z and set it down so that its bottom's centre is at `position`. */
struct motion mesh_placement(const struct mesh *mesh, const double degrees[3],
                             struct vec3 position);
void mesh_move(struct mesh *mesh, const struct motion *motion);

/* How long the edge between two vertices, the lesser number first, may be, in mm. */
typedef double mesh_edge_rule(const void *context, const struct mesh *mesh, uint32_t a, uint32_t b);

/* Split edges in half until none is longer than the rule allows, or until a further round would make more than `limit`
 * triangles (then *limited is set). Neighbours split a common edge alike, so no cracks open. */
int mesh_subdivide(struct mesh *mesh, mesh_edge_rule *rule, const void *context, size_t limit,
                   bool *limited, struct nacre_error *error);

/* Split each edge that is too long into two, once. *done: there was none, or too many triangles would come of it
 * (*limited). New vertices come after those that there were. */
int mesh_subdivide_once(struct mesh *mesh, mesh_edge_rule *rule, const void *context, size_t limit,
                        bool *limited, bool *done, struct nacre_error *error);

/* A rule that allows the same length everywhere: context is a const double *. */
mesh_edge_rule mesh_edge_even;

/* Built-in shapes around the origin, closed but for the quad, texture coordinates in mm. Quads face +z; edge_mm is the
 * length that the edges of curved shapes come near to. */
int mesh_make_quad(struct mesh *mesh, double width_mm, double depth_mm, struct nacre_error *error);
int mesh_make_box(struct mesh *mesh, const double size_mm[3], struct nacre_error *error);
int mesh_make_sphere(struct mesh *mesh, double radius_mm, double edge_mm,
                     struct nacre_error *error);

/* A torus knot that winds twice round the axis and three times through the hole; its largest extent is size_mm and
 * `thickness` the tube's radius over the radius of the torus' own tube (0.1 to 0.8). */
int mesh_make_knot(struct mesh *mesh, double size_mm, double thickness, double edge_mm,
                   struct nacre_error *error);

#endif
