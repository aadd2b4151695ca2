/* Light samples in a tree over the texture: what lies on the same surface point of the material, or near it, summed up.
 *
 * A node stands for samples of one chart, facing alike, in one cube of 16 surface points in space and one square of the
 * texture of 2^level surface points. Up to level 0 (a surface point, where F is constant) it is summed up to one light
 * sample; above, to moments: for each row and lane of the material's basis sum flux F U, at the samples' mean place. */
#ifndef RENDER_CELLS_H
#define RENDER_CELLS_H

#include "nacre/error.h"
#include "render/appearance.h"
#include "render/bundles.h"
#include "render/samples.h"

#include <stddef.h>
#include <stdint.h>

enum { CELLS_LEVEL_TOP = 4, CELLS_LEVEL_BOTTOM = -3 };

struct cell_node {
    float position[3]; /* of the light: the mean by brightness */
    float radius_mm;   /* no sample is farther from there */
    float normal[3];
    float apart;   /* no sample's normal is farther from it, as the length of the difference */
    float flat_mm; /* no sample is farther from the plane through there */
    float x, y;    /* in the texture, and no sample is farther from there */
    float half_x, half_y;
    int32_t chart;
    int32_t level;
    uint32_t sample_begin, sample_end;
    uint32_t child_begin, child_end; /* in cells.nodes; none: the samples are next */
    uint32_t source;                 /* in cells.points, or above level 0 in cells.moments */
};

struct cells {
    size_t sample_count, point_count, node_count, moment_count, root_count;
    size_t moment_size; /* rows times lanes */
    struct light_sample
        *points;             /* the samples that are lit in the tree's order, then sums of them */
    struct cell_node *nodes; /* the roots first */
    float *moments;          /* [moment_count][moment_size] */
    /* For each node what bounds the error of taking it as a whole, [node_count][3 * parts + 1]. By part of the basis:
     * flux F U and the largest H times the samples' mean offset, times the squares of their offsets (surface points),
     * and alone; at last flux F and H times what the basis leaves. */
    float *bounds;
    double brightness; /* about the mean of pi L over the surface, times its area (mm^2) */
};

/* Sort the samples that carry flux and sum them up. */
int cells_make(struct cells *cells, const struct light_samples *samples,
               const struct appearance *appearance, double point_mm, struct nacre_error *error);
void cells_finish(struct cells *cells);

#endif
