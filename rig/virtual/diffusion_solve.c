/* Solving the diffusion equation by multigrid, with several right-hand sides in SIMD lanes. */
#include "rig/virtual/diffusion.h"
#include "rig/virtual/diffusion_level.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_CYCLES = 200 };

/* The cycle that begins with a change of this part of the first one is the last. It leaves a tenth of that or so. */
static const double TOLERANCE = 1e-5;

/* The correction from the second grid is taken a little larger than it is: cells of one value have too little freedom,
 * and so too small a correction. */
#define FINEST_WEIGHT 1.2F

typedef float float8 __attribute__((vector_size(32)));

/* Functions that return these are inlined: how they would be called does not matter. */
#pragma GCC diagnostic ignored "-Wpsabi"

#define ALWAYS_INLINE static inline __attribute__((always_inline))

/* The coarse column beside that of fine column i, on the side to which i lies within it; the same one at the border. */
static int neighbour(int i, int count)
{
    int other = i / 2 + (i % 2 ? 1 : -1);
    return other < 0 ? 0 : other >= count ? count - 1 : other;
}

#define NAME(x) x##_channels
#define TARGET
#define VECTOR      float4
#define COEFFICIENT float4
#include "rig/virtual/diffusion_lanes.h"

#define NAME(x) x##_batch
#define TARGET
#define VECTOR      float8
#define COEFFICIENT float
#include "rig/virtual/diffusion_lanes.h"

#ifdef __x86_64__
#define NAME(x)     x##_channels_avx2
#define TARGET      __attribute__((target("avx2,fma")))
#define VECTOR      float4
#define COEFFICIENT float4
#include "rig/virtual/diffusion_lanes.h"

#define NAME(x)     x##_batch_avx2
#define TARGET      __attribute__((target("avx2,fma")))
#define VECTOR      float8
#define COEFFICIENT float
#include "rig/virtual/diffusion_lanes.h"
#endif

int diffusion_problem_set(struct diffusion_problem *problem, const struct diffusion *diffusion,
                          struct diffusion_box box, enum diffusion_lanes lanes, int channel,
                          struct nacre_error *error)
{
    int nx = box.x1 - box.x0;
    int ny = box.y1 - box.y0;
    int nz = diffusion->nz;
    size_t size = diffusion_levels_size(nx, ny, nz, lanes);
    bool same = problem->levels && problem->levels->nx == nx && problem->levels->ny == ny &&
                problem->levels->nz == nz && problem->lanes == lanes;
    if (size > problem->capacity) {
        diffusion_problem_finish(problem);
        problem->memory = aligned_alloc(64, size);
        if (!problem->memory) {
            return nacre_fail_memory(error, "the light transport's vectors");
        }
        problem->capacity = size;
    }
    problem->lanes = lanes;
    problem->box = box;
    problem->column = (size_t)nz;
    problem->row = ((size_t)nx + 2) * problem->column;
    if (same) {
        diffusion_problem_darken(problem);
    } else {
        diffusion_levels_lay(problem, nz);
    }
    diffusion_levels_fill(problem, diffusion, channel);
    problem->source = problem->levels->source;
    problem->values = problem->levels->values;
    return NACRE_OK;
}

void diffusion_problem_finish(struct diffusion_problem *problem)
{
    free(problem->memory);
    *problem = (struct diffusion_problem){0};
}

void diffusion_problem_darken(struct diffusion_problem *problem)
{
    const struct diffusion_level *level = problem->levels;
    memset(level->source, 0, ((size_t)level->ny + 2) * level->row * level->lanes * sizeof(float));
}

typedef void cycle_function(const struct diffusion_problem *problem, bool fresh, double *squares);

static cycle_function *choose_cycle(enum diffusion_lanes lanes)
{
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        return lanes == DIFFUSION_BATCH ? cycle_batch_avx2 : cycle_channels_avx2;
    }
#endif
    return lanes == DIFFUSION_BATCH ? cycle_batch : cycle_channels;
}

int diffusion_solve(struct diffusion_problem *problem, struct nacre_error *error)
{
    cycle_function *cycle = choose_cycle(problem->lanes);
    double first[DIFFUSION_BATCH];
    double squares[DIFFUSION_BATCH];
    cycle(problem, true, first);
    for (problem->iterations = 2; problem->iterations <= MAX_CYCLES; problem->iterations++) {
        bool waiting = false;
        cycle(problem, false, squares);
        for (int lane = 0; lane < (int)problem->lanes; lane++) {
            waiting = waiting || squares[lane] > TOLERANCE * TOLERANCE * first[lane];
        }
        if (!waiting) {
            return NACRE_OK;
        }
    }
    return nacre_fail(error, "light transport: no solution after %d multigrid cycles", MAX_CYCLES);
}
