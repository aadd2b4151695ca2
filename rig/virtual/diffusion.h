/* The diffusion equation on a medium's voxels: its matrix, and solving it for several right-hand sides at once.
 *
 * Finite volumes give A phi = b for the fluence phi of each voxel, A symmetric and positive definite: conductances
 * between neighbours, and what each voxel loses by absorption and through the slab's outside. docs/transport.md derives
 * it and says how it is solved. */
#ifndef RIG_VIRTUAL_DIFFUSION_H
#define RIG_VIRTUAL_DIFFUSION_H

#include "nacre/error.h"
#include "rig/virtual/medium.h"

#include <stdbool.h>
#include <stddef.h>

typedef float float4 __attribute__((vector_size(16)));

/* One system for each colour channel, as the first three lanes of each float4; the fourth is idle. Arrays hold a frame of
 * zeros one voxel wide around nx x ny columns: [ny + 2][nx + 2][nz]. */
struct diffusion {
    int nx, ny, nz;
    float4 *left, *back, *above; /* conductance to x - 1, y - 1, z - 1 */
    float4 *loss;                /* conductance to darkness */
    float4 *
        source; /* b for a beam on the voxel's surface point; as a weight of phi what leaves the point */
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

/* Columns x0 <= x < x1, y0 <= y < y1 of the medium. A side that cuts the medium lets light out as if it went on: `open`
 * is the conductance there over that to the next column. */
struct diffusion_box {
    int x0, y0, x1, y1;
    float open;
};

/* What the SIMD lanes of a problem are, and how many. */
enum diffusion_lanes {
    DIFFUSION_CHANNELS = 4, /* one right-hand side for each channel, the fourth lane idle */
    DIFFUSION_BATCH = 8,    /* right-hand sides of one channel */
};

struct diffusion_level; /* diffusion_level.h: the problem's grid, or a coarser one */

/* One problem on one box, and its memory. Used by one thread at a time. */
struct diffusion_problem {
    enum diffusion_lanes lanes;
    struct diffusion_box box;
    size_t column, row; /* voxels from a column and from a row to the next */
    /* Right-hand sides and solutions, [y1 - y0 + 2][x1 - x0 + 2][nz][lanes], framed like the system. */
    float *source, *values;
    struct diffusion_level *levels;
    int level_count;
    void *memory;
    size_t capacity; /* bytes there */
    const struct diffusion *system;
    int channel;
    bool careful;   /* coarser grids that always converge, if slowly */
    int iterations; /* multigrid cycles that the last solution took */
};

/* Set the problem to a box of one channel's system (DIFFUSION_CHANNELS: of all), with sources of 0. A zero-initialised
 * problem may be set any number of times. */
int diffusion_problem_set(struct diffusion_problem *problem, const struct diffusion *diffusion,
                          struct diffusion_box box, enum diffusion_lanes lanes, int channel,
                          struct nacre_error *error);
void diffusion_problem_finish(struct diffusion_problem *problem);

/* Set the sources to 0 for other right-hand sides on the same box. */
void diffusion_problem_darken(struct diffusion_problem *problem);

static inline size_t diffusion_problem_cell(const struct diffusion_problem *problem, int x, int y,
                                            int z)
{
    return ((size_t)(y - problem->box.y0) + 1) * problem->row +
           ((size_t)(x - problem->box.x0) + 1) * problem->column + (size_t)z;
}

/* Find the values for the sources, to about 1e-6 of each lane's largest ones. Fails if that is not reached, which sound
 * coefficients exclude. */
int diffusion_solve(struct diffusion_problem *problem, struct nacre_error *error);

#endif
