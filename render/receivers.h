/* The vertices of a mesh as places where light leaves the material. */
#ifndef RENDER_RECEIVERS_H
#define RENDER_RECEIVERS_H

#include "nacre/error.h"
#include "render/appearance.h"
#include "render/mapping.h"
#include "render/mesh.h"

#include <stddef.h>
#include <stdint.h>

/* A vertex as one chart and one kernel column see it. Read by gather.cl too: four-float fields and four ints. */
struct receiver {
    float position[4]; /* x, y, z, - */
    float along_x[4],
        along_y[4]; /* direction in which x (y) grows, then the unwrapped x (y) in surface points */
    float normal[4];
    int32_t chart;
    int32_t column;         /* kernels are id(x_i) * clusters + column in layout pair; else 0 */
    int32_t flip_x, flip_y; /* -1 where the tile shows the material mirrored, else 1 */
};

struct receivers {
    size_t count;
    struct receiver *list;
    uint32_t *vertices; /* of each receiver */
    float *
        h; /* [count][factor_channels][terms]: H between surface points, times the chart's and cluster's weights */
};

int receivers_make(struct receivers *receivers, const struct mesh *mesh,
                   const struct mapping *mapping, const struct appearance *appearance,
                   struct nacre_error *error);
void receivers_finish(struct receivers *receivers);

/* The plane[height][width][3] of the material at a vertex, bilinear and blended over its charts. */
void receivers_lookup(const struct mesh *mesh, const struct mapping *mapping, size_t vertex,
                      const float *plane, double out[3]);

#endif
