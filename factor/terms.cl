/* Steps of the model with a kernel per term, R(x, d) ~ sum_t own_t(x) g_t(d) other_t(x + d): the method "terms".
 *
 * A work-item of `visit` takes the LANES points of a block. For each row of the other planes it goes through the
 * window's columns, CHUNK at a time:
 *
 *     phase 1:  g other of all terms into a small buffer, and the weighted residual V (R - sum own g other)
 *     phase 2:  gradient += residual * (g other) for all terms
 *     phase 3:  A += V (g other) (g other)^T for all pairs of terms, where that is asked for. Far from the centre it
 *               changes little from step to step, and only shapes them: an earlier one does
 *
 * with V = scale(d) (near(x) + far(x + d)). `descend` finds each point's best step from gradient and A. Both are kept apart
 * for entries within `reach` rows and columns of the centre, where nearly all light is, and for those beyond: most steps
 * visit the first alone, and carry the gradient of the others on by their A.
 *
 * The normal equations of the kernels' values at an entry d of the window are sums over all points of V p_t p_s and
 * V R p_t, p_t(x) = own_t(x) other_t(x + d). The first are correlations of planes, scale(d) (near P * Q + P * far Q) with
 * P = own_t own_s and Q = other_t other_s, the same for all channels: `multiply` makes the planes of a few pairs of terms,
 * `correlate` the sums, each work-item those of a tile of DOWN x ACROSS distances. `lack` sums what was not measured and
 * so is too much in them, `sides` makes the second. layout.cl tells how all lies; the centre of the window is left out
 * everywhere. */

#include "layout.cl"

#ifndef TERMS
#define TERMS 8
#endif
#ifndef CHUNK
#define CHUNK 8 /* columns of the window at a time */
#endif
#ifndef SIDE
#define SIDE 4 /* columns whose residuals are found together */
#endif
#ifndef DOWN
#define DOWN 3 /* rows and columns of the window of a work-item of correlate */
#endif
#ifndef ACROSS
#define ACROSS 4
#endif
#ifndef COLUMNS
#define COLUMNS 4 /* columns of the window whose sums sides keeps in registers */
#endif
#ifndef WINDOW
#define WINDOW 49 /* columns of the window */
#endif
#ifndef PREFETCH
#ifdef __clang__
#define PREFETCH 1 /* fetch the responses of the next row ahead of their use */
#else
#define PREFETCH 0
#endif
#endif
#define TILES   ((WINDOW + COLUMNS - 1) / COLUMNS)
#define STRETCH 8 /* blocks that sides takes at a time */
#define VSTORE  JOIN(vstore, LANES)
#ifdef __clang__
typedef VEC loose __attribute__((aligned(4)));
#define LOOSE(from) (*(global const loose *)(from)) /* one load where VLOAD may take several */
#else
#define LOOSE(from) VLOAD(0, from)
#endif
#define PADDED ((TERMS + 1) / 2 * 2) /* terms are taken in twos */
#define NEAR   3                     /* entries so near the centre have a part of A to themselves */
#define AROUND 2                     /* of `step`: A of these */
#define MIDDLE 4                     /* of others within reach */
#define FAR    8                     /* of all others */
#define PAIRS  (TERMS * (TERMS + 1) / 2)
#define SQUARE (PADDED * PADDED)

/* Terms whose sums are kept in registers together. */
#define GROUPS ((PADDED + 9) / 10)
#define GROUP  ((PADDED + GROUPS - 1) / GROUPS)

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

/* Columns of the window up to `most` from the centre that reach points of the row: [*first, *end). */
INLINE void find_columns(int block, int most, int *first, int *end, const struct sizes s)
{
    const int left = block * LANES + LANES - 1, right = s.width - 1 - block * LANES;
    *first = s.window / 2 - min(most, left);
    *end = s.window / 2 + 1 + min(most, right);
}

/* The weight of entry e of a block of row y and whether it was measured; 0 at the centre. */
INLINE VEC weight_of(global const ushort *mask, global const float *scales, VEC near,
                     global const float *far, int v, int e, int block, const struct sizes s)
{
    VEC weight = scales[v * s.window + e] * (near + LOOSE(far + e - s.window / 2));
    if (MASKED) {
        weight = select((VEC)(0), weight, load_mask(mask, s.window, block, e, 0));
    }
    return v == s.window / 2 && e == s.window / 2 ? (VEC)(0) : weight;
}

/* What a block of points holds while its entries pass. */
struct held {
    VEC own[TERMS], near;
    VEC gradient[2 * PADDED];   /* of entries within reach, and beyond */
    VEC shaped[CHUNK * PADDED]; /* g other, [column][term] */
    VEC residual[CHUNK], weight[CHUNK];
};

/* Phase 1 of `many` columns side by side from column j of the chunk on. Returns the sum of squares. */
INLINE VEC find_some(struct held *h, global const stored *responses, global const ushort *mask,
                     global const float *kernels, global const float *scales,
                     global const float *other, global const float *far, int v, int e, int j,
                     int block, const int many, const struct sizes s)
{
    global const float *g = kernels + (size_t)(v * s.window + e) * TERMS;
    global const float *there = other + (e - s.window / 2);
  private
    VEC *to = h->shaped + (size_t)j * PADDED;
    VEC model[SIDE], total = 0;
    UNROLL for (int i = 0; i < many; i++)
    {
        model[i] = 0;
    }
    UNROLL for (int t = 0; t < TERMS; t++)
    {
        UNROLL for (int i = 0; i < many; i++)
        {
            VEC shaped = g[i * TERMS + t] * LOOSE(there + i);
            to[i * PADDED + t] = shaped;
            model[i] = fma(h->own[t], shaped, model[i]);
        }
        there += s.stride;
    }
    UNROLL for (int i = 0; i < many; i++)
    {
        VEC weight = weight_of(mask, scales, h->near, far, v, e + i, block, s);
        VEC miss = load_entry(responses, s.window, block, e + i, 0) - model[i];
        h->weight[j + i] = weight;
        h->residual[j + i] = weight * miss;
        total = fma(h->residual[j + i], miss, total);
    }
    return total;
}

/* Phase 1. Returns the sum of squares. */
INLINE VEC find_residuals(struct held *h, global const stored *responses, global const ushort *mask,
                          global const float *kernels, global const float *scales,
                          global const float *other, global const float *far, int v, int first,
                          int count, int block, const struct sizes s)
{
    VEC total = 0;
    int j = 0;
    for (; j + SIDE <= count; j += SIDE) {
        total += find_some(h, responses, mask, kernels, scales, other, far, v, first + j, j, block,
                           SIDE, s);
    }
    for (; j < count; j++) {
        total += find_some(h, responses, mask, kernels, scales, other, far, v, first + j, j, block,
                           1, s);
    }
    return total;
}

/* Phase 2. */
INLINE void add_gradient(struct held *h, private VEC *gradient, int count)
{
    UNROLL for (int first = 0; first < PADDED; first += GROUP)
    {
        VEC sums[GROUP];
        UNROLL for (int i = 0; i < GROUP; i++)
        {
            sums[i] = first + i < PADDED ? gradient[min(first + i, PADDED - 1)] : (VEC)(0);
        }
        for (int j = 0; j < count; j++) {
            const VEC residual = h->residual[j];
          private
            const VEC *shaped = h->shaped + (size_t)j * PADDED;
            UNROLL for (int i = 0; i < GROUP; i++)
            {
                sums[i] = fma(residual, shaped[min(first + i, PADDED - 1)], sums[i]);
            }
        }
        UNROLL for (int i = 0; i < GROUP; i++)
        {
            if (first + i < PADDED) {
                gradient[first + i] = sums[i];
            }
        }
    }
}

/* Rows t ... t + many - 1 of phase 3. */
INLINE void add_rows(global VEC *curvature, const struct held *h, int count, int t, const int many)
{
    VEC weighted[CHUNK * 4];
    for (int j = 0; j < count; j++) {
        UNROLL for (int i = 0; i < many; i++)
        {
            weighted[j * 4 + i] = h->weight[j] * h->shaped[j * PADDED + t + i];
        }
    }
    for (int s = 0; s < t + many; s += 2) {
        global VEC *at = curvature + t * PADDED + s;
        VEC left[4], right[4];
        UNROLL for (int i = 0; i < many; i++)
        {
            left[i] = at[i * PADDED];
            right[i] = at[i * PADDED + 1];
        }
        for (int j = 0; j < count; j++) {
          private
            const VEC *shaped = h->shaped + (size_t)j * PADDED + s, *w = weighted + (size_t)j * 4;
            UNROLL for (int i = 0; i < many; i++)
            {
                left[i] = fma(w[i], shaped[0], left[i]);
                right[i] = fma(w[i], shaped[1], right[i]);
            }
        }
        UNROLL for (int i = 0; i < many; i++)
        {
            at[i * PADDED] = left[i];
            at[i * PADDED + 1] = right[i];
        }
    }
}

/* Phase 3: the lower triangle of curvature[PADDED][PADDED], in tiles of 4 x 2. */
INLINE void add_curvature(global VEC *curvature, const struct held *h, int count)
{
    int t = 0;
    for (; t + 4 <= PADDED; t += 4) {
        add_rows(curvature, h, count, t, 4);
    }
    if (t < PADDED) {
        add_rows(curvature, h, count, t, 2);
    }
}

/* Which part of gradient and curvature an entry belongs to, and the first column to the right that belongs to another; what
 * is within reach is one where A is not asked for. */
INLINE int part_of(int v, int e, int reach, int step, int end, int *stop, const struct sizes s)
{
    const int half_window = s.window / 2, column = e - half_window;
    const int row = (int)abs(v - half_window), across = (int)abs(column);
    const int split = row <= NEAR && (step & (AROUND | MIDDLE));
    if (split && across <= NEAR) {
        *stop = min(end, half_window + NEAR + 1);
        return 0;
    }
    if (row <= reach && across <= reach) {
        *stop = min(end, split && column < 0 ? half_window - NEAR : half_window + reach + 1);
        return 1;
    }
    *stop = min(end, row <= reach && column < 0 ? half_window - reach : end);
    return 2;
}

/* One channel's part of gradient [y][block][2][PADDED], that of entries within `reach` and beyond, and curvature
 * [y][block][3][PADDED][PADDED], that of entries near the centre, of others within reach, and of those beyond, of every
 * point, begun anew or (`more`) added to what is there, and twice the sum of V miss^2 as a sum and its rounding error for
 * each item. Entries up to `most` from the centre are visited; where that is no farther than `reach` what is kept of those
 * beyond stays. step: 0, 1, or with the parts of A. Items: (block, y). */
kernel void visit(global const stored *responses, global const ushort *mask,
                  global const float *kernels, global const float *scales, global const float *own,
                  global const float *other, global const float *near, global const float *far,
                  global float *gradient, global float *curvature, global float *sums, int more,
                  int step, int most, int reach, const struct sizes s)
{
    const int block = get_global_id(0), y = get_global_id(1), half_window = s.window / 2;
    const size_t item = (size_t)y * s.blocks + block;
    global VEC *to = (global VEC *)gradient + item * 2 * PADDED;
    global VEC *squares = (global VEC *)curvature + item * 3 * SQUARE;
    const int x = s.pad + block * LANES, slopes = (most > reach ? 2 : 1) * PADDED;
    const int summed[] = {step & AROUND, step & MIDDLE, step & FAR};
    struct held h;
    VEC total = 0, lost = 0;
    int first, end;
    find_columns(block, most, &first, &end, s);
    for (int t = 0; t < TERMS; t++) {
        h.own[t] = VLOAD(0, own + ((size_t)y * s.planes + t) * s.stride + x);
    }
    for (int t = 0; t < 2 * PADDED; t++) {
        h.gradient[t] = more ? to[t] : (VEC)(0);
    }
    for (int i = 0; i < CHUNK * PADDED; i++) {
        h.shaped[i] = 0;
    }
    for (int i = 0; step && !more && i < 3 * SQUARE; i++) {
        squares[i] = summed[i / SQUARE] ? (VEC)(0) : squares[i];
    }
    h.near = VLOAD(0, near + (size_t)y * s.stride + x);
    for (int v = half_window - min(most, y); v < half_window + 1 + min(most, s.height - 1 - y);
         v++) {
        const int there = y + v - half_window;
        const size_t at = s.lead + ((size_t)y * s.window + v) * (size_t)s.row;
        VEC row = 0;
#if PREFETCH
        global const stored *next =
            responses + at + s.row + ((size_t)block * s.window + first) * LANES;
        for (int i = 0; i < (end - first) * LANES; i += 64 / (int)sizeof(stored)) {
            __builtin_prefetch((const void *)(size_t)(next + i));
        }
#endif
        int count;
        for (int e = first; e < end; e += count) {
            int stop;
            const int part = part_of(v, e, reach, step, end, &stop, s);
            count = min(CHUNK, stop - e);
            row += find_residuals(&h, responses + at, mask + (MASKED ? at / LANES : 0), kernels,
                                  scales, other + (size_t)there * s.planes * s.stride + x,
                                  far + (size_t)there * s.stride + x, v, e, count, block, s);
            if (step) {
                add_gradient(&h, h.gradient + (part == 2 ? PADDED : 0), count);
            }
            if (summed[part]) {
                add_curvature(squares + part * SQUARE, &h, count);
            }
        }
        add_exactly(&total, &lost, row);
    }
    for (int t = 0; step && t < slopes; t++) {
        to[t] = h.gradient[t];
    }
    write_sum(sums + item * 2, total, lost);
}

INLINE VEC element(const VEC *square, int t, int u)
{
    return u > t ? square[u * PADDED + t] : square[t * PADDED + u];
}

/* The gradient of entries beyond reach belongs to the planes `anchor`: carried on to `own`, and what these entries then
 * have of the objective beside what they had, as a sum and its rounding error for each item of `sums`. */
INLINE void carry_on(VEC *left, const VEC *value, global const float *anchor,
                     global const VEC *slope, global const VEC *beyond, float damping,
                     global float *sums, const struct sizes s)
{
    VEC moved[TERMS], square[SQUARE], total = 0;
    for (int i = 0; i < SQUARE; i++) {
        square[i] = beyond[i];
    }
    for (int t = 0; t < TERMS; t++) {
        moved[t] = value[t] - VLOAD(0, anchor + (size_t)t * s.stride);
    }
    for (int t = 0; t < TERMS; t++) {
        VEC bent = 0;
        for (int u = 0; u < TERMS; u++) {
            bent = fma(element(square, t, u), moved[u], bent);
        }
        left[t] += slope[t] - damping * bent;
        total += moved[t] * (0.5f * damping * bent - slope[t]);
    }
    write_sum(sums, total, (VEC)(0));
}

/* The best step that is not negative, from `own` to `next`: coordinate descent on
 * 1/2 damping z^T A z - gradient^T z, z the change of a point's values. Items: (block, y). */
kernel void descend(global const float *own, global const float *anchor,
                    global const float *gradient, global const float *curvature, global float *next,
                    global float *sums, float damping, int sweeps, const struct sizes s)
{
    const int block = get_global_id(0), y = get_global_id(1);
    const size_t item = (size_t)y * s.blocks + block;
    global const VEC *from = (global const VEC *)gradient + item * 2 * PADDED;
    global const VEC *square = (global const VEC *)curvature + item * 3 * SQUARE;
    VEC whole[SQUARE];
    const size_t at = (size_t)y * s.planes * s.stride + s.pad + block * LANES;
    VEC left[TERMS], value[TERMS], trace = 0;
    for (int i = 0; i < SQUARE; i++) {
        whole[i] = square[i] + square[SQUARE + i] + square[2 * SQUARE + i];
    }
    for (int t = 0; t < TERMS; t++) {
        left[t] = from[t];
        value[t] = VLOAD(0, own + at + (size_t)t * s.stride);
        trace += whole[t * PADDED + t];
    }
    carry_on(left, value, anchor + at, from + PADDED, square + 2 * SQUARE, damping, sums + item * 2,
             s);
    const VEC ridge = 1e-6f * trace;
    for (int sweep = 0; sweep < sweeps; sweep++) {
        for (int t = 0; t < TERMS; t++) {
            VEC own_curvature = fma((VEC)(damping), whole[t * PADDED + t], ridge);
            VEC best = fmax((VEC)(0), value[t] + left[t] / fmax(own_curvature, (VEC)(FLT_MIN)));
            best = select(value[t], best, own_curvature > FLT_MIN);
            VEC change = damping * (best - value[t]);
            left[t] -= ridge * (best - value[t]);
            value[t] = best;
            for (int u = 0; u < TERMS; u++) {
                left[u] = fma(-element(whole, t, u), change, left[u]);
            }
        }
    }
    const IVEC inside = (IVEC)(s.width - block * LANES) > LANE_NUMBERS;
    for (int t = 0; t < TERMS; t++) {
        VSTORE(select((VEC)(0), value[t], inside), 0, next + at + (size_t)t * s.stride);
    }
}

/* next = max(0, now + share (now - before)), element by element. */
kernel void extrapolate(global const float *now, global const float *before, global float *next,
                        float share)
{
    const size_t i = get_global_id(0);
    next[i] = fmax(0.0f, now[i] + share * (now[i] - before[i]));
}

INLINE float sum_lanes(VEC value)
{
    float lanes[LANES], sum = 0;
    *(VEC *)lanes = value;
    for (int lane = 0; lane < LANES; lane++) {
        sum += lanes[lane];
    }
    return sum;
}

/* The two terms of a pair, t >= s. */
INLINE void terms_of(int pair, int *t, int *u)
{
    *t = 0;
    while (pair > *t) {
        pair -= ++*t;
    }
    *u = pair;
}

/* Planes of `pair` = first + item: weighted[item][window / 2 + DOWN zeros | height | as many][stride] are near own_t own_s,
 * plain[item][height][stride] other_t other_s. Items: (vectors of a row with its pads, y, item). */
kernel void multiply(global const float *own, global const float *other, global const float *near,
                     global float *weighted, global float *plain, int first, const struct sizes s)
{
    const int x = get_global_id(0) * LANES, y = get_global_id(1), item = get_global_id(2);
    const int guard = s.window / 2 + DOWN;
    const size_t here = (size_t)y * s.planes * s.stride + x;
    int t, u;
    terms_of(first + item, &t, &u);
    VEC p =
        VLOAD(0, own + here + (size_t)t * s.stride) * VLOAD(0, own + here + (size_t)u * s.stride);
    VEC q = VLOAD(0, other + here + (size_t)t * s.stride) *
            VLOAD(0, other + here + (size_t)u * s.stride);
    VSTORE(p * VLOAD(0, near + (size_t)y * s.stride + x), 0,
           weighted + ((size_t)item * (s.height + 2 * guard) + guard + y) * s.stride + x);
    VSTORE(q, 0, plain + ((size_t)item * s.height + y) * s.stride + x);
}

/* correlations[pair][K][K]: the sums over x of weighted(x) plain(x + d), of entries up to `most` from the centre. Items:
 * (tile of columns, tile of rows, item). */
kernel void correlate(global const float *weighted, global const float *plain,
                      global float *correlations, int first, int most, const struct sizes s)
{
    const int item = get_global_id(2), half_window = s.window / 2, guard = half_window + DOWN;
    const int e = half_window - most + get_global_id(0) * ACROSS;
    const int v = half_window - most + get_global_id(1) * DOWN;
    const int begin = max(0, v - half_window);
    const int end = min(s.height, s.height + v - half_window + DOWN - 1);
    global const float *from =
        weighted + ((size_t)item * (s.height + 2 * guard) + guard + half_window - v) * s.stride;
    global const float *there = plain + (size_t)item * s.height * s.stride + e - half_window;
    VEC sums[DOWN * ACROSS], lost[DOWN * ACROSS];
    for (int i = 0; i < DOWN * ACROSS; i++) {
        sums[i] = 0;
        lost[i] = 0;
    }
    for (int block = 0; block < s.blocks; block++) {
        const int x = s.pad + block * LANES;
        VEC column[DOWN * ACROSS], p[DOWN];
        UNROLL for (int i = 0; i < DOWN * ACROSS; i++)
        {
            column[i] = 0;
        }
        UNROLL for (int i = 1; i < DOWN; i++)
        {
            p[i - 1] = VLOAD(0, from + (begin - i) * s.stride + x);
        }
        for (int r = begin; r < end; r++) {
            UNROLL for (int i = DOWN - 1; i > 0; i--)
            {
                p[i] = p[i - 1];
            }
            p[0] = VLOAD(0, from + r * s.stride + x);
            UNROLL for (int j = 0; j < ACROSS; j++)
            {
                const VEC q = VLOAD(0, there + r * s.stride + x + j);
                UNROLL for (int i = 0; i < DOWN; i++)
                {
                    column[i * ACROSS + j] = fma(p[i], q, column[i * ACROSS + j]);
                }
            }
        }
        for (int i = 0; i < DOWN * ACROSS; i++) {
            add_exactly(&sums[i], &lost[i], column[i]);
        }
    }
    for (int i = 0; i < DOWN; i++) {
        for (int j = 0; j < ACROSS; j++) {
            if (v + i <= half_window + most && e + j <= half_window + most) {
                correlations[((size_t)(first + item) * s.window + v + i) * s.window + e + j] =
                    sum_lanes(sums[i * ACROSS + j]);
            }
        }
    }
}

/* V R of a few blocks and columns [first, end) of the window. */
INLINE void weigh_responses(VEC *weighted, global const stored *responses,
                            global const ushort *mask, global const float *near,
                            global const float *far, int block, int blocks, int first, int end,
                            const struct sizes s)
{
    for (int b = 0; b < blocks; b++) {
        const int x = (block + b) * LANES;
        const VEC here = VLOAD(0, near + x);
        for (int e = first; e < end; e++) {
            VEC weight = here + VLOAD(0, far + x + e);
            if (MASKED) {
                weight = select((VEC)(0), weight, load_mask(mask, WINDOW, block + b, e, 0));
            }
            weighted[b * TILES * COLUMNS + e] =
                weight * load_entry(responses, WINDOW, block + b, e, 0);
        }
    }
}

/* For rows v of the window from `top` on and columns up to `most` from the centre: sides[v][e][TERMS], the sums over points
 * of V R p_t, V without its scale. Items: v - top. */
kernel void sides(global const stored *responses, global const ushort *mask,
                  global const float *own, global const float *other, global const float *near,
                  global const float *far, global float *sides, int top, int most,
                  const struct sizes s)
{
    const int v = get_global_id(0) + top, half_window = s.window / 2;
    const int first = (half_window - most) / COLUMNS * COLUMNS, end = half_window + most + 1;
    VEC sums[TERMS * TILES * COLUMNS], lost[TERMS * TILES * COLUMNS], row[TERMS * TILES * COLUMNS];
    VEC weighted[STRETCH * TILES * COLUMNS];
    for (int i = 0; i < TERMS * TILES * COLUMNS; i++) {
        sums[i] = 0;
        lost[i] = 0;
    }
    for (int i = 0; i < STRETCH * TILES * COLUMNS; i++) {
        weighted[i] = 0;
    }
    for (int y = max(0, half_window - v); y < min(s.height, s.height + half_window - v); y++) {
        const int there = y + v - half_window;
        const size_t at = s.lead + ((size_t)y * s.window + v) * (size_t)s.row;
        for (int t = 0; t < TERMS; t++) {
            for (int e = first; e < end + COLUMNS - 1; e++) {
                row[t * TILES * COLUMNS + min(e, TILES * COLUMNS - 1)] = 0;
            }
        }
        for (int block = 0; block < s.blocks; block += STRETCH) {
            const int blocks = min(STRETCH, s.blocks - block);
            weigh_responses(weighted, responses + at, mask + (MASKED ? at / LANES : 0),
                            near + (size_t)y * s.stride + s.pad,
                            far + (size_t)there * s.stride + s.pad - half_window, block, blocks,
                            first, end, s);
            for (int t = 0; t < TERMS; t++) {
                global const float *of_own =
                    own + ((size_t)y * s.planes + t) * s.stride + s.pad + block * LANES;
                global const float *of_other = other + ((size_t)there * s.planes + t) * s.stride +
                                               s.pad + block * LANES - half_window;
                for (int e = first; e < end; e += COLUMNS) {
                    VEC part[COLUMNS];
                    UNROLL for (int j = 0; j < COLUMNS; j++)
                    {
                        part[j] = row[t * TILES * COLUMNS + e + j];
                    }
                    for (int b = 0; b < blocks; b++) {
                        const VEC mine = VLOAD(0, of_own + b * LANES);
                        UNROLL for (int j = 0; j < COLUMNS; j++)
                        {
                            part[j] = fma(mine * weighted[b * TILES * COLUMNS + e + j],
                                          VLOAD(0, of_other + b * LANES + e + j), part[j]);
                        }
                    }
                    UNROLL for (int j = 0; j < COLUMNS; j++)
                    {
                        row[t * TILES * COLUMNS + e + j] = part[j];
                    }
                }
            }
        }
        for (int t = 0; t < TERMS; t++) {
            for (int i = t * TILES * COLUMNS + first; i < t * TILES * COLUMNS + end; i++) {
                add_exactly(&sums[i], &lost[i], row[i]);
            }
        }
    }
    for (int e = first; e < end; e++) {
        for (int t = 0; t < TERMS; t++) {
            sides[((size_t)v * s.window + e) * TERMS + t] =
                sum_lanes(sums[t * TILES * COLUMNS + e]);
        }
    }
}

/* For entries of the window from row `top` and column `left` on: what the correlations have too much, lacks[v][e][PAIRS], the sums of
 * V p_t p_s over points where the entry was not measured; or, where that is most of them, over those where it was, and
 * measured[v][e] = 1 in place of 0. Items: (e - left, v - top). */
kernel void lack(global const ushort *mask, global const float *own, global const float *other,
                 global const float *near, global const float *far, global float *lacks,
                 global int *measured, int top, int left, const struct sizes s)
{
    const int v = get_global_id(1) + top, e = get_global_id(0) + left, half_window = s.window / 2;
    const int begin = max(0, half_window - v), end = min(s.height, s.height + half_window - v);
    const IVEC all = (IVEC)(-1);
    int missing = 0, taken = 0;
    VEC sums[PAIRS], lost[PAIRS];
    for (int i = 0; i < PAIRS; i++) {
        sums[i] = 0;
        lost[i] = 0;
    }
    for (int y = begin; y < end; y++) {
        const size_t at = (s.lead + ((size_t)y * s.window + v) * (size_t)s.row) / LANES;
        for (int block = 0; block < s.blocks; block++) {
            missing += any(load_mask(mask + at, s.window, block, e, 0) != all);
        }
    }
    taken = 2 * missing > (end - begin) * s.blocks;
    for (int y = begin; y < end; y++) {
        const int there = y + v - half_window;
        const size_t at = (s.lead + ((size_t)y * s.window + v) * (size_t)s.row) / LANES;
        VEC row[PAIRS];
        int found = 0;
        for (int block = 0; block < s.blocks; block++) {
            const int x = s.pad + block * LANES;
            const IVEC bits = load_mask(mask + at, s.window, block, e, 0);
            const IVEC chosen = taken ? bits : ~bits;
            if (!any(chosen)) {
                continue;
            }
            for (int i = 0; i < PAIRS && !found; i++) {
                row[i] = 0;
            }
            found = 1;
            VEC weight = VLOAD(0, near + (size_t)y * s.stride + x) +
                         VLOAD(0, far + (size_t)there * s.stride + x + e - half_window);
            weight = select((VEC)(0), weight, chosen);
            VEC product[TERMS];
            for (int t = 0; t < TERMS; t++) {
                product[t] = VLOAD(0, own + ((size_t)y * s.planes + t) * s.stride + x) *
                             VLOAD(0, other + ((size_t)there * s.planes + t) * s.stride + x + e -
                                          half_window);
            }
            for (int t = 0, i = 0; t < TERMS; t++) {
                VEC weighted = weight * product[t];
                for (int u = 0; u <= t; u++, i++) {
                    row[i] = fma(weighted, product[u], row[i]);
                }
            }
        }
        for (int i = 0; i < PAIRS && found; i++) {
            add_exactly(&sums[i], &lost[i], row[i]);
        }
    }
    for (int i = 0; i < PAIRS; i++) {
        lacks[((size_t)v * s.window + e) * PAIRS + i] = sum_lanes(sums[i]);
    }
    measured[v * s.window + e] = taken;
}
