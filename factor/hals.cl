/* Block coordinate descent on R ~ (FH) * G with the weights W^2 = 1/G: the method "hals".
 *
 * With the other factor held, the best row f of F (or column of H) at a point minimises a quadratic of its own:
 *
 *     1/2 (f - f0)^T A (f - f0) - b^T (f - f0),    A = sum_d g(d) h h^T,    b = sum_d (R - g f0^T h) h
 *
 * where h is the other factor's vector at distance d. A work-item takes ROWS rows of points. Row by row of the other
 * factor it goes through the blocks of LANES points, and for each block through the window's columns dx:
 *
 *     phase 0:  the responses R to a small buffer
 *     phase 1:  f0^T h for ROWS x STEPS columns in registers; R - g f0^T h into the buffer
 *     phase 2:  b += residual * h for GROUP terms at a time
 *
 * Then it goes through its points: A, by curvature.cl, and from A and b the new row, each term set in turn to its best
 * value that is not negative, a few times over. Lanes are points x_i when F is updated and x_o when H is; layout.cl tells
 * how everything lies. */

#include "curvature.cl"

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
#ifndef PREFETCH
#ifdef __clang__
#define PREFETCH 1 /* fetch the responses of the next block ahead of their use */
#else
#define PREFETCH 0
#endif
#endif
#define GROUPS ((TERMS + GROUP - 1) / GROUP)

/* A row of points and the row of responses that it shares with one row of the other factor. */
struct meeting {
    global const stored *responses;
    global const ushort *mask;
    global const float *kernels; /* row dy of kernel 0 */
    global const float
        *strip; /* where CLUSTERED: row dy of each point's kernel, in the layout of responses */
    global const float *own; /* f0 */
    int used;                /* 0: all of the above are zeros */
};

/* Spread the row dy of each point's kernel into the layout of a row of responses. */
INLINE void spread_kernels(global float *strip, global const float *kernels,
                           global const int *labels, const struct sizes s)
{
    const int area = (s.window + 1) * s.window;
    for (int b = 0; b < s.blocks; b++) {
        global float *run = strip + b * s.window * LANES;
        int same = 1;
        for (int lane = 1; lane < LANES; lane++) {
            same &= labels[b * LANES + lane] == labels[b * LANES];
        }
        if (same) {
            global const float *from = kernels + (long)labels[b * LANES] * area;
            for (int e = 0; e < s.window; e++) {
                *(global VEC *)(run + e * LANES) = (VEC)(from[e]);
            }
            continue;
        }
        for (int lane = 0; lane < LANES; lane++) {
            global const float *from = kernels + (long)labels[b * LANES + lane] * area;
            for (int e = 0; e < s.window; e++) {
                run[e * LANES + lane] = from[e];
            }
        }
    }
}

/* The kernel's values for entry e. */
INLINE VEC kernel_at(const struct meeting *m, int block, int e, int outgoing, const struct sizes s)
{
    if (CLUSTERED) {
        return load_floats(m->strip, s.window, block, e, outgoing);
    }
    return (VEC)(m->kernels[e]);
}

/* Phase 1 for COUNT columns from e on: residuals [column][ROWS]. Returns the sum of their squares over the kernels,
 * where that is asked for. */
#define RESIDUALS(NAME, COUNT)                                                                     \
    INLINE VEC NAME(const struct meeting *m, const float *inverse, global const float *other,      \
                    VEC *residuals, int e, int block, int outgoing, int objective,                 \
                    const struct sizes s)                                                          \
    {                                                                                              \
        VEC product[ROWS][COUNT];                                                                  \
        VEC total = 0;                                                                             \
        global const float *at =                                                                   \
            other + block * LANES + (outgoing ? s.window / 2 - e : e - s.window / 2);              \
        UNROLL for (int i = 0; i < ROWS * COUNT; i++)                                              \
        {                                                                                          \
            product[i / COUNT][i % COUNT] = 0;                                                     \
        }                                                                                          \
        for (int t = 0; t < TERMS; t++) {                                                          \
            VEC h[COUNT];                                                                          \
            UNROLL for (int i = 0; i < COUNT; i++)                                                 \
            {                                                                                      \
                h[i] = VLOAD(0, at + t * s.stride + (outgoing ? -i : i));                          \
            }                                                                                      \
            UNROLL for (int r = 0; r < ROWS; r++)                                                  \
            {                                                                                      \
                VEC f = *(global const VEC *)(m[r].own + t * s.stride + block * LANES);            \
                UNROLL for (int i = 0; i < COUNT; i++)                                             \
                {                                                                                  \
                    product[r][i] = fma(f, h[i], product[r][i]);                                   \
                }                                                                                  \
            }                                                                                      \
        }                                                                                          \
        UNROLL for (int r = 0; r < ROWS; r++)                                                      \
        {                                                                                          \
            UNROLL for (int i = 0; i < COUNT; i++)                                                 \
            {                                                                                      \
                total += finish_entry(&m[r], inverse + r * WINDOW, residuals + i * ROWS + r,       \
                                      product[r][i], e + i, block, outgoing, objective, s);        \
            }                                                                                      \
        }                                                                                          \
        return total;                                                                              \
    }

/* R - g f0^T h of entry e in the place of R, 0 where it was not measured. */
INLINE VEC finish_entry(const struct meeting *m, const float *inverse, VEC *residual, VEC product,
                        int e, int block, int outgoing, int objective, const struct sizes s)
{
    VEC g = kernel_at(m, block, e, outgoing, s);
    VEC difference = fma(-g, product, *residual);
    if (MASKED) {
        IVEC measured = load_mask(m->mask, s.window, block, e, outgoing);
        difference = select((VEC)(0), difference, measured);
    }
    *residual = difference;
    if (!objective) {
        return 0;
    }
    if (CLUSTERED) {
        return difference * difference / fmax(g, (VEC)(FLT_MIN));
    }
    return difference * difference * inverse[e];
}

RESIDUALS(residuals_steps, STEPS)
RESIDUALS(residuals_one, 1)

INLINE VEC find_residuals(const struct meeting *m, const float *inverse, global const float *other,
                          VEC *residuals, int first, int count, int block, int outgoing,
                          int objective, const struct sizes s)
{
    VEC total = 0;
    int j = 0;
    for (; j + STEPS <= count; j += STEPS) {
        total += residuals_steps(m, inverse, other, residuals + j * ROWS, first + j, block,
                                 outgoing, objective, s);
    }
    for (; j < count; j++) {
        total += residuals_one(m, inverse, other, residuals + j * ROWS, first + j, block, outgoing,
                               objective, s);
    }
    return total;
}

/* Phase 2: gradient [term][ROWS] += residual * h. */
INLINE void add_gradient(global VEC *gradient, const VEC *residuals, global const float *other,
                         int e, int count, int block, int outgoing, const struct sizes s)
{
    for (int first = 0; first < GROUPS * GROUP; first += GROUP) {
        global const float *at = other + first * s.stride + block * LANES +
                                 (outgoing ? s.window / 2 - e : e - s.window / 2);
        VEC sum[GROUP][ROWS];
        UNROLL for (int t = 0; t < GROUP; t++)
        {
            UNROLL for (int r = 0; r < ROWS; r++)
            {
                sum[t][r] = gradient[(first + t) * ROWS + r];
            }
        }
        for (int j = 0; j < count; j++) {
            UNROLL for (int t = 0; t < GROUP; t++)
            {
                VEC h = VLOAD(0, at + t * s.stride + (outgoing ? -j : j));
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

/* Phase 0: the responses of `count` columns from e on, [column][ROWS]; those of the next block are fetched ahead. */
INLINE void read_responses(VEC *responses, const struct meeting *m, int e, int count, int block,
                           int outgoing, const struct sizes s)
{
    for (int r = 0; r < ROWS; r++) {
        for (int j = 0; j < count; j++) {
            responses[j * ROWS + r] = load_entry(m[r].responses, s.window, block, e + j, outgoing);
#if PREFETCH
            const int from = outgoing ? ((s.window / 2 - e - j) >> LOG_LANES) + 1 : 0;
            global const stored *next =
                m[r].responses + ((block + from + PREFETCH) * s.window + e + j) * LANES;
            __builtin_prefetch((const void *)(size_t)next);
#endif
        }
    }
}

/* Where a row of points meets row y of the other factor. `strip`: room for its kernels. */
INLINE void meet(struct meeting *m, int own_y, int y, global const stored *responses,
                 global const ushort *mask, global const int *labels, global const float *kernels,
                 global const float *own, global float *strip, int outgoing, const struct sizes s)
{
    const size_t zeros = (size_t)s.lead + (size_t)s.height * s.window * s.row + s.lead;
    const int lit_y = outgoing ? y : own_y;
    const int v = (outgoing ? own_y - y : y - own_y) + s.window / 2;
    const int used = own_y < s.height && v >= 0 && v < s.window;
    const size_t at = used ? s.lead + ((size_t)lit_y * s.window + v) * (size_t)s.row : zeros;
    m->responses = responses + at;
    m->mask = mask + (MASKED ? at / LANES : 0);
    m->kernels = kernels + (used ? v : s.window) * s.window;
    m->own = own + min(own_y, s.height) * s.planes * s.stride + s.pad;
    m->used = used;
    m->strip = strip;
    if (CLUSTERED) {
        spread_kernels(strip, m->kernels, labels + (used ? lit_y : 0) * s.label_stride + s.pad, s);
    }
}

/* Kahan's sum of one more value for each lane. */
INLINE void add_exactly(VEC *total, VEC *lost, VEC more)
{
    VEC rest = more - *lost, added = *total + rest;
    *lost = (added - *total) - rest;
    *total = added;
}

INLINE void write_sum(global float *sums, VEC total, VEC lost)
{
    float lanes[LANES], sum = 0, error = 0;
    *(VEC *)lanes = total;
    for (int lane = 0; lane < LANES; lane++) {
        float added = sum + (lanes[lane] - error);
        error = (added - sum) - (lanes[lane] - error);
        sum = added;
    }
    *(VEC *)lanes = lost;
    for (int lane = 0; lane < LANES; lane++) {
        error += lanes[lane];
    }
    sums[0] = sum;
    sums[1] = -error;
}

/* Columns of the window that reach points of the row: [*first, *end). */
INLINE void reach(int block, int outgoing, int *first, int *end, const struct sizes s)
{
    const int left = block * LANES + LANES - 1, right = s.width - 1 - block * LANES;
    *first = max(0, s.window / 2 - (outgoing ? right : left));
    *end = min(s.window, s.window / 2 + 1 + (outgoing ? left : right));
}

#define ARGUMENTS                                                                                  \
    global const stored *responses, global const ushort *mask, global const int *labels,           \
        global const float *kernels, global const float *own, global const float *other,           \
        global float *next, global const float *far, global const float *masses,                   \
        global float *scratch, global float *sums, int near, int sweeps, const struct cells c,     \
        const struct sizes s
#define VALUES                                                                                     \
    responses, mask, labels, kernels, own, other, next, far, masses, scratch, sums, near, sweeps,  \
        c, s

/* What a work-item holds in its part of scratch. */
struct parts {
    global float *gradient; /* [block][term][ROWS][LANES] */
    global float *strips;   /* where CLUSTERED: [ROWS], each with leads */
};

INLINE struct parts parts_of(global float *scratch, const struct sizes s)
{
    const size_t gradient = (size_t)s.blocks * GROUPS * GROUP * ROWS * LANES;
    const size_t strips = CLUSTERED ? (size_t)ROWS * (s.row + 2 * s.lead) : 0;
    global float *at = scratch + get_global_id(0) * (gradient + strips);
    return (struct parts){at, at + gradient};
}

/* Phases 0 to 2 for all that the item's rows meet. Returns twice the objective, where that is asked for. */
INLINE void find_gradient(const struct parts parts, ARGUMENTS, int outgoing, int change,
                          int objective)
{
    const int top = get_global_id(0) * ROWS, half_window = s.window / 2;
    const int stop = min(s.height - 1, top + ROWS - 1 + half_window);
    VEC total = 0, lost = 0, buffer[WINDOW * ROWS];
    float inverse[ROWS * WINDOW];
    const int count = change ? s.blocks * GROUPS * GROUP * ROWS : 0;
    for (int i = 0; i < count; i++) {
        ((global VEC *)parts.gradient)[i] = 0;
    }
    for (int y = max(0, top - half_window); y <= stop; y++) {
        struct meeting m[ROWS];
        VEC row = 0;
        for (int r = 0; r < ROWS; r++) {
            meet(&m[r], top + r, y, responses, mask, labels, kernels, own,
                 parts.strips + r * (s.row + 2 * s.lead) + s.lead, outgoing, s);
            const int inverses = CLUSTERED || !objective ? 0 : s.window;
            for (int e = 0; e < inverses; e++) {
                inverse[r * WINDOW + e] = m[r].used ? 1 / m[r].kernels[e] : 0;
            }
        }
        global const float *there = other + y * s.planes * s.stride + s.pad;
        for (int block = 0; block < s.blocks; block++) {
            int first, end;
            reach(block, outgoing, &first, &end, s);
            read_responses(buffer, m, first, end - first, block, outgoing, s);
            row += find_residuals(m, inverse, there, buffer, first, end - first, block, outgoing,
                                  objective, s);
            if (change) {
                add_gradient((global VEC *)parts.gradient + block * GROUPS * GROUP * ROWS, buffer,
                             there, first, end - first, block, outgoing, s);
            }
        }
        if (objective) {
            add_exactly(&total, &lost, row);
        }
    }
    if (objective) {
        write_sum(sums + get_global_id(0) * 2, total, lost);
    }
}

/* A of one block of row y, its near part summed here. */
INLINE void find_curvature(VEC *curvature, global const ushort *mask, global const int *labels,
                           global const float *kernels, global const float *other,
                           global const float *far, global const float *masses, int near, int block,
                           int own_y, int outgoing, const struct cells c, const struct sizes s)
{
    const int half_window = s.window / 2, area = (s.window + 1) * s.window;
    const int low = half_window - near, count = 2 * near + 1;
    read_far(curvature, far, masses, own_y, block, near < half_window, outgoing, c, s);
    for (int y = max(0, own_y - near); y <= min(s.height - 1, own_y + near); y++) {
        const int lit_y = outgoing ? y : own_y,
                  v = (outgoing ? own_y - y : y - own_y) + half_window;
        const size_t at = s.lead + ((size_t)lit_y * s.window + v) * (size_t)s.row;
        VEC weights[WINDOW];
        for (int j = 0; j < count; j++) {
            const int e = low + j;
            float lanes[LANES];
            for (int lane = 0; lane < LANES; lane++) {
                const int x = block * LANES + lane - (outgoing ? e - half_window : 0);
                const int label = CLUSTERED ? labels[lit_y * s.label_stride + s.pad + x] : 0;
                lanes[lane] = kernels[(long)label * area + v * s.window + e];
            }
            weights[j] = *(VEC *)lanes;
            if (MASKED) {
                IVEC measured = load_mask(mask + at / LANES, s.window, block, e, outgoing);
                weights[j] = select((VEC)(0), weights[j], measured);
            }
        }
        add_near(curvature, weights, other + y * s.planes * s.stride + s.pad + block * LANES, low,
                 count, outgoing, s);
    }
}

/* One factor's best step: from `own` to `next`, with `other` held. */
INLINE void step_points(const struct parts parts, ARGUMENTS, int outgoing)
{
    for (int r = 0; r < ROWS; r++) {
        const int y = get_global_id(0) * ROWS + r;
        for (int block = 0; y < s.height && block < s.blocks; block++) {
            const long at = (long)y * s.planes * s.stride + s.pad + block * LANES;
            VEC curvature[PAIRS], left[TERMS];
            find_curvature(curvature, mask, labels, kernels, other, far, masses, near, block, y,
                           outgoing, c, s);
            for (int t = 0; t < TERMS; t++) {
                left[t] =
                    ((global const VEC *)parts.gradient)[(block * GROUPS * GROUP + t) * ROWS + r];
            }
            solve(left, curvature, own + at, next + at, sweeps,
                  (IVEC)(s.width - block * LANES) > LANE_NUMBERS, s);
        }
    }
}

/* The step of F: own and next are F, other is H. */
kernel void descend_f(ARGUMENTS)
{
    const struct parts parts = parts_of(scratch, s);
    find_gradient(parts, VALUES, 0, 1, 0);
    step_points(parts, VALUES, 0);
}

/* The step of H: own and next are H, other is F; and twice the objective before it: a sum and its rounding error for
 * each work-item. */
kernel void descend_h(ARGUMENTS)
{
    const struct parts parts = parts_of(scratch, s);
    find_gradient(parts, VALUES, 1, 1, 1);
    step_points(parts, VALUES, 1);
}

/* Twice the objective alone, by the same sums. */
kernel void measure_objective(ARGUMENTS)
{
    find_gradient(parts_of(scratch, s), VALUES, 1, 0, 1);
}

/* next = max(0, now + beta (now - before)), element by element. */
kernel void extrapolate(global const float *now, global const float *before, global float *next,
                        float beta)
{
    const size_t i = get_global_id(0);
    next[i] = fmax(0.0f, now[i] + beta * (now[i] - before[i]));
}
