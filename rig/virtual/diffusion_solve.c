/* Solving the diffusion equation by multigrid, with several right-hand sides in SIMD lanes. */
#include "rig/virtual/diffusion.h"
#include "rig/virtual/diffusion_level.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_CYCLES = 2000 };

/* The cycle that begins with a change of this part of the first one is the last, where cycles leave a third of the error
 * or less; where they leave more, what all later ones would change must be as small. */
static const double TOLERANCE = 1e-5;
static const double SLOWEST =
    0.9; /* part left by a cycle that this looks ahead for; single precision ends it */

/* How a coarser level's correction is taken: bilinearly between its columns' centres. That from the second grid is taken
 * a little larger than it is: cells of one value have too little freedom, and so too small a correction. */
static const float BILINEAR[3] = {0.5625F, 0.1875F, 0.0625F};
static const float FINEST[3] = {1.2F * 0.5625F, 1.2F * 0.1875F, 1.2F * 0.0625F};
static const float CAREFUL[3] = {1, 0, 0};

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
    problem->system = diffusion;
    problem->channel = channel;
    problem->careful = false;
    if (same) {
        diffusion_problem_darken(problem);
    } else {
        diffusion_levels_lay(problem, nz);
    }
    diffusion_levels_fill(problem);
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

/* Whether a lane whose change had these squares, this time and the last, needs more cycles. */
static bool is_waiting(double squares, double before, double first)
{
    double rate = before > 0 ? fmin(sqrt(squares / before), SLOWEST) : 0;
    double ahead = fmax(1, 2 * rate / (1 - rate));
    return !(ahead * ahead * squares <= TOLERANCE * TOLERANCE * first);
}

/* Cycle until no lane waits; false if that is not reached, or if lanes have got brighter in place of settling. */
static bool settle_all(struct diffusion_problem *problem, int most)
{
    cycle_function *cycle = choose_cycle(problem->lanes);
    double first[DIFFUSION_BATCH];
    double before[DIFFUSION_BATCH];
    double squares[DIFFUSION_BATCH];
    cycle(problem, true, first);
    memcpy(before, first, sizeof before);
    for (problem->iterations = 2; problem->iterations <= most; problem->iterations++) {
        bool waiting = false;
        bool sound = true;
        cycle(problem, false, squares);
        for (int lane = 0; lane < (int)problem->lanes; lane++) {
            waiting = waiting || is_waiting(squares[lane], before[lane], first[lane]);
            sound = sound && squares[lane] <= 10 * first[lane];
        }
        memcpy(before, squares, sizeof before);
        if (!waiting || !sound) {
            return sound;
        }
    }
    return false;
}

int diffusion_solve(struct diffusion_problem *problem, struct nacre_error *error)
{
    enum { QUICK_CYCLES = 150 };
    if (settle_all(problem, problem->careful ? MAX_CYCLES : QUICK_CYCLES)) {
        return NACRE_OK;
    }
    if (!problem->careful) {
        problem->careful = true;
        diffusion_levels_fill(problem);
        if (settle_all(problem, MAX_CYCLES)) {
            return NACRE_OK;
        }
    }
    return nacre_fail(error, "light transport: no solution after %d multigrid cycles", MAX_CYCLES);
}
