/* Multiplicative updates of the factors of R ~ (FH) * G with the weights W^2 = 1/G (Peers et al. 2006, section 5.3):
 *
 *     F <- F * (R H^T) / (((FH) * G) H^T)        H <- H * (F^T R) / (F^T ((FH) * G))
 *
 * A work-item updates ROWS neighbouring rows of points of its own factor. Row by row of the other factor it goes through
 * the blocks of LANES points, and for each block through the window's columns dx:
 *
 *     phase 1:  (FH)(dx) for STEPS columns x ROWS rows at a time in registers; V = (FH) g and R go to a small buffer
 *     phase 2:  for GROUP terms at a time: numerator += R * other(x + dx), denominator += V * other(x + dx)
 *
 * layout.cl tells how all of them lie. The number of planes is `terms` rounded up to GROUP. */

#include "layout.cl"

#ifndef ROWS
#define ROWS 2 /* rows of points that share the loads of the other factor */
#endif
#ifndef STEPS
#define STEPS 4 /* window columns at a time in phase 1 */
#endif
#ifndef GROUP
#define GROUP 2 /* terms at a time in phase 2 */
#endif
#ifndef CHUNK
#define CHUNK 64 /* columns in the buffer between the phases */
#endif
#ifndef PREFETCH
#ifdef __clang__
#define PREFETCH                                                                                   \
    1 /* blocks of responses fetched ahead of their use; a whole seventh faster where it exists */
#else
#define PREFETCH 0
#endif
#endif
#ifndef NEGATIVE
#define NEGATIVE 0 /* some responses are below zero */
#endif

/* As struct rule in update.c. */
struct rule {
    int scratch;    /* floats of scratch of one work-item */
    float guard;    /* added to denominators */
    float floor;    /* smallest factor value inside the sample */
    float exponent; /* of the regularised update: 1 is none */
    float unit;     /* of factor values, for the exponent */
};

/* Spread the row dy of each point's kernel into the layout of a row of responses. */
INLINE void spread_kernels(global float *strip, global const float *kernels,
                           global const int *labels, int v, const struct sizes s)
{
    for (int b = 0; b < s.blocks; b++) {
        global float *run = strip + b * s.window * LANES;
        for (int lane = 0; lane < LANES; lane++) {
            global const float *from =
                kernels + ((long)labels[b * LANES + lane] * (s.window + 1) + v) * s.window;
            for (int e = 0; e < s.window; e++) {
                run[e * LANES + lane] = from[e];
            }
        }
    }
}

/* The rows that a work-item's point rows share with one row of the other factor. */
struct rows {
    global const stored *responses[ROWS];
    global const ushort *mask[ROWS];
    global const float *g[ROWS];       /* K values, or with clusters a spread row */
    global const float *inverse[ROWS]; /* 1 / kernel, K values */
    global const float *own[ROWS];
    global const float *other;
};

/* Phase 1 for COUNT columns from e on. Returns the sum of W^2 (R - V)^2 where that is asked for. */
#define PHASE_1(NAME, COUNT)                                                                       \
    INLINE VEC NAME(const struct rows *rows, VEC *v, VEC *w, int b, int e, int outgoing,           \
                    int objective, const struct sizes s)                                           \
    {                                                                                              \
        VEC product[ROWS][COUNT];                                                                  \
        VEC total = 0;                                                                             \
        global const float *other =                                                                \
            rows->other + b * LANES + (outgoing ? s.window / 2 - e : e - s.window / 2);            \
        UNROLL for (int r = 0; r < ROWS; r++)                                                      \
        {                                                                                          \
            UNROLL for (int j = 0; j < COUNT; j++)                                                 \
            {                                                                                      \
                product[r][j] = 0;                                                                 \
            }                                                                                      \
        }                                                                                          \
        for (int t = 0; t < s.terms; t++) {                                                        \
            VEC o[COUNT];                                                                          \
            UNROLL for (int j = 0; j < COUNT; j++)                                                 \
            {                                                                                      \
                o[j] = VLOAD(0, other + t * s.stride + (outgoing ? -j : j));                       \
            }                                                                                      \
            UNROLL for (int r = 0; r < ROWS; r++)                                                  \
            {                                                                                      \
                VEC f = *(global const VEC *)(rows->own[r] + t * s.stride + b * LANES);            \
                UNROLL for (int j = 0; j < COUNT; j++)                                             \
                {                                                                                  \
                    product[r][j] = fma(f, o[j], product[r][j]);                                   \
                }                                                                                  \
            }                                                                                      \
        }                                                                                          \
        UNROLL for (int r = 0; r < ROWS; r++)                                                      \
        {                                                                                          \
            UNROLL for (int j = 0; j < COUNT; j++)                                                 \
            {                                                                                      \
                total += finish_entry(rows, v, w, r, b, e + j, j, product[r][j], outgoing,         \
                                      objective, s);                                               \
            }                                                                                      \
        }                                                                                          \
        return total;                                                                              \
    }

/* V and R of one vector of entries, masked, into the buffers at column j. */
INLINE VEC finish_entry(const struct rows *rows, VEC *v, VEC *w, int r, int b, int e, int j,
                        VEC product, int outgoing, int objective, const struct sizes s)
{
    VEC response = load_entry(rows->responses[r], s.window, b, e, outgoing);
    VEC error = 0;
    VEC g;
    if (CLUSTERED) {
        g = load_floats(rows->g[r], s.window, b, e, outgoing);
    } else {
        g = (VEC)(rows->g[r][e]);
    }
    VEC value = product * g;
    if (MASKED) {
        IVEC measured = load_mask(rows->mask[r], s.window, b, e, outgoing);
        response = select((VEC)(0), response, measured);
        value = select((VEC)(0), value, measured);
    }
    if (objective) {
        VEC difference = response - value;
        if (CLUSTERED) {
            error = difference * difference / fmax(g, (VEC)(FLT_MIN));
        } else {
            error = difference * difference * rows->inverse[r][e];
        }
    }
    if (NEGATIVE) {
        VEC positive = fmax(response, (VEC)(0));
        value += positive - response;
        response = positive;
    }
    v[j * ROWS + r] = value;
    w[j * ROWS + r] = response;
    return error;
}

PHASE_1(phase_1_steps, STEPS)
PHASE_1(phase_1_one, 1)

/* Phase 2 for one group of terms and `count` columns from e on. sums: [GROUP][ROWS][numerator, denominator]. */
INLINE void phase_2(const struct rows *rows, const VEC *v, const VEC *w, global VEC *sums, int b,
                    int e, int count, int t, int outgoing, const struct sizes s)
{
    VEC numerator[GROUP][ROWS], denominator[GROUP][ROWS];
    global const float *other =
        rows->other + t * s.stride + b * LANES + (outgoing ? s.window / 2 - e : e - s.window / 2);
    UNROLL for (int k = 0; k < GROUP; k++)
    {
        UNROLL for (int r = 0; r < ROWS; r++)
        {
            numerator[k][r] = sums[(k * ROWS + r) * 2];
            denominator[k][r] = sums[(k * ROWS + r) * 2 + 1];
        }
    }
    for (int j = 0; j < count; j++) {
#if PREFETCH
        for (int r = 0; t == 0 && r < ROWS; r++) {
            global const stored *next =
                rows->responses[r] + ((b + PREFETCH) * s.window + e + j) * LANES;
            __builtin_prefetch((const void *)(size_t)next);
        }
#endif
        UNROLL for (int k = 0; k < GROUP; k++)
        {
            VEC o = VLOAD(0, other + k * s.stride + (outgoing ? -j : j));
            UNROLL for (int r = 0; r < ROWS; r++)
            {
                numerator[k][r] = fma(w[j * ROWS + r], o, numerator[k][r]);
                denominator[k][r] = fma(v[j * ROWS + r], o, denominator[k][r]);
            }
        }
    }
    UNROLL for (int k = 0; k < GROUP; k++)
    {
        UNROLL for (int r = 0; r < ROWS; r++)
        {
            sums[(k * ROWS + r) * 2] = numerator[k][r];
            sums[(k * ROWS + r) * 2 + 1] = denominator[k][r];
        }
    }
}

/* One row of the other factor against all blocks. */
INLINE VEC sweep(const struct rows *rows, global float *sums, int outgoing, int update,
                 int objective, const struct sizes s)
{
    VEC v[CHUNK * ROWS], w[CHUNK * ROWS];
    VEC total = 0;
    for (int b = 0; b < s.blocks; b++) {
        VEC block_total = 0;
        /* Columns that reach points of the row: the others' x lie beyond its ends for all lanes. */
        const int left = b * LANES + LANES - 1, right = s.width - 1 - b * LANES,
                  half_window = s.window / 2;
        const int first = max(0, half_window - (outgoing ? right : left));
        const int end = min(s.window, half_window + 1 + (outgoing ? left : right));
        for (int e = first; e < end; e += CHUNK) {
            int count = min(CHUNK, end - e), j = 0;
            for (; j + STEPS <= count; j += STEPS) {
                block_total += phase_1_steps(rows, v + j * ROWS, w + j * ROWS, b, e + j, outgoing,
                                             objective, s);
            }
            for (; j < count; j++) {
                block_total +=
                    phase_1_one(rows, v + j * ROWS, w + j * ROWS, b, e + j, outgoing, objective, s);
            }
            for (int t = 0; update && t < s.planes; t += GROUP) {
                global VEC *group = (global VEC *)(sums + (b * s.planes + t) * ROWS * 2 * LANES);
                phase_2(rows, v, w, group, b, e, count, t, outgoing, s);
            }
        }
        total += block_total;
    }
    return total;
}

INLINE float add_lanes(VEC total)
{
    float lanes[LANES], sum = 0;
    *(VEC *)lanes = total;
    for (int i = 0; i < LANES; i++) {
        sum += lanes[i];
    }
    return sum;
}

/* Multiply the item's rows by numerator / denominator. */
INLINE void apply(global float *own, global const float *sums, int first, const struct rule rule,
                  const struct sizes s)
{
    for (int r = 0; r < ROWS && first + r < s.height; r++) {
        for (int b = 0; b < s.blocks; b++) {
            IVEC inside = (IVEC)(s.width - b * LANES) > LANE_NUMBERS;
            for (int t = 0; t < s.terms; t++) {
                global VEC *value = (global VEC *)(own + ((first + r) * s.planes + t) * s.stride +
                                                   s.pad + b * LANES);
                global const VEC *pair =
                    (global const VEC *)sums + ((b * s.planes + t) * ROWS + r) * 2;
                VEC next = *value * pair[0] / (pair[1] + rule.guard);
                if (rule.exponent != 1) {
                    next = rule.unit * pow(next / rule.unit, (VEC)(rule.exponent));
                }
                *value = select((VEC)(0), fmax(next, (VEC)(rule.floor)), inside);
            }
        }
    }
}

/* The update of one factor, the objective before it, or both. objectives: [items][window + ROWS - 1], one sum of
 * W^2 (R - V)^2 for each row of the other factor. */
INLINE void update(global const stored *responses, global const ushort *mask,
                   global const int *labels, global const float *kernels,
                   global const float *inverses, global float *own, global const float *other,
                   global float *scratch, global float *objectives, const struct sizes s,
                   const struct rule rule, int outgoing, int change, int objective)
{
    const int item = get_global_id(0), first = item * ROWS, half_window = s.window / 2;
    const int stop = min(s.height - 1, first + ROWS - 1 + half_window);
    const size_t zeros = (size_t)s.lead + (size_t)s.height * s.window * s.row + s.lead;
    global float *sums = scratch + (size_t)item * rule.scratch;
    global float *strips = sums + s.blocks * s.planes * ROWS * 2 * LANES; /* where CLUSTERED */
    int step = 0;
    for (int i = 0; change && i < s.blocks * s.planes * ROWS * 2 * LANES; i++) {
        sums[i] = 0;
    }
    for (int y = max(0, first - half_window); y <= stop; y++, step++) {
        struct rows rows;
        rows.other = other + y * s.planes * s.stride + s.pad;
        for (int r = 0; r < ROWS; r++) {
            const int own_y = first + r, lit_y = outgoing ? y : own_y;
            const int v = (outgoing ? own_y - y : y - own_y) + half_window;
            const int used = own_y < s.height && v >= 0 && v < s.window;
            const size_t at =
                used ? s.lead + ((size_t)lit_y * s.window + v) * (size_t)s.row : zeros;
            rows.own[r] = own + own_y * s.planes * s.stride + s.pad;
            rows.responses[r] = responses + at;
            rows.mask[r] = mask + (MASKED ? at / LANES : 0);
            global float *strip = strips + r * (s.row + 2 * s.lead) + s.lead;
            if (CLUSTERED) {
                rows.g[r] = strip;
                spread_kernels(strip, kernels, labels + (used ? lit_y : 0) * s.label_stride + s.pad,
                               used ? v : s.window, s);
            } else {
                rows.g[r] = kernels + (used ? v : s.window) * s.window;
            }
            rows.inverse[r] = inverses + (used ? v : s.window) * s.window;
        }
        VEC total = sweep(&rows, sums, outgoing, change, objective, s);
        if (objective) {
            objectives[item * (s.window + ROWS - 1) + step] = add_lanes(total);
        }
    }
    for (; objective && step < s.window + ROWS - 1; step++) {
        objectives[item * (s.window + ROWS - 1) + step] = 0;
    }
    if (change) {
        apply(own, sums, first, rule, s);
    }
}

#define ARGUMENTS                                                                                  \
    global const stored *responses, global const ushort *mask, global const int *labels,           \
        global const float *kernels, global const float *inverses, global float *own,              \
        global float *other, global float *scratch, global float *objectives,                      \
        const struct sizes s, const struct rule rule

/* The objective of F (own) and H as they are. */
kernel void measure(ARGUMENTS)
{
    update(responses, mask, labels, kernels, inverses, own, other, scratch, objectives, s, rule, 0,
           0, 1);
}

/* The same, and the update of F (own). */
kernel void update_f_measured(ARGUMENTS)
{
    update(responses, mask, labels, kernels, inverses, own, other, scratch, objectives, s, rule, 0,
           1, 1);
}

/* The update of F (own). */
kernel void update_f(ARGUMENTS)
{
    update(responses, mask, labels, kernels, inverses, own, other, scratch, objectives, s, rule, 0,
           1, 0);
}

/* The update of H (own); other is F. */
kernel void update_h(ARGUMENTS)
{
    update(responses, mask, labels, kernels, inverses, own, other, scratch, objectives, s, rule, 1,
           1, 0);
}
