/* The sweeps of a multigrid cycle, for one kind of lanes and one kind of processor. No include guard: diffusion_solve.c
 * includes it once for each, after defining
 *   NAME(x)      the functions' names
 *   TARGET       attributes for the processor
 *   VECTOR       a voxel's values: SIMD lanes
 *   COEFFICIENT  float, which all lanes share, or as many lanes as VECTOR
 *
 * Columns are red where x + y is even and black elsewhere; a column is solved as a whole for the values of its four
 * neighbours, which have the other colour. Sweeps follow each other some rows behind, so that rows are met again while
 * they are in the cache. */

/* A column's coefficients and values, and those of its neighbours. */
struct NAME(column) {
    const COEFFICIENT *left, *right, *back, *front, *pivot, *carry;
    const VECTOR *source;
    VECTOR *values;
    size_t beside, behind, count; /* values from a column and from a row to the next; voxels */
};

TARGET ALWAYS_INLINE struct NAME(column)
    NAME(column_at)(const struct diffusion_level *level, int x, int y)
{
    size_t top = ((size_t)y + 1) * level->row + ((size_t)x + 1) * level->column;
    const COEFFICIENT *left = (const COEFFICIENT *)(const void *)level->left + top;
    const COEFFICIENT *back = (const COEFFICIENT *)(const void *)level->back + top;
    return (struct NAME(column)){
        .left = left,
        .right = left + level->column,
        .back = back,
        .front = back + level->row,
        .pivot = (const COEFFICIENT *)(const void *)level->pivot + top,
        .carry = (const COEFFICIENT *)(const void *)level->carry + top,
        .source = (const VECTOR *)(const void *)level->source + top,
        .values = (VECTOR *)(void *)level->values + top,
        .beside = level->column,
        .behind = level->row,
        .count = level->column,
    };
}

/* What flows into voxel z from the neighbouring columns, whose values `at` points into. */
TARGET ALWAYS_INLINE VECTOR NAME(inflow)(const struct NAME(column) * column, const VECTOR *at,
                                         size_t z)
{
    return column->left[z] * at[z - column->beside] + column->right[z] * at[z + column->beside] +
           column->back[z] * at[z - column->behind] + column->front[z] * at[z + column->behind];
}

/* The first half of solving a column, into `forward`. `isolated`: the neighbours' values are 0. */
TARGET ALWAYS_INLINE void NAME(eliminate)(const struct NAME(column) * column, bool isolated,
                                          VECTOR *forward)
{
    VECTOR above = {0};
    for (size_t z = 0; z < column->count; z++) {
        VECTOR sum = column->source[z];
        if (!isolated) {
            sum += NAME(inflow)(column, column->values, z);
        }
        above = sum + column->carry[z] * above;
        forward[z] = above;
    }
}

/* values = T^-1 (source + inflow) in column (x, y). */
TARGET ALWAYS_INLINE void NAME(solve_column)(const struct diffusion_level *level, int x, int y,
                                             bool isolated)
{
    const struct NAME(column) column = NAME(column_at)(level, x, y);
    VECTOR below = {0};
    NAME(eliminate)(&column, isolated, column.values);
    for (size_t z = column.count; z-- > 0;) {
        below = column.pivot[z] * column.values[z] + column.carry[z + 1] * below;
        column.values[z] = below;
    }
}

/* Row y of level->change, from column 0 on. */
ALWAYS_INLINE VECTOR *NAME(change_row)(const struct diffusion_level *level, int y)
{
    return (VECTOR *)(void *)level->change +
           (size_t)((y + 1) % DIFFUSION_CHANGE_ROWS) * level->row + level->column;
}

/* The same as solve_column, noting the change from the old values (`fresh`: from 0). Returns its squares' sum. */
TARGET ALWAYS_INLINE VECTOR NAME(change_column)(const struct diffusion_level *level, int x, int y,
                                                bool fresh)
{
    const struct NAME(column) column = NAME(column_at)(level, x, y);
    VECTOR *change = NAME(change_row)(level, y) + (size_t)x * level->column;
    VECTOR below = {0};
    VECTOR sum = {0};
    NAME(eliminate)(&column, false, change);
    for (size_t z = column.count; z-- > 0;) {
        below = column.pivot[z] * change[z] + column.carry[z + 1] * below;
        change[z] = fresh ? below : below - column.values[z];
        column.values[z] = below;
        sum += change[z] * change[z];
    }
    return sum;
}

/* Add what the black columns' change gives the red ones of row y to the source of the coarser level. */
TARGET static void NAME(restrict_row)(const struct diffusion_level *level,
                                      const struct diffusion_level *coarse, int y)
{
    const VECTOR *before = NAME(change_row)(level, y - 1);
    const VECTOR *here = NAME(change_row)(level, y);
    const VECTOR *after = NAME(change_row)(level, y + 1);
    for (int x = y % 2; x < level->nx; x += 2) {
        const struct NAME(column) column = NAME(column_at)(level, x, y);
        size_t at = (size_t)x * level->column;
        VECTOR *to = (VECTOR *)(void *)coarse->source + ((size_t)y / 2 + 1) * coarse->row +
                     ((size_t)x / 2 + 1) * coarse->column;
        for (size_t z = 0; z < column.count; z++, at++) {
            to[z] += column.left[z] * here[at - column.beside] +
                     column.right[z] * here[at + column.beside] + column.back[z] * before[at] +
                     column.front[z] * after[at];
        }
    }
}

/* The way down: sweep the black columns (from 0 on, `fresh`, after the red ones) and hand what remains to the coarser
 * level. Writes the squares of the black columns' change. */
TARGET static void NAME(descend)(const struct diffusion_level *level,
                                 const struct diffusion_level *coarse, bool fresh, double *squares)
{
    size_t row_size = level->column * (size_t)level->nx * sizeof(VECTOR);
    memset(coarse->source, 0, ((size_t)coarse->ny + 2) * coarse->row * sizeof(VECTOR));
    memset(NAME(change_row)(level, -1), 0, row_size);
    memset(squares, 0, DIFFUSION_BATCH * sizeof *squares);
    for (int y = -1; y <= level->ny; y++) {
        for (int x = (y + 1) % 2; fresh && y + 1 < level->ny && x < level->nx; x += 2) {
            NAME(solve_column)(level, x, y + 1, true);
        }
        if (y == level->ny) {
            memset(NAME(change_row)(level, y), 0, row_size);
        }
        for (int x = (y + 1) % 2; y >= 0 && y < level->ny && x < level->nx; x += 2) {
            VECTOR sum = fresh ? NAME(change_column)(level, x, y, true)
                               : NAME(change_column)(level, x, y, false);
            for (size_t lane = 0; lane < sizeof(VECTOR) / sizeof(float); lane++) {
                squares[lane] += (double)sum[lane];
            }
        }
        if (y > 0) {
            NAME(restrict_row)(level, coarse, y - 1);
        }
    }
}

/* Add the coarser level's values to the red columns of row y, with weights of the column that they are part of, those
 * beside and behind, and the one across. */
TARGET static void NAME(prolong_row)(const struct diffusion_level *level,
                                     const struct diffusion_level *coarse, int y,
                                     const float weights[3])
{
    size_t row = ((size_t)y / 2 + 1) * coarse->row;
    size_t other_row = ((size_t)neighbour(y, coarse->ny) + 1) * coarse->row;
    const VECTOR *values = (const VECTOR *)(const void *)coarse->values;
    for (int x = y % 2; x < level->nx; x += 2) {
        size_t column = ((size_t)x / 2 + 1) * coarse->column;
        size_t other = ((size_t)neighbour(x, coarse->nx) + 1) * coarse->column;
        const VECTOR *near = values + row + column;
        const VECTOR *beside = values + row + other;
        const VECTOR *behind = values + other_row + column;
        const VECTOR *across = values + other_row + other;
        VECTOR *to = (VECTOR *)(void *)level->values + ((size_t)y + 1) * level->row +
                     ((size_t)x + 1) * level->column;
        for (size_t z = 0; z < level->column; z++) {
            to[z] += weights[0] * near[z] + weights[1] * (beside[z] + behind[z]) +
                     weights[2] * across[z];
        }
    }
}

/* The way up: take the coarser level's correction, then sweep the black columns and the red ones. */
TARGET static void NAME(ascend)(const struct diffusion_level *level,
                                const struct diffusion_level *coarse, const float weights[3])
{
    for (int y = 0; y < level->ny + 2; y++) {
        if (y < level->ny) {
            NAME(prolong_row)(level, coarse, y, weights);
        }
        for (int x = y % 2; y >= 1 && y <= level->ny && x < level->nx; x += 2) {
            NAME(solve_column)(level, x, y - 1, false);
        }
        for (int x = y % 2; y >= 2 && x < level->nx; x += 2) {
            NAME(solve_column)(level, x, y - 2, false);
        }
    }
}

/* The coarsest level, which is small: so many sweeps that it is solved. Writes the squares of the last change. */
TARGET static void NAME(settle)(const struct diffusion_level *level, bool fresh, double *squares)
{
    enum { SWEEPS = 8 };
    memset(squares, 0, DIFFUSION_BATCH * sizeof *squares);
    if (fresh) {
        memset(level->values, 0, ((size_t)level->ny + 2) * level->row * sizeof(VECTOR));
    }
    for (int sweep = 0; sweep < 2 * SWEEPS; sweep++) {
        for (int y = 0; y < level->ny; y++) {
            for (int x = (y + sweep) % 2; x < level->nx; x += 2) {
                VECTOR sum = NAME(change_column)(level, x, y, fresh && sweep < 2);
                for (size_t lane = 0; lane < sizeof(VECTOR) / sizeof(float); lane++) {
                    squares[lane] += sweep < 2 ? (double)sum[lane] : 0;
                }
            }
        }
    }
}

/* One V-cycle over all levels; `fresh`: from values of 0. Writes the squares of what it first changed. */
TARGET static void NAME(cycle)(const struct diffusion_problem *problem, bool fresh, double *squares)
{
    double ignored[DIFFUSION_BATCH];
    int last = problem->level_count - 1;
    for (int i = 0; i < last; i++) {
        NAME(descend)
        (problem->levels + i, problem->levels + i + 1, fresh || i > 0, i > 0 ? ignored : squares);
    }
    NAME(settle)(problem->levels + last, fresh || last > 0, last > 0 ? ignored : squares);
    for (int i = last; i-- > 0;) {
        NAME(ascend)
        (problem->levels + i, problem->levels + i + 1,
         problem->careful ? CAREFUL
         : i > 0          ? BILINEAR
                          : FINEST);
    }
}

#undef NAME
#undef TARGET
#undef VECTOR
#undef COEFFICIENT
