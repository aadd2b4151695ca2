/* A sample on voxels: what the light transport solver sees of it. */
#ifndef RIG_VIRTUAL_MEDIUM_H
#define RIG_VIRTUAL_MEDIUM_H

#include "nacre/error.h"
#include "rig/virtual/sample.h"

#include <stddef.h>

enum { MEDIUM_CHANNELS = 3 };

/* Voxels are squares of cell_mm seen from above, and layers between edges_mm. The sample's point (0, 0) begins
 * `margin` points, margin * subdivide voxels, from the slab's corner. */
struct medium {
    int width, height, margin; /* surface points */
    int subdivide;             /* voxels along a surface point */
    int nx, ny, nz;            /* voxels */
    double cell_mm;
    double *edges_mm; /* [nz + 1], from 0 to the thickness */
    /* [channel][ny][nx][nz], per mm; scattering is reduced, (1 - g) times the material's. */
    float *scattering, *absorption;
    float *index; /* [ny][nx][nz], of refraction */
};

/* Lay the sample on voxels. A voxel that several materials share gets their mean properties. */
int medium_new(const struct sample *sample, struct medium **medium, struct nacre_error *error);
/* How many voxels medium_new would make. */
double medium_expected_cells(const struct sample *sample);
void medium_free(struct medium *medium); /* NULL is allowed */

static inline size_t medium_cells(const struct medium *medium)
{
    return (size_t)medium->nx * (size_t)medium->ny * (size_t)medium->nz;
}

static inline size_t medium_cell(const struct medium *medium, int x, int y, int z)
{
    return ((size_t)y * (size_t)medium->nx + (size_t)x) * (size_t)medium->nz + (size_t)z;
}

#endif
