/* Laying out the grids of a multigrid solution and filling in their coefficients. */
#include "rig/virtual/diffusion_level.h"

#include <string.h>

enum {
    COARSEST = 3, /* columns along the longer side of the coarsest grid, at most */
};

static int larger(int a, int b)
{
    return a > b ? a : b;
}

int diffusion_level_count(int nx, int ny)
{
    int count = 1;
    while (larger(nx, ny) > COARSEST) {
        nx = (nx + 1) / 2;
        ny = (ny + 1) / 2;
        count++;
    }
    return count;
}

/* Arrays begin on whole cache lines. */
static size_t round_up(size_t bytes)
{
    return (bytes + 63) / 64 * 64;
}

/* Point the level's arrays into memory from `offset` on, if there is memory; returns the offset behind them. */
static size_t place_level(struct diffusion_level *level, char *memory, size_t offset)
{
    size_t cells = ((size_t)level->ny + 2) * level->row;
    size_t coefficients = cells * level->coefficients;
    struct {
        float **array;
        size_t count;
    } const arrays[] = {{&level->left, coefficients},
                        {&level->back, coefficients},
                        {&level->above, coefficients},
                        {&level->loss, coefficients},
                        {&level->pivot, coefficients},
                        {&level->carry, coefficients},
                        {&level->source, cells * level->lanes},
                        {&level->values, cells * level->lanes},
                        {&level->change, DIFFUSION_CHANGE_ROWS * level->row * level->lanes}};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++) {
        if (memory) {
            *arrays[i].array = (float *)(void *)(memory + offset);
        }
        offset += round_up(arrays[i].count * sizeof(float));
    }
    return offset;
}

static struct diffusion_level make_level(int nx, int ny, int nz, enum diffusion_lanes lanes)
{
    return (struct diffusion_level){.nx = nx,
                                    .ny = ny,
                                    .nz = nz,
                                    .coefficients = lanes == DIFFUSION_BATCH ? 1 : 4,
                                    .lanes = (size_t)lanes,
                                    .column = (size_t)nz,
                                    .row = ((size_t)nx + 2) * (size_t)nz};
}

/* Lay out all levels behind their descriptions; without memory only count. Returns the bytes. */
static size_t place_levels(char *memory, int nx, int ny, int nz, enum diffusion_lanes lanes)
{
    int count = diffusion_level_count(nx, ny);
    struct diffusion_level *levels = (void *)memory;
    size_t offset = round_up((size_t)count * sizeof *levels);
    for (int i = 0; i < count; i++) {
        struct diffusion_level level = make_level(nx, ny, nz, lanes);
        offset = place_level(&level, memory, offset);
        if (memory) {
            levels[i] = level;
        }
        nx = (nx + 1) / 2;
        ny = (ny + 1) / 2;
    }
    return offset;
}

size_t diffusion_levels_size(int nx, int ny, int nz, enum diffusion_lanes lanes)
{
    return place_levels(NULL, nx, ny, nz, lanes);
}

static size_t level_cell(const struct diffusion_level *level, int x, int y)
{
    return ((size_t)y + 1) * level->row + ((size_t)x + 1) * level->column;
}

/* Copy one column's coefficients out of the system. */
static void copy_column(const struct diffusion_problem *problem, const struct diffusion *diffusion,
                        struct diffusion_level *level, int x, int y, size_t first)
{
    const struct diffusion_box *box = &problem->box;
    size_t from = diffusion_cell(diffusion, box->x0 + x, box->y0 + y, 0);
    size_t to = level_cell(level, x, y) * level->coefficients;
    const float *left = (const float *)(diffusion->left + from) + first;
    const float *back = (const float *)(diffusion->back + from) + first;
    const float *above = (const float *)(diffusion->above + from) + first;
    const float *loss = (const float *)(diffusion->loss + from) + first;
    for (size_t z = 0; z < level->column; z++) {
        for (size_t c = 0; c < level->coefficients; c++, to++) {
            level->left[to] = left[4 * z + c];
            level->back[to] = back[4 * z + c];
            level->above[to] = above[4 * z + c];
            level->loss[to] = loss[4 * z + c];
        }
    }
}

/* Conductances from column (x, y) across a side of the box become losses. */
static void open_side(const struct diffusion_problem *problem, const float4 *conductances,
                      struct diffusion_level *level, int x, int y, size_t first)
{
    size_t to = level_cell(level, x, y) * level->coefficients;
    for (size_t z = 0; z < level->column; z++) {
        for (size_t c = 0; c < level->coefficients; c++, to++) {
            level->loss[to] += problem->box.open * ((const float *)(conductances + z))[first + c];
        }
    }
}

static void fill_finest(const struct diffusion_problem *problem, const struct diffusion *diffusion,
                        struct diffusion_level *level, size_t first)
{
    const struct diffusion_box *box = &problem->box;
    size_t column = level->column * level->coefficients * sizeof(float);
    for (int y = 0; y < level->ny; y++) {
        for (int x = 0; x < level->nx; x++) {
            copy_column(problem, diffusion, level, x, y, first);
        }
    }
    for (int y = 0; y < level->ny; y++) {
        const int last = level->nx - 1;
        open_side(problem, diffusion->left + diffusion_cell(diffusion, box->x0, box->y0 + y, 0),
                  level, 0, y, first);
        open_side(problem, diffusion->left + diffusion_cell(diffusion, box->x1, box->y0 + y, 0),
                  level, last, y, first);
        memset(level->left + level_cell(level, 0, y) * level->coefficients, 0, column);
    }
    for (int x = 0; x < level->nx; x++) {
        const int last = level->ny - 1;
        open_side(problem, diffusion->back + diffusion_cell(diffusion, box->x0 + x, box->y0, 0),
                  level, x, 0, first);
        open_side(problem, diffusion->back + diffusion_cell(diffusion, box->x0 + x, box->y1, 0),
                  level, x, last, first);
        memset(level->back + level_cell(level, x, 0) * level->coefficients, 0, column);
    }
}

/* Conductance from one coarse cell to the next along one line of fine cells: half of the one before, across, and half
 * of the one after, in series. Where there is no fine cell before or after, there is no resistance. */
static inline float in_series(float before, float across, float after)
{
    const float none = 1e6F;
    before = before > 0 ? before : none * across;
    after = after > 0 ? after : none * across;
    float sum = before * after + 0.5F * across * (before + after);
    return across > 0 ? across * (before * after / sum) : 0;
}

/* Add one fine column to the coarse one that it is part of. `careful`: what joins two coarse columns is what joins their
 * fine ones, which is exact for corrections that are the same in a coarse column (Galerkin). */
static void join_column(const struct diffusion_level *fine, struct diffusion_level *coarse, int x,
                        int y, bool careful)
{
    size_t n = fine->column * fine->coefficients;
    size_t behind = fine->row * fine->coefficients;
    size_t from = level_cell(fine, x, y) * fine->coefficients;
    size_t to = level_cell(coarse, x / 2, y / 2) * coarse->coefficients;
    float *above = coarse->above + to;
    float *loss = coarse->loss + to;
    for (size_t k = 0; k < n; k++) {
        above[k] += fine->above[from + k];
        loss[k] += fine->loss[from + k];
    }
    if (x > 0 && x % 2 == 0) {
        float *left = coarse->left + to;
        const float *across = fine->left + from;
        for (size_t k = 0; k < n; k++) {
            left[k] += careful ? across[k] : in_series(across[k - n], across[k], across[k + n]);
        }
    }
    if (y > 0 && y % 2 == 0) {
        float *back = coarse->back + to;
        const float *across = fine->back + from;
        for (size_t k = 0; k < n; k++) {
            back[k] +=
                careful ? across[k] : in_series(across[k - behind], across[k], across[k + behind]);
        }
    }
}

static void join_level(const struct diffusion_level *fine, struct diffusion_level *coarse,
                       bool careful)
{
    size_t size = ((size_t)coarse->ny + 2) * coarse->row * coarse->coefficients * sizeof(float);
    memset(coarse->left, 0, size);
    memset(coarse->back, 0, size);
    memset(coarse->above, 0, size);
    memset(coarse->loss, 0, size);
    for (int y = 0; y < fine->ny; y++) {
        for (int x = 0; x < fine->nx; x++) {
            join_column(fine, coarse, x, y, careful);
        }
    }
}

/* Eliminate a column's own equations from the top down. */
static void factor_column(struct diffusion_level *level, int x, int y)
{
    size_t step = level->coefficients;
    size_t right = level->column * step;
    size_t front = level->row * step;
    for (size_t c = 0; c < step; c++) {
        size_t i = level_cell(level, x, y) * step + c;
        double before = 0; /* the pivot of the voxel above */
        for (size_t z = 0; z < level->column; z++, i += step) {
            double above = (double)level->above[i];
            double below = z + 1 < level->column ? (double)level->above[i + step] : 0;
            double diagonal = (double)level->loss[i] + above + below + (double)level->left[i] +
                              (double)level->left[i + right] + (double)level->back[i] +
                              (double)level->back[i + front];
            level->carry[i] = (float)(above * before);
            before = 1 / (diagonal - above * above * before);
            level->pivot[i] = (float)before;
        }
    }
}

static void factor_level(struct diffusion_level *level)
{
    for (int y = 0; y < level->ny; y++) {
        for (int x = 0; x < level->nx; x++) {
            factor_column(level, x, y);
        }
    }
}

/* The idle fourth channel has no coefficients: a loss of 1 keeps it at 0. */
static void fill_idle_lane(struct diffusion_level *level)
{
    size_t cells = ((size_t)level->ny + 2) * level->row;
    for (size_t i = 0; i < cells; i++) {
        level->loss[4 * i + 3] = 1;
    }
}

void diffusion_levels_lay(struct diffusion_problem *problem, int nz)
{
    int nx = problem->box.x1 - problem->box.x0;
    int ny = problem->box.y1 - problem->box.y0;
    memset(problem->memory, 0, diffusion_levels_size(nx, ny, nz, problem->lanes));
    (void)place_levels(problem->memory, nx, ny, nz, problem->lanes);
    problem->levels = problem->memory;
    problem->level_count = diffusion_level_count(nx, ny);
}

void diffusion_levels_fill(struct diffusion_problem *problem)
{
    struct diffusion_level *fine = problem->levels;
    fill_finest(problem, problem->system, fine,
                fine->coefficients == 1 ? (size_t)problem->channel : 0);
    for (int i = 0; i < problem->level_count; i++, fine++) {
        if (fine->coefficients == 4) {
            fill_idle_lane(fine);
        }
        factor_level(fine);
        if (i + 1 < problem->level_count) {
            join_level(fine, fine + 1, problem->careful);
        }
    }
}
