/* Which surface points each grid of a plan lights, and how many of the plan's exposures it gets. */
#ifndef RIG_PLAN_GRIDS_H
#define RIG_PLAN_GRIDS_H

#include "nacre/error.h"

#include <stddef.h>
#include <stdint.h>

struct plan;

struct plan_grids {
    int width, height;   /* of the sample, surface points */
    int count;           /* grids */
    uint32_t *starts;    /* [count + 1], into points */
    uint32_t *points;    /* [width * height], y * width + x: a grid's lit points, row by row */
    uint32_t *grid_of;   /* [height][width]: the grid that lights a point */
    uint32_t *places;    /* [height][width]: where the point is in points */
    uint16_t *exposures; /* [count]: the first so many of the plan's, from 1 */
    uint16_t *spacings;  /* [height][width]: of each point */
};

/* Lay the grids of a plan over a sample. Every point is lit in just one grid, and two that are lit in the same are apart,
 * along x or along y, by the mean of their regions' spacings. Without regions grid `number` has the points
 * (number % spacing + i spacing, number / spacing + j spacing). With regions points are taken from the widest spacing to the
 * narrowest, and put where the lattice of their own spacing has them, or else into the first grid that has room: so narrow
 * footprints fill what room wide ones leave, in few grids. A grid is exposed as long as the neediest of its points asks. */
int plan_grids_new(const struct plan *plan, int width, int height, struct plan_grids **grids,
                   struct nacre_error *error);
void plan_grids_free(struct plan_grids *grids);

#endif
