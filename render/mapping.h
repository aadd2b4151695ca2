/* Where on the material a point of a surface lies, in surface points, and which way the material runs there. */
#ifndef RENDER_MAPPING_H
#define RENDER_MAPPING_H

#include "render/mesh.h"
#include "render/scene.h"
#include "render/vector.h"

#include <stdint.h>

enum { MAPPING_CHARTS_MAXIMUM = 3 };

struct mapping {
    int kind; /* enum scene_mapping */
    int axis;
    double point_mm;
    double offset[2]; /* surface points */
    bool mirror;
    int width, height;    /* of the material, surface points */
    struct motion motion; /* from the object's frame into the scene */
    struct vec3 centre;   /* object's frame: cylinder and sphere */
    double radius_mm;     /* mean, cylinder and sphere */
    float (*along_u)[3],
        (*along_v)[3]; /* MAPPING_UV: per vertex, directions in which u and v grow */
};

/* One chart's view of a point. */
struct mapped {
    double x, y; /* unwrapped; x to the right and y down as the material's rows run */
    struct vec3 along_x,
        along_y;   /* directions in which x and y grow; of equal scale, not of unit length */
    int chart;     /* points of different charts have unrelated x and y */
    double weight; /* the charts' weights sum to 1 */
};

/* Prepare the mapping of a mesh that stands in its object's frame (before mesh_move). */
int mapping_make(struct mapping *mapping, const struct scene_material *settings, int width,
                 int height, double pitch_mm, const struct mesh *mesh, const struct motion *motion,
                 struct nacre_error *error);

/* Turn the prepared directions into the scene, once, after the mesh was moved and subdivided. */
int mapping_follow(struct mapping *mapping, const struct mesh *mesh, struct nacre_error *error);
void mapping_finish(struct mapping *mapping);

/* Map a point of the scene with its unit normal. `uv` (mm) and the directions matter to MAPPING_UV alone. Returns the
 * number of charts, the weightiest first; more than one only near the edges of a box mapping. */
int mapping_charts(const struct mapping *mapping, struct vec3 position, struct vec3 normal,
                   const double uv[2], struct vec3 along_u, struct vec3 along_v,
                   struct mapped charts[MAPPING_CHARTS_MAXIMUM]);

/* The charts of a vertex, and the weightiest chart (without its directions) of a point inside a triangle. */
int mapping_vertex(const struct mapping *mapping, const struct mesh *mesh, size_t vertex,
                   struct mapped charts[MAPPING_CHARTS_MAXIMUM]);
struct mapped mapping_inside(const struct mapping *mapping, const struct mesh *mesh,
                             size_t triangle, double b1, double b2);

/* The surface point of the sample at unwrapped index i, 0 <= result < size. Mirroring has the period 2 size. */
static inline int mapping_wrap(int64_t i, int size, bool mirror)
{
    int64_t period = mirror ? 2 * (int64_t)size : size;
    int64_t inside = i % period;
    inside += inside < 0 ? period : 0;
    return (int)(inside < size ? inside : 2 * (int64_t)size - 1 - inside);
}

/* Whether index i lies in a tile that shows the material mirrored. */
static inline bool mapping_mirrored(int64_t i, int size, bool mirror)
{
    int64_t tile = i >= 0 ? i / size : -((-i + size - 1) / size);
    return mirror && tile % 2 != 0;
}

/* How much longer (> 1) or shorter the material's surface points are drawn than they are, over the surface's area:
 * the 5th, 50th and 95th percentile of both principal stretches. *edge_on: the share of the surface that the mapping
 * sees from the side, so that it draws no more than streaks; it is in no percentile. */
int mapping_stretch(const struct mapping *mapping, const struct mesh *mesh, double percentiles[3],
                    double *edge_on, struct nacre_error *error);

#endif
