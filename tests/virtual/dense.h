/* The light transport once more, independently: a dense matrix in double precision. */
#ifndef TESTS_VIRTUAL_DENSE_H
#define TESTS_VIRTUAL_DENSE_H

#include "rig/virtual/medium.h"

#include <stddef.h>

/* What leaves the medium as flux and what it absorbs, for a fluence of each voxel phi[ny][nx][nz]. */
struct dense_losses {
    double absorbed, top, bottom, sides;
};
struct dense_losses dense_losses(const struct medium *medium, int channel, const double *phi);

/* Power first scattered in each voxel of slab column (x, y), W, for 1 W/mm^2 on its top, outside: power[nz]. */
void dense_beam(const struct medium *medium, int channel, int x, int y, double *power);

/* Responses R[points][points] of one channel, entering point first; heap memory. */
double *dense_responses(const struct medium *medium, int channel);

/* The boundary's parameter A by Simpson's rule with 200 000 steps. */
double dense_boundary_a(double index);

#endif
