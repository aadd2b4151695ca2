/* Solving the diffusion equation by conjugate gradients, with several right-hand sides in SIMD lanes.
 *
 * In the variables of the incomplete factor the operator is w + (I - L)^-1 (p + R w) with w = (I - L^T)^-1 p
 * (Eisenstat 1981), so that an iteration is one sweep back, one forward and one over plain vectors. Voxels wait for
 * their neighbours within a sweep; the lanes do not. */
#include "rig/virtual/diffusion.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_ITERATIONS = 2000, MAX_GROUPS = 4, MAX_LANES = 4 * MAX_GROUPS };

static const double TOLERANCE = 1e-6;

#define ALWAYS_INLINE static inline __attribute__((always_inline))
#define UNROLL        _Pragma("GCC unroll 4")

int diffusion_problem_set(struct diffusion_problem *problem, const struct diffusion *diffusion,
                          struct diffusion_box box, enum diffusion_lanes lanes,
                          struct nacre_error *error)
{
    enum { ARRAYS = 5 };
    size_t groups = lanes == DIFFUSION_BATCH ? MAX_GROUPS : 1;
    size_t column = (size_t)diffusion->nz;
    size_t row = (size_t)(box.x1 - box.x0 + 2) * column;
    size_t values = (size_t)(box.y1 - box.y0 + 2) * row * groups;
    if (values > problem->capacity) {
        diffusion_problem_finish(problem);
        problem->values = aligned_alloc(64, ARRAYS * 64 * ((values * sizeof(float4) + 63) / 64));
        if (!problem->values) {
            return nacre_fail_memory(error, "the light transport's vectors");
        }
        problem->capacity = values;
    }
    problem->lanes = lanes;
    problem->box = box;
    problem->groups = groups;
    problem->column = column;
    problem->row = row;
    problem->direction = problem->values + values;
    problem->left = problem->values + 2 * values;
    problem->right = problem->values + 3 * values;
    problem->residual = problem->values + 4 * values;
    memset(problem->values, 0, ARRAYS * values * sizeof(float4));
    return NACRE_OK;
}

void diffusion_problem_finish(struct diffusion_problem *problem)
{
    free(problem->values);
    *problem = (struct diffusion_problem){0};
}

/* A column of voxels in the system and in the problem. */
struct column {
    const struct diffusion *diffusion;
    const struct diffusion_problem *problem;
    size_t first, row_first; /* its top voxel in the system, and the distance to the row behind */
    size_t place;            /* of its top voxel in the problem */
    int channel;             /* that all lanes share, or -1 */
};

/* A factor of voxel `cell` for all lanes of a group. */
ALWAYS_INLINE float4 factor_of(const float4 *factors, size_t cell, int channel)
{
    if (channel < 0) {
        return factors[cell];
    }
    float shared = ((const float *)factors)[4 * cell + (size_t)channel];
    return (float4){shared, shared, shared, shared};
}

/* target = (I - L^T)^-1 source along one column. */
ALWAYS_INLINE void back_column(const struct column *at, const float4 *source, float4 *target,
                               size_t groups, int channel)
{
    const struct diffusion *d = at->diffusion;
    const struct diffusion_problem *problem = at->problem;
    size_t right = problem->column * groups;
    size_t behind = problem->row * groups;
    float4 below[MAX_GROUPS] = {{0}};
    for (size_t z = problem->column; z-- > 0;) {
        size_t cell = at->first + z;
        float4 x = factor_of(d->to_left, cell + problem->column, channel);
        float4 y = factor_of(d->to_back, cell + at->row_first, channel);
        float4 down = factor_of(d->to_above, cell + 1, channel);
        size_t i = (at->place + z) * groups;
        UNROLL
        for (size_t g = 0; g < groups; g++, i++) {
            below[g] = source[i] + x * target[i + right] + y * target[i + behind] + down * below[g];
            target[i] = below[g];
        }
    }
}

/* target = (I - L)^-1 source along one column, where source is p + R w, or values alone where w is NULL. Adds the
 * products p (w + target) to dots. */
ALWAYS_INLINE void forward_column(const struct column *at, const float4 *p, const float4 *w,
                                  float4 *target, size_t groups, int channel, float4 *dots)
{
    const struct diffusion *d = at->diffusion;
    const struct diffusion_problem *problem = at->problem;
    size_t left = problem->column * groups;
    size_t before = problem->row * groups;
    float4 above[MAX_GROUPS] = {{0}};
    for (size_t z = 0; z < problem->column; z++) {
        size_t cell = at->first + z;
        float4 x = factor_of(d->to_left, cell, channel);
        float4 y = factor_of(d->to_back, cell, channel);
        float4 up = factor_of(d->to_above, cell, channel);
        float4 rest = factor_of(d->rest, cell, channel);
        size_t i = (at->place + z) * groups;
        UNROLL
        for (size_t g = 0; g < groups; g++, i++) {
            float4 source = p[i];
            if (w) {
                source += rest * w[i];
            }
            above[g] = source + x * target[i - left] + y * target[i - before] + up * above[g];
            target[i] = above[g];
            if (w) {
                dots[g] += p[i] * (w[i] + above[g]);
            }
        }
    }
}

ALWAYS_INLINE struct column column_at(const struct diffusion *diffusion,
                                      const struct diffusion_problem *problem, int x, int y,
                                      int channel)
{
    return (struct column){.diffusion = diffusion,
                           .problem = problem,
                           .first = diffusion_cell(diffusion, x, y, 0),
                           .row_first = ((size_t)diffusion->nx + 2) * problem->column,
                           .place = diffusion_problem_cell(problem, x, y, 0),
                           .channel = channel};
}

/* Float sums of one column go into double ones, so that long sums stay exact. */
ALWAYS_INLINE void collect(double *sums, const float4 *dots, size_t groups)
{
    UNROLL
    for (size_t g = 0; g < groups; g++) {
        for (size_t lane = 0; lane < 4; lane++) {
            sums[4 * g + lane] += (double)dots[g][lane];
        }
    }
}

/* direction = residual + beta direction, then left = (I - L^T)^-1 direction, in one sweep. */
ALWAYS_INLINE void sweep_back(const struct diffusion *diffusion, struct diffusion_problem *problem,
                              const float4 *beta, size_t groups, int channel)
{
    const struct diffusion_box *box = &problem->box;
    for (int y = box->y1; y-- > box->y0;) {
        for (int x = box->x1; x-- > box->x0;) {
            struct column at = column_at(diffusion, problem, x, y, channel);
            for (size_t z = 0, i = at.place * groups; z < problem->column; z++) {
                UNROLL
                for (size_t g = 0; g < groups; g++, i++) {
                    problem->direction[i] = problem->residual[i] + beta[g] * problem->direction[i];
                }
            }
            back_column(&at, problem->direction, problem->left, groups, channel);
        }
    }
}

/* right = (I - L)^-1 (direction + R left); writes direction . operator direction. */
ALWAYS_INLINE void sweep_forward(const struct diffusion *diffusion,
                                 struct diffusion_problem *problem, size_t groups, int channel,
                                 double *curvature)
{
    const struct diffusion_box *box = &problem->box;
    memset(curvature, 0, MAX_LANES * sizeof *curvature);
    for (int y = box->y0; y < box->y1; y++) {
        for (int x = box->x0; x < box->x1; x++) {
            struct column at = column_at(diffusion, problem, x, y, channel);
            float4 dots[MAX_GROUPS] = {{0}};
            forward_column(&at, problem->direction, problem->left, problem->right, groups, channel,
                           dots);
            collect(curvature, dots, groups);
        }
    }
}

/* values += alpha direction, residual -= alpha (left + right); writes residual . residual. */
ALWAYS_INLINE void step(struct diffusion_problem *problem, const float4 *alpha, size_t groups,
                        double *squares)
{
    const struct diffusion_box *box = &problem->box;
    memset(squares, 0, MAX_LANES * sizeof *squares);
    for (int y = box->y0; y < box->y1; y++) {
        for (int x = box->x0; x < box->x1; x++) {
            float4 dots[MAX_GROUPS] = {{0}};
            size_t i = diffusion_problem_cell(problem, x, y, 0) * groups;
            for (size_t z = 0; z < problem->column; z++) {
                UNROLL
                for (size_t g = 0; g < groups; g++, i++) {
                    problem->values[i] += alpha[g] * problem->direction[i];
                    problem->residual[i] -= alpha[g] * (problem->left[i] + problem->right[i]);
                    dots[g] += problem->residual[i] * problem->residual[i];
                }
            }
            collect(squares, dots, groups);
        }
    }
}

/* residual = (I - L)^-1 values, values = 0; writes residual . residual. */
ALWAYS_INLINE void begin(const struct diffusion *diffusion, struct diffusion_problem *problem,
                         size_t groups, int channel, double *squares)
{
    const struct diffusion_box *box = &problem->box;
    const float4 none[MAX_GROUPS] = {{0}};
    for (int y = box->y0; y < box->y1; y++) {
        for (int x = box->x0; x < box->x1; x++) {
            struct column at = column_at(diffusion, problem, x, y, channel);
            forward_column(&at, problem->values, NULL, problem->residual, groups, channel, NULL);
            memset(problem->values + at.place * groups, 0,
                   problem->column * groups * sizeof(float4));
        }
    }
    step(problem, none, groups, squares);
}

/* Back from the factor's variables: values = (I - L^T)^-1 values. */
ALWAYS_INLINE void end(const struct diffusion *diffusion, struct diffusion_problem *problem,
                       size_t groups, int channel)
{
    const struct diffusion_box *box = &problem->box;
    for (int y = box->y1; y-- > box->y0;) {
        for (int x = box->x1; x-- > box->x0;) {
            struct column at = column_at(diffusion, problem, x, y, channel);
            back_column(&at, problem->values, problem->values, groups, channel);
        }
    }
}

/* The same with the number of groups, and whether lanes share a channel, known to the compiler. */
ALWAYS_INLINE int iterate(const struct diffusion *diffusion, struct diffusion_problem *problem,
                          size_t groups, int channel)
{
    double squares[MAX_LANES];
    double goals[MAX_LANES];
    double before[MAX_LANES];
    double curvature[MAX_LANES];
    float4 alpha[MAX_GROUPS] = {{0}};
    float4 beta[MAX_GROUPS] = {{0}};
    begin(diffusion, problem, groups, channel, squares);
    for (size_t lane = 0; lane < 4 * groups; lane++) {
        goals[lane] = TOLERANCE * TOLERANCE * squares[lane];
    }
    problem->iterations = 0;
    for (;;) {
        int waiting = 0;
        for (size_t lane = 0; lane < 4 * groups; lane++) {
            waiting += squares[lane] > goals[lane];
        }
        if (waiting == 0) {
            break;
        }
        if (problem->iterations == MAX_ITERATIONS) {
            return NACRE_FAILED;
        }
        problem->iterations++;
        sweep_back(diffusion, problem, beta, groups, channel);
        sweep_forward(diffusion, problem, groups, channel, curvature);
        /* A lane that has arrived stands still, so that its result does not depend on the other lanes. */
        for (size_t lane = 0; lane < 4 * groups; lane++) {
            bool moving = squares[lane] > goals[lane];
            alpha[lane / 4][lane % 4] = moving ? (float)(squares[lane] / curvature[lane]) : 0;
            before[lane] = squares[lane];
        }
        step(problem, alpha, groups, squares);
        for (size_t lane = 0; lane < 4 * groups; lane++) {
            bool moving = before[lane] > goals[lane];
            beta[lane / 4][lane % 4] = moving ? (float)(squares[lane] / before[lane]) : 0;
        }
    }
    end(diffusion, problem, groups, channel);
    return NACRE_OK;
}

int diffusion_solve(const struct diffusion *diffusion, struct diffusion_problem *problem,
                    int channel, struct nacre_error *error)
{
    int status = problem->lanes == DIFFUSION_BATCH
                     ? iterate(diffusion, problem, MAX_GROUPS, channel)
                     : iterate(diffusion, problem, 1, -1);
    if (status) {
        return nacre_fail(error, "light transport: no solution after %d iterations",
                          problem->iterations);
    }
    return NACRE_OK;
}
