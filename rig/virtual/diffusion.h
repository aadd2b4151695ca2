/* The diffusion equation on a medium's voxels: its matrix, and solving it for several right-hand sides at once.
 *
 * Finite volumes give A phi = b for the fluence phi of each voxel, A symmetric and positive definite. Kept is the matrix
 * scaled from both sides so that its modified incomplete Cholesky factor has a unit diagonal: S A S = (I - L) + (I - L^T)
 * + R with L the strict lower triangle and R diagonal; the preconditioner is (I - L)(I - L^T) (Eisenstat 1981). The
 * light's way in and out is scaled along: `source` holds S b for a beam on the voxel's surface point, and what leaves
 * the point along the normal is the same weights times the solution. docs/transport.md derives all of it. */
#ifndef RIG_VIRTUAL_DIFFUSION_H
#define RIG_VIRTUAL_DIFFUSION_H

#include "nacre/error.h"
#include "rig/virtual/medium.h"

#include <stddef.h>

typedef float float4 __attribute__((vector_size(16)));

/* One system for each colour channel, as the first three lanes of each float4; the fourth is idle. Arrays hold a frame of
 * zeros one voxel wide around nx x ny columns: [ny + 2][nx + 2][nz]. */
struct diffusion {
    int nx, ny, nz;
    float4 *to_left, *to_back, *to_above; /* L: to x - 1, y - 1, z - 1 */
    float4 *rest;                         /* R */
    float4 *source;
    float4 *scale; /* S */
    void *memory;
};

int diffusion_new(const struct medium *medium, struct diffusion **diffusion,
                  struct nacre_error *error);
void diffusion_free(struct diffusion *diffusion); /* NULL is allowed */

static inline size_t diffusion_cell(const struct diffusion *diffusion, int x, int y, int z)
{
    return (((size_t)y + 1) * ((size_t)diffusion->nx + 2) + (size_t)x + 1) * (size_t)diffusion->nz +
           (size_t)z;
}

/* Columns x0 <= x < x1, y0 <= y < y1 of the medium; outside them a local problem takes phi as 0. */
struct diffusion_box {
    int x0, y0, x1, y1;
};

/* What the lanes of a problem are. */
enum diffusion_lanes {
    DIFFUSION_CHANNELS, /* 4: one right-hand side for each channel, the fourth lane idle */
    DIFFUSION_BATCH,    /* 16: right-hand sides of one channel */
};

/* One problem on one box, and its memory. Used by one thread at a time. */
struct diffusion_problem {
    enum diffusion_lanes lanes;
    struct diffusion_box box;
    size_t groups;      /* float4s for each voxel: lanes / 4 */
    size_t column, row; /* voxels from a column and from a row to the next */
    /* [y1 - y0 + 2][x1 - x0 + 2][nz][groups], framed like the system; scaled (S b in, phi / S out). */
    float4 *values;
    float4 *direction, *left, *right, *residual; /* scratch of the solver */
    size_t capacity;                             /* float4s in each of these */
    int iterations;                              /* that the last solution took */
};

/* Set the problem to a box, all values 0. A zero-initialised problem may be set any number of times. */
int diffusion_problem_set(struct diffusion_problem *problem, const struct diffusion *diffusion,
                          struct diffusion_box box, enum diffusion_lanes lanes,
                          struct nacre_error *error);
void diffusion_problem_finish(struct diffusion_problem *problem);

static inline size_t diffusion_problem_cell(const struct diffusion_problem *problem, int x, int y,
                                            int z)
{
    return ((size_t)(y - problem->box.y0) + 1) * problem->row +
           ((size_t)(x - problem->box.x0) + 1) * problem->column + (size_t)z;
}

/* Replace values, the right-hand sides, by the solutions: preconditioned residual at most 1e-6 of the right-hand side's
 * in each lane, which bounds the error in the energy norm. `channel` counts for DIFFUSION_BATCH only. Fails if that is
 * not reached, which sound coefficients exclude. */
int diffusion_solve(const struct diffusion *diffusion, struct diffusion_problem *problem,
                    int channel, struct nacre_error *error);

#endif
