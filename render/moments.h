/* Moments of the light of squares of surface points, and what bounds the error of using them. */
#ifndef RENDER_MOMENTS_H
#define RENDER_MOMENTS_H

#include "render/cells.h"

/* What has been added up for the nodes from the root down to the one being filled. */
struct moments {
    const struct appearance *appearance;
    float to_points;             /* surface points in a mm */
    size_t size, lanes, parts;   /* of a moment, of its rows; basis kernels */
    size_t bound_size;           /* numbers that bound a node's error */
    int *lane_color, *lane_part; /* -1: not used */
    float *kernel_sums;          /* [kernels][3] */
    float *frames;               /* CELLS_LEVEL_TOP of them */
    float *list;                 /* finished moments */
    size_t count, capacity;
    double brightness[3];
};

int moments_begin(struct moments *moments, const struct appearance *appearance, double point_mm);
void moments_end(struct moments *moments);

/* Begin a node above level 0; depth counts from the root, which is 0. */
void moments_open(struct moments *moments, int depth);

/* The node is summed up: write its moment and bounds, and add it to the node above, if any. Returns its number, or
 * SIZE_MAX where memory ran out. */
size_t moments_close(struct moments *moments, const struct cell_node *node, int depth,
                     const struct cell_node *parent, float *bounds);

/* A node of level 0 or less, summed up to `whole`: its bounds; where `parent` is above level 0, it is added to it. */
void moments_point(struct moments *moments, const struct light_sample *samples,
                   const struct cell_node *node, const struct light_sample *whole, int depth,
                   const struct cell_node *parent, float *bounds);

/* Count a surface point's light. */
void moments_count(struct moments *moments, const struct light_sample *whole);

#endif
