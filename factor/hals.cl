/* Block coordinate descent on R ~ (FH) * G with the weights W^2 = 1/G: the method "hals".
 *
 * With the other factor held, the best row f of F (or column of H) at a point minimises a quadratic of its own:
 *
 *     1/2 (f - f0)^T A (f - f0) - b^T (f - f0),    A = sum_d m'(d) g(d) h h^T,    b = sum_d m(d) (R - g f0^T h) h
 *
 * where h is the other factor's vector at distance d and m, m' are weights of a quadrature over the window: 1 for all
 * entries, or a few entries standing for their neighbours (levels.h). A work-item takes ROWS rows of one block of LANES
 * points. It goes through the rows of the other factor, and for each through the columns of the quadrature:
 *
 *     phase 1:  f0^T h for ROWS x STEPS entries in registers; the weighted residual m (R - g f0^T h) to a buffer
 *     phase 2:  b += residual * h for GROUP terms at a time
 *     phase 3:  A += m' g h h^T for a TILE x TILE corner of it at a time
 *
 * and ends with SWEEPS passes over the terms, each set in turn to its best value that is not negative. Lanes are
 * points x_i when F is updated and x_o when H is; layout.cl tells how everything lies. */

#include "layout.cl"

#ifndef TERMS
#define TERMS 12
#endif
#ifndef WINDOW
#define WINDOW 64 /* at least the window */
#endif
#ifndef ROWS
#define ROWS 2 /* rows of points that share the loads of the other factor */
#endif
#ifndef STEPS
#define STEPS 4 /* columns at a time in phase 1 */
#endif
#ifndef GROUP
#define GROUP 6 /* terms at a time in phase 2 */
#endif
#ifndef TILE
#define TILE 3 /* side of the corners of A in phase 3 */
#endif
#ifndef SWEEPS
#define SWEEPS 5
#endif

/* Columns of the window to visit, the weight of each, and the weight of each of its rows (0: not visited). */
struct level {
    global const int *columns;
    global const float *column_weights;
    global const float *row_weights;
    int count;
};

#define PAIRS                                                                                      \
    (TILES * (TILES + 1) / 2 * TILE * TILE) /* accumulators of A: its lower triangle in tiles */
#define TILES  ((TERMS + TILE - 1) / TILE)
#define GROUPS ((TERMS + GROUP - 1) / GROUP)

/* A's entry (s, t). */
INLINE int entry_of(int s, int t)
{
    int high = max(s / TILE, t / TILE), low = min(s / TILE, t / TILE);
    int row = s / TILE >= t / TILE ? s % TILE : t % TILE;
    int column = s / TILE >= t / TILE ? t % TILE : s % TILE;
    return ((high * (high + 1) / 2 + low) * TILE + row) * TILE + column;
}

/* One block of one row of points, as far as it meets one row of the other factor. */
struct meeting {
    global const stored *responses; /* row (y, dy) */
    global const ushort *mask;
    global const float *kernels; /* row dy of kernel 0 */
    global const int *labels;    /* of the row that is lit, at the block */
    global const float *own;     /* f0 at the block */
};

/* Row dy of the kernels that the lanes' entries have, by the window's column: [WINDOW]. With one cluster for all points
 * within reach each is one number for all lanes. */
INLINE void spread_kernels(VEC *g, const struct meeting *m, int outgoing, const struct sizes s)
{
    const int half_window = s.window / 2, area = (s.window + 1) * s.window;
    const int first = outgoing ? -half_window : 0;
    const int end = outgoing ? LANES + half_window : LANES;
    int same = 1;
    if (CLUSTERED) {
        for (int x = first + 1; x < end; x++) {
            same &= m->labels[x] == m->labels[first];
        }
    }
    if (!CLUSTERED || same) {
        global const float *from = m->kernels + (CLUSTERED ? m->labels[first] * area : 0);
        for (int e = 0; e < s.window; e++) {
            g[e] = (VEC)(from[e]);
        }
        return;
    }
    float *lanes = (float *)g;
    if (!outgoing) {
        for (int lane = 0; lane < LANES; lane++) {
            global const float *from = m->kernels + m->labels[lane] * area;
            for (int e = 0; e < s.window; e++) {
                lanes[e * LANES + lane] = from[e];
            }
        }
        return;
    }
    for (int x = first; x < end; x++) { /* lit there, entry e meets lane x - half + e */
        global const float *from = m->kernels + m->labels[x] * area;
        const int low = max(0, half_window - x), high = min(s.window, LANES + half_window - x);
        for (int e = low; e < high; e++) {
            lanes[e * LANES + x - half_window + e] = from[e];
        }
    }
}

/* Distance in floats from a block of the other factor to what entry e meets there. */
INLINE int shift_of(int e, int outgoing, const struct sizes s)
{
    return outgoing ? s.window / 2 - e : e - s.window / 2;
}

/* f0^T h of COUNT columns for ROWS rows. */
#define PRODUCTS(NAME, COUNT)                                                                      \
    INLINE void NAME(VEC product[ROWS][COUNT], const struct meeting *m, global const float *other, \
                     global const int *columns, int outgoing, const struct sizes s)                \
    {                                                                                              \
        int shift[COUNT];                                                                          \
        UNROLL for (int j = 0; j < COUNT; j++)                                                     \
        {                                                                                          \
            shift[j] = shift_of(columns[j], outgoing, s);                                          \
            UNROLL for (int r = 0; r < ROWS; r++)                                                  \
            {                                                                                      \
                product[r][j] = 0;                                                                 \
            }                                                                                      \
        }                                                                                          \
        for (int t = 0; t < TERMS; t++) {                                                          \
            VEC h[COUNT];                                                                          \
            UNROLL for (int j = 0; j < COUNT; j++)                                                 \
            {                                                                                      \
                h[j] = VLOAD(0, other + t * s.stride + shift[j]);                                  \
            }                                                                                      \
            UNROLL for (int r = 0; r < ROWS; r++)                                                  \
            {                                                                                      \
                VEC f = *(global const VEC *)(m[r].own + t * s.stride);                            \
                UNROLL for (int j = 0; j < COUNT; j++)                                             \
                {                                                                                  \
                    product[r][j] = fma(f, h[j], product[r][j]);                                   \
                }                                                                                  \
            }                                                                                      \
        }                                                                                          \
    }

PRODUCTS(products_steps, STEPS)
PRODUCTS(products_one, 1)

/* R - g f0^T h of entry e, 0 where it was not measured. */
INLINE VEC residual(const struct meeting *m, VEC product, VEC g, int block, int e, int outgoing,
                    const struct sizes s)
{
    VEC response = load_entry(m->responses, s.window, block, e, outgoing);
    VEC difference = response - g * product;
    if (MASKED) {
        IVEC measured = load_mask(m->mask, s.window, block, e, outgoing);
        difference = select((VEC)(0), difference, measured);
    }
    return difference;
}

/* Phase 1 for all columns of the level: residuals [column][ROWS], from kernels g [ROWS][WINDOW]. */
INLINE void find_residuals(const struct meeting *m, const VEC *g, global const float *other,
                           VEC *residuals, const float *row_weights, const struct level level,
                           int block, int outgoing, const struct sizes s)
{
    int j = 0;
    for (; j + STEPS <= level.count; j += STEPS) {
        VEC product[ROWS][STEPS];
        products_steps(product, m, other, level.columns + j, outgoing, s);
        UNROLL for (int r = 0; r < ROWS; r++)
        {
            UNROLL for (int i = 0; i < STEPS; i++)
            {
                residuals[(j + i) * ROWS + r] =
                    residual(&m[r], product[r][i], g[r * WINDOW + level.columns[j + i]], block,
                             level.columns[j + i], outgoing, s) *
                    (row_weights[r] * level.column_weights[j + i]);
            }
        }
    }
    for (; j < level.count; j++) {
        VEC product[ROWS][1];
        products_one(product, m, other, level.columns + j, outgoing, s);
        UNROLL for (int r = 0; r < ROWS; r++)
        {
            residuals[j * ROWS + r] =
                residual(&m[r], product[r][0], g[r * WINDOW + level.columns[j]], block,
                         level.columns[j], outgoing, s) *
                (row_weights[r] * level.column_weights[j]);
        }
    }
}

/* Phase 2: gradient [term][ROWS] += residual * h. */
INLINE void add_gradient(VEC *gradient, const VEC *residuals, global const float *other,
                         const struct level level, int outgoing, const struct sizes s)
{
    for (int first = 0; first < GROUPS * GROUP; first += GROUP) {
        global const float *plane = other + first * s.stride;
        VEC sum[GROUP][ROWS];
        UNROLL for (int t = 0; t < GROUP; t++)
        {
            UNROLL for (int r = 0; r < ROWS; r++)
            {
                sum[t][r] = gradient[(first + t) * ROWS + r];
            }
        }
        for (int j = 0; j < level.count; j++) {
            global const float *at = plane + shift_of(level.columns[j], outgoing, s);
            UNROLL for (int t = 0; t < GROUP; t++)
            {
                VEC h = VLOAD(0, at + t * s.stride);
                UNROLL for (int r = 0; r < ROWS; r++)
                {
                    sum[t][r] = fma(residuals[j * ROWS + r], h, sum[t][r]);
                }
            }
        }
        UNROLL for (int t = 0; t < GROUP; t++)
        {
            UNROLL for (int r = 0; r < ROWS; r++)
            {
                gradient[(first + t) * ROWS + r] = sum[t][r];
            }
        }
    }
}

/* Phase 3 of one row of points: curvature [pair] += m' g h h^T. */
INLINE void add_curvature(VEC *curvature, const VEC *weights, global const float *other,
                          const struct level level, int outgoing, const struct sizes s)
{
    VEC *corner = curvature;
    for (int high = 0; high < TILES; high++) {
        for (int low = 0; low <= high; low++, corner += TILE * TILE) {
            global const float *rows = other + high * TILE * s.stride;
            global const float *columns = other + low * TILE * s.stride;
            VEC sum[TILE][TILE];
            UNROLL for (int i = 0; i < TILE * TILE; i++)
            {
                sum[i / TILE][i % TILE] = corner[i];
            }
            for (int j = 0; j < level.count; j++) {
                int shift = shift_of(level.columns[j], outgoing, s);
                VEC h[TILE];
                UNROLL for (int i = 0; i < TILE; i++)
                {
                    h[i] = VLOAD(0, columns + i * s.stride + shift) * weights[j];
                }
                UNROLL for (int i = 0; i < TILE; i++)
                {
                    VEC row = VLOAD(0, rows + i * s.stride + shift);
                    UNROLL for (int k = 0; k < TILE; k++)
                    {
                        sum[i][k] = fma(row, h[k], sum[i][k]);
                    }
                }
            }
            UNROLL for (int i = 0; i < TILE * TILE; i++)
            {
                corner[i] = sum[i / TILE][i % TILE];
            }
        }
    }
}

/* Where row r of a work-item meets row y of the other factor. Returns whether it does. */
INLINE int meet(struct meeting *m, int own_y, int y, int block, global const stored *responses,
                global const ushort *mask, global const int *labels, global const float *kernels,
                global const float *own, int outgoing, int *v, const struct sizes s)
{
    const size_t zeros = (size_t)s.lead + (size_t)s.height * s.window * s.row + s.lead;
    const int lit_y = outgoing ? y : own_y;
    *v = (outgoing ? own_y - y : y - own_y) + s.window / 2;
    const int used = own_y < s.height && *v >= 0 && *v < s.window;
    const size_t at = used ? s.lead + ((size_t)lit_y * s.window + *v) * (size_t)s.row : zeros;
    m->responses = responses + at;
    m->mask = mask + (MASKED ? at / LANES : 0);
    m->labels = labels + (used ? lit_y : 0) * s.label_stride + s.pad + block * LANES;
    m->kernels = kernels + (used ? *v : s.window) * s.window;
    m->own = own + own_y * s.planes * s.stride + s.pad + block * LANES;
    return used;
}

/* SWEEPS passes of coordinate descent from f0 with A and b; writes the row of `next`. */
INLINE void solve(const VEC *gradient, const VEC *curvature, global const float *own,
                  global float *next, int row, IVEC inside, const struct sizes s)
{
    VEC f[TERMS], left[TERMS], matrix[TERMS][TERMS];
    for (int t = 0; t < TERMS; t++) {
        f[t] = *(global const VEC *)(own + t * s.stride);
        left[t] = gradient[t * ROWS + row];
        for (int u = 0; u < TERMS; u++) {
            matrix[t][u] = curvature[entry_of(t, u)];
        }
    }
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        for (int t = 0; t < TERMS; t++) {
            VEC diagonal = matrix[t][t];
            VEC moved =
                select(f[t], fmax(f[t] + left[t] / diagonal, (VEC)(0)), diagonal > (VEC)(FLT_MIN));
            VEC change = moved - f[t];
            f[t] = moved;
            for (int u = 0; u < TERMS; u++) {
                left[u] -= matrix[t][u] * change;
            }
        }
    }
    for (int t = 0; t < TERMS; t++) {
        *(global VEC *)(next + t * s.stride) = select((VEC)(0), f[t], inside);
    }
}

/* One factor's best step: from `own` to `next`, with `other` held. */
INLINE void descend(global const stored *responses, global const ushort *mask,
                    global const int *labels, global const float *kernels, global const float *own,
                    global const float *other, global float *next, const struct level entries,
                    const struct level quadrature, int outgoing, const struct sizes s)
{
    const int block = get_global_id(0), first = get_global_id(1) * ROWS, half_window = s.window / 2;
    const int stop = min(s.height - 1, first + ROWS - 1 + half_window);
    struct meeting m[ROWS];
    VEC gradient[GROUPS * GROUP * ROWS], curvature[ROWS][PAIRS], buffer[WINDOW * ROWS];
    VEC g[ROWS * WINDOW];
    for (int i = 0; i < GROUPS * GROUP * ROWS; i++) {
        gradient[i] = 0;
    }
    for (int i = 0; i < ROWS * PAIRS; i++) {
        curvature[i / PAIRS][i % PAIRS] = 0;
    }
    for (int i = 0; i < ROWS * WINDOW; i++) {
        g[i] = 0; /* rows that meet nothing weigh nothing, but must be numbers */
    }
    for (int y = max(0, first - half_window); y <= stop; y++) {
        global const float *there = other + y * s.planes * s.stride + s.pad + block * LANES;
        float entry_weights[ROWS], quadrature_weights[ROWS];
        int any = 0;
        for (int r = 0; r < ROWS; r++) {
            int v;
            int used = meet(&m[r], first + r, y, block, responses, mask, labels, kernels, own,
                            outgoing, &v, s);
            entry_weights[r] = used ? entries.row_weights[v] : 0;
            quadrature_weights[r] = used ? quadrature.row_weights[v] : 0;
            any |= entry_weights[r] != 0;
            if (entry_weights[r] != 0 || quadrature_weights[r] != 0) {
                spread_kernels(g + r * WINDOW, &m[r], outgoing, s);
            }
        }
        if (any) {
            find_residuals(m, g, there, buffer, entry_weights, entries, block, outgoing, s);
            add_gradient(gradient, buffer, there, entries, outgoing, s);
        }
        for (int r = 0; r < ROWS; r++) {
            if (quadrature_weights[r] == 0) {
                continue;
            }
            for (int j = 0; j < quadrature.count; j++) {
                int e = quadrature.columns[j];
                VEC weight =
                    g[r * WINDOW + e] * (quadrature_weights[r] * quadrature.column_weights[j]);
                if (MASKED) {
                    IVEC measured = load_mask(m[r].mask, s.window, block, e, outgoing);
                    weight = select((VEC)(0), weight, measured);
                }
                buffer[j] = weight;
            }
            add_curvature(curvature[r], buffer, there, quadrature, outgoing, s);
        }
    }
    IVEC inside = (IVEC)(s.width - block * LANES) > LANE_NUMBERS;
    for (int r = 0; r < ROWS && first + r < s.height; r++) {
        long at = (long)(first + r) * s.planes * s.stride + s.pad + block * LANES;
        solve(gradient, curvature[r], own + at, next + at, r, inside, s);
    }
}

#define ARGUMENTS                                                                                  \
    global const stored *responses, global const ushort *mask, global const int *labels,           \
        global const float *kernels, global const float *own, global const float *other,           \
        global float *next, global const int *columns, global const float *column_weights,         \
        global const float *row_weights, global const int *quadrature_columns,                     \
        global const float *quadrature_column_weights, global const float *quadrature_row_weights, \
        int count, int quadrature_count, const struct sizes s
#define ENTRIES ((struct level){columns, column_weights, row_weights, count})
#define QUADRATURE                                                                                 \
    ((struct level){quadrature_columns, quadrature_column_weights, quadrature_row_weights,         \
                    quadrature_count})

/* The step of F: own and next are F, other is H. */
kernel void descend_f(ARGUMENTS)
{
    descend(responses, mask, labels, kernels, own, other, next, ENTRIES, QUADRATURE, 0, s);
}

/* The step of H: own and next are H, other is F. */
kernel void descend_h(ARGUMENTS)
{
    descend(responses, mask, labels, kernels, own, other, next, ENTRIES, QUADRATURE, 1, s);
}

/* Twice the objective of F (own) and H (other): a sum and its rounding error for each work-item, into next. */
kernel void measure_level(ARGUMENTS)
{
    const int block = get_global_id(0), first = get_global_id(1) * ROWS, half_window = s.window / 2;
    const int stop = min(s.height - 1, first + ROWS - 1 + half_window);
    const struct level entries = ENTRIES;
    float total = 0, lost = 0;
    for (int y = max(0, first - half_window); y <= stop; y++) {
        global const float *there = other + y * s.planes * s.stride + s.pad + block * LANES;
        struct meeting m[ROWS];
        float weights[ROWS], lanes[LANES], row = 0;
        VEC sum = 0, g[ROWS * WINDOW];
        for (int r = 0; r < ROWS; r++) {
            int v;
            int used =
                meet(&m[r], first + r, y, block, responses, mask, labels, kernels, own, 0, &v, s);
            weights[r] = used ? entries.row_weights[v] : 0;
            spread_kernels(g + r * WINDOW, &m[r], 0, s);
        }
        for (int j = 0; j < entries.count; j += STEPS) {
            VEC product[ROWS][STEPS];
            int many = j + STEPS <= entries.count;
            if (many) {
                products_steps(product, m, there, entries.columns + j, 0, s);
            }
            for (int i = 0; i < STEPS && j + i < entries.count; i++) {
                VEC one[ROWS][1];
                if (!many) {
                    products_one(one, m, there, entries.columns + j + i, 0, s);
                }
                for (int r = 0; r < ROWS; r++) {
                    const int e = entries.columns[j + i];
                    VEC g_e = g[r * WINDOW + e];
                    VEC d = residual(&m[r], many ? product[r][i] : one[r][0], g_e, block, e, 0, s);
                    sum +=
                        select((VEC)(0), d * d / g_e * (weights[r] * entries.column_weights[j + i]),
                               g_e > (VEC)(0));
                }
            }
        }
        *(VEC *)lanes = sum;
        for (int lane = 0; lane < LANES; lane++) {
            row += lanes[lane];
        }
        float added = total + (row - lost); /* Kahan */
        lost = (added - total) - (row - lost);
        total = added;
    }
    next[(get_global_id(1) * s.blocks + block) * 2] = total;
    next[(get_global_id(1) * s.blocks + block) * 2 + 1] = -lost;
}

/* next = max(0, now + beta (now - before)), element by element. */
kernel void extrapolate(global const float *now, global const float *before, global float *next,
                        float beta)
{
    const size_t i = get_global_id(0);
    next[i] = fmax(0.0f, now[i] + beta * (now[i] - before[i]));
}
