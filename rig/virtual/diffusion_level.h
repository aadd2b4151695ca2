/* The grids of a multigrid solution: a problem's own and coarser ones, which join two by two columns. */
#ifndef RIG_VIRTUAL_DIFFUSION_LEVEL_H
#define RIG_VIRTUAL_DIFFUSION_LEVEL_H

#include "rig/virtual/diffusion.h"

enum { DIFFUSION_CHANGE_ROWS = 4 };

/* Arrays are framed by zeros, [ny + 2][nx + 2][nz], with 1 coefficient a voxel that all lanes share or 4, and `lanes`
 * values. */
struct diffusion_level {
    int nx, ny, nz;
    size_t coefficients, lanes;
    size_t column, row; /* voxels from a column and from a row to the next */
    float *left, *back, *above, *loss;
    /* A column's own equations, T x = b, by y[z] = b[z] + carry[z] y[z - 1], x[z] = pivot[z] y[z] + carry[z + 1] x[z + 1]. */
    float *pivot, *carry;
    float *source, *values;
    /* [DIFFUSION_CHANGE_ROWS][nx + 2][nz]: by what a sweep changed every other column of the last rows. */
    float *change;
};

/* How many levels a box of nx x ny columns has. */
int diffusion_level_count(int nx, int ny);

/* Bytes of a box's levels, the descriptions included. */
size_t diffusion_levels_size(int nx, int ny, int nz, enum diffusion_lanes lanes);

/* Lay out the levels of problem->box in problem->memory, which has that many bytes and is aligned to 64; all of it is
 * set to 0. */
void diffusion_levels_lay(struct diffusion_problem *problem, int nz);

/* Fill in the coefficients of all levels, which may have others already, from problem->system. */
void diffusion_levels_fill(struct diffusion_problem *problem);

#endif
