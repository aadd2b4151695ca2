/* Light gathered by 16 receivers at a time: near by, sample by sample and surface point by surface point for each vertex;
 * farther on, from moments of squares for posts (posts.h), whose sums for each term the vertices share and multiply by
 * their H. gather_reference.c is the same in double precision, sample by sample. Short loops over terms and basis
 * kernels are unrolled: only then do their sums stay in registers. What is specialised, by -D: */
#ifndef TERMS4
#define TERMS4 1 /* terms / 4 */
#endif
#ifndef WINDOW
#define WINDOW 3 /* K */
#endif
#ifndef MIXED
#define MIXED 1 /* kernels mixed at a surface point */
#endif
#ifndef ONE_KERNEL
#define ONE_KERNEL 0 /* 1: all surface points have the same */
#endif
#ifndef CLUSTERS
#define CLUSTERS 0 /* kernels from one id to the next, for pairs of clusters */
#endif
#ifndef PER_TERM
#define PER_TERM 0 /* 1: a kernel for each term */
#endif
#ifndef PARTS
#define PARTS 1 /* basis kernels */
#endif
#ifndef WIDTH
#define WIDTH 1 /* of the material, surface points */
#endif
#ifndef HEIGHT
#define HEIGHT 1
#endif
#ifndef MIRROR
#define MIRROR 1 /* 0: tiles repeat */
#endif
#ifndef SAME_SIDE
#define SAME_SIDE 0 /* 1: light does not go through */
#endif
#ifndef POINT_MM
#define POINT_MM 1.0f
#endif

#define HALF_WINDOW (WINDOW / 2 + 1)
#define LANES 16
#define LINKS 9 /* posts of a receiver */
#define FARTHEST 1e15f /* surface points or mm: in place of infinity, which fast mathematics does not know */
#define MOMENT ((PER_TERM ? 1 : PARTS) * TERMS4) /* float16s */
#define INLINE __attribute__((always_inline))
#define LANE(vector, type, j) (((const type *)&(vector))[j])

/* 16 receivers, field by field. */
struct bundle {
    float16 px, py, pz, ax, ay, az, bx, by, bz, nx, ny, nz, x, y, flip_x, flip_y;
    int16 chart, column, index;
    float low[4], high[4]; /* box around them; the last ones are 0 */
};

struct source {
    float px, py, pz, x, y, red, green, blue, nx, ny, nz, middle[3];
    int chart;
    uint texel;
};

/* A ring of kernels: within which distances (mm) it has light; the side of the tables; squares are of 2^level points.
 * Where tables are not windowed: it rises from and falls from a distance (points), over that below 1 / steepness. */
struct ring {
    float inner_square, outer_square;
    int side, level;
    float rise_from, rise_steepness, fall_from, fall_steepness;
};

/* Where the kernels are read: the offset's whole part and fraction in a table. */
struct offsets {
    float16 dx, dy, fx, fy, distance; /* mm */
    int16 inside, place, foreign;
};

INLINE int wrap(int i, int size)
{
    int period = MIRROR ? 2 * size : size;
    int inside = i % period;
    inside += inside < 0 ? period : 0;
    return inside < size ? inside : 2 * size - 1 - inside;
}

INLINE struct offsets offsets_from(const struct bundle *to, __global const struct source *from, const struct ring *ring)
{
    struct offsets o;
    float16 ox = to->px - from->px, oy = to->py - from->py, oz = to->pz - from->pz;
    float16 square = fma(ox, ox, fma(oy, oy, oz * oz));
    o.inside = (square >= ring->inner_square) & (square < ring->outer_square);
    if (SAME_SIDE) {
        o.inside &= fma(to->nx, from->nx, fma(to->ny, from->ny, to->nz * from->nz)) > 0;
    }
    if (!any(o.inside)) {
        return o;
    }
    float16 a = fma(ox, to->ax, fma(oy, to->ay, oz * to->az));
    float16 b = fma(ox, to->bx, fma(oy, to->by, oz * to->bz));
    float16 across = fma(a, a, b * b);
    /* Else straight through the material: no direction is better than another. */
    int16 along = across > 1e-10f * square;
    a = select((float16)1, a, along);
    b = select((float16)0, b, along);
    o.distance = sqrt(square);
    float16 scale = o.distance * rsqrt(select((float16)1, across, along)) * (1 / POINT_MM);
    o.dx = a * scale;
    o.dy = b * scale;
    float half_side = ring->side / 2, last = 2 * half_side * 0x1.fffffep-1f; /* just inside the table */
    float16 u = fma(to->flip_x, o.dx, (float16)half_side), v = fma(to->flip_y, o.dy, (float16)half_side);
    o.inside &= (u > 0) & (u < 2 * half_side) & (v > 0) & (v < 2 * half_side);
    u = clamp(u, (float16)0, (float16)last); /* lanes outside read something, too */
    v = clamp(v, (float16)0, (float16)last);
    int16 column = convert_int16(u), row = convert_int16(v);
    o.fx = u - convert_float16(column);
    o.fy = v - convert_float16(row);
    o.place = row * ring->side + column;
    o.foreign = (to->chart != from->chart) | (fabs(to->x - from->x) > HALF_WINDOW) |
                (fabs(to->y - from->y) > HALF_WINDOW);
    return o;
}

/* From 0 to 1, as levels.c has it. */
INLINE float16 rise(float16 r, float from, float steepness)
{
    float16 t = clamp((r - from) * steepness, (float16)0, (float16)1);
    return t * t * t * fma(t, fma((float16)6, t, (float16)-15), (float16)10);
}

/* What a ring has of a source by its distance in mm. */
INLINE float16 window(float16 distance, const struct ring *ring)
{
    float16 r = distance * (1 / POINT_MM);
    float16 share = (float16)1 - rise(r, ring->fall_from, ring->fall_steepness);
    if (any((r - ring->rise_from) * ring->rise_steepness < 1)) { /* few sources are as near */
        share -= (float16)1 - rise(r, ring->rise_from, ring->rise_steepness);
    }
    return share;
}

/* From where a sample is told apart by rings. */
INLINE float16 distance_by_middle(const struct bundle *to, __global const struct source *from)
{
    float16 x = to->px - from->middle[0], y = to->py - from->middle[1], z = to->pz - from->middle[2];
    return sqrt(fma(x, x, fma(y, y, z * z)));
}

/* A bit for each lane; loops over those that are set take no branch that cannot be foreseen for the others. */
INLINE uint bits_of(int16 lanes)
{
    int16 bits = lanes & (int16)(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768);
    int8 by8 = bits.lo | bits.hi;
    int4 by4 = by8.lo | by8.hi;
    return as_uint(by4.x | by4.y | by4.z | by4.w);
}

/* Takes the lowest lane from the set. */
INLINE int take_lane(uint *set)
{
    int lane = 31 - (int)clz(*set & (0 - *set));
    *set &= *set - 1;
    return lane;
}

/* Whether a source is too far from all of the receivers. */
INLINE bool out_of_reach(const struct bundle *to, __global const struct source *from, const struct ring *ring)
{
    float4 place = (float4)(from->px, from->py, from->pz, 0);
    float4 away = fmax(fmax(vload4(0, to->low) - place, place - vload4(0, to->high)), (float4)0);
    return dot(away, away) >= ring->outer_square;
}

INLINE float4 fold(float16 v)
{
    float8 half_sum = v.lo + v.hi;
    return half_sum.lo + half_sum.hi;
}

INLINE float16 between16(__global const float16 *g, int right, int down, float fx, float fy)
{
    float16 upper = fma(g[right] - g[0], (float16)fx, g[0]);
    float16 lower = fma(g[down + right] - g[down], (float16)fx, g[down]);
    return fma(lower - upper, (float16)fy, upper);
}

/* Of entries of which the next along x follows: both rows at once. */
INLINE float4 between4(__global const float4 *g, int down, float fx, float fy)
{
    float8 upper = vload8(0, (__global const float *)g), lower = vload8(0, (__global const float *)(g + down));
    float8 row = fma(lower - upper, (float8)fy, upper);
    return fma(row.hi - row.lo, (float4)fx, row.lo);
}

/* What one receiver sees of one source. */
struct sight {
    uint texel;
    int column, place, side;
    float fx, fy;
};

/* sum_t F H G by colour. */
INLINE float4 response(const struct sight *at, __global const float16 *factors, __global const float16 *h,
                __global const float4 *kernels, __global const uint *ids, __global const float *weights)
{
    __global const float16 *f = factors + (size_t)at->texel * TERMS4;
    float16 sum = 0;
#if PER_TERM
    __global const float16 *g = (__global const float16 *)kernels + (size_t)at->place * TERMS4;
#pragma unroll
    for (int k = 0; k < TERMS4; k++) {
        float16 value = between16(g + k, TERMS4, at->side * TERMS4, at->fx, at->fy);
        sum = fma(f[k] * h[k], value, sum);
    }
    return fold(sum);
#else
    float4 value = 0;
#pragma unroll
    for (int k = 0; k < TERMS4; k++) {
        sum = fma(f[k], h[k], sum);
    }
    for (int a = 0; a < MIXED; a++) {
        size_t id =
            ONE_KERNEL ? 0 : ids[(size_t)at->texel * MIXED + a] * (CLUSTERS ? CLUSTERS : 1) + at->column;
        size_t entry = id * (at->side * at->side) + at->place;
        float4 part = between4(kernels + entry, at->side, at->fx, at->fy);
        value += (MIXED > 1 ? weights[(size_t)at->texel * MIXED + a] : 1.0f) * part;
    }
    return fold(sum) * value;
#endif
}

/* Row and column of the surface point that receiver j sees in the direction of a source that is elsewhere in the
 * texture. */
INLINE int2 seen_point(const struct bundle *to, const struct offsets *o, int j)
{
    return (int2)(wrap(convert_int_rtn(LANE(to->y, float, j) - LANE(o->dy, float, j)), HEIGHT),
                  wrap(convert_int_rtn(LANE(to->x, float, j) - LANE(o->dx, float, j)), WIDTH));
}

/* What a source that is near in the texture, too, gives those that see it: its F and kernel are read once for all. */
INLINE void add_own(const struct bundle *to, __global const struct source *from, const struct offsets *o, uint seeing,
                    float16 share, int side, float4 *sums, __global const float16 *factors, __global const float16 *h,
                    __global const float4 *kernels, __global const uint *ids)
{
    float4 flux = (float4)(from->red, from->green, from->blue, 0);
    size_t id = ONE_KERNEL ? 0 : ids[from->texel] * (CLUSTERS ? CLUSTERS : 1);
    __global const float4 *table = kernels + id * (size_t)(side * side);
    float16 f[TERMS4];
#pragma unroll
    for (int k = 0; k < TERMS4; k++) {
        f[k] = factors[(size_t)from->texel * TERMS4 + k] * (float16)(flux, flux, flux, flux);
    }
    for (uint set = seeing; set != 0;) {
        int j = take_lane(&set);
        float16 sum = f[0] * h[j * TERMS4];
#pragma unroll
        for (int k = 1; k < TERMS4; k++) {
            sum = fma(f[k], h[j * TERMS4 + k], sum);
        }
        size_t place = LANE(o->place, int, j) + (CLUSTERS ? LANE(to->column, int, j) * (side * side) : 0);
        float4 value = between4(table + place, side, LANE(o->fx, float, j), LANE(o->fy, float, j));
        sums[j] = fma(fold(sum), value * LANE(share, float, j), sums[j]);
    }
}

/* Runs of sources in a bundle's reach. */
struct runs {
    __global const uint *starts, *list;
    __global const struct source *sources;
    uint count; /* of the sources */
};

/* What samples, or surface points' light (`own`: it is at its own middle), give each vertex of a bundle. */
INLINE void add_near(const struct bundle *to, size_t index, const struct runs *runs, bool own, const struct ring *ring,
              float4 *sums, __global const float16 *factors, __global const float16 *h, __global const float4 *kernels,
              __global const uint *ids, __global const float *weights)
{
    for (uint i = runs->starts[index]; i < runs->starts[index + 1]; i++) {
        uint begin = runs->list[i] * LANES, end = min(begin + LANES, runs->count);
        for (uint s = begin; s < end; s++) {
            __global const struct source *from = runs->sources + s;
            if (out_of_reach(to, from, ring)) {
                continue;
            }
            struct offsets o = offsets_from(to, from, ring);
            uint seeing = bits_of(o.inside);
            if (seeing == 0) {
                continue;
            }
            bool windowed = ring->rise_from > 0 || ring->fall_from < FARTHEST;
            float16 share = windowed ? window(own ? o.distance : distance_by_middle(to, from), ring) : (float16)1;
#if !PER_TERM && MIXED == 1
            if (!any(o.inside & o.foreign)) {
                add_own(to, from, &o, seeing, share, ring->side, sums, factors, h, kernels, ids);
                continue;
            }
#endif
            float4 flux = (float4)(from->red, from->green, from->blue, 0);
            for (uint set = seeing; set != 0;) {
                int j = take_lane(&set);
                struct sight at = {from->texel, LANE(to->column, int, j), LANE(o.place, int, j), ring->side,
                                   LANE(o.fx, float, j), LANE(o.fy, float, j)};
                if (LANE(o.foreign, int, j)) {
                    int2 seen = seen_point(to, &o, j);
                    at.texel = seen.x * WIDTH + seen.y;
                }
                sums[j] += LANE(share, float, j) * flux * response(&at, factors, h + j * TERMS4, kernels, ids, weights);
            }
        }
    }
}

/* The posts' sums around a receiver, in its own place. */
INLINE void interpolate(__global const float16 *posts, __global const uint *links, __global const float *shares,
                 float16 *sums)
{
    for (int i = 0; i < LINKS; i++) {
        __global const float16 *post = posts + (size_t)links[i] * TERMS4;
#pragma unroll
        for (int k = 0; k < TERMS4; k++) {
            sums[k] = fma(post[k], (float16)shares[i], sums[k]);
        }
    }
}

/* What one square's light gives one post, term by term. */
INLINE void add_square(float16 *sums, __global const float16 *moment, float4 flux, __global const float4 *kernels, int side,
                float fx, float fy)
{
#if PER_TERM
#pragma unroll
    for (int k = 0; k < TERMS4; k++) {
        float16 value = between16((__global const float16 *)kernels + k, TERMS4, side * TERMS4, fx, fy);
        sums[k] = fma(value * (float16)(flux, flux, flux, flux), moment[k], sums[k]);
    }
#else
    float weights[4] = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
    __global const float4 *corners[4] = {kernels, kernels + PARTS, kernels + side * PARTS, kernels + (side + 1) * PARTS};
    float16 own[TERMS4];
#pragma unroll
    for (int k = 0; k < TERMS4; k++) {
        own[k] = sums[k];
    }
#pragma unroll
    for (int r = 0; r < PARTS; r++) {
        float4 value = weights[0] * corners[0][r];
#pragma unroll
        for (int i = 1; i < 4; i++) {
            value = fma(corners[i][r], (float4)weights[i], value);
        }
        value *= flux;
#pragma unroll
        for (int k = 0; k < TERMS4; k++) {
            own[k] = fma((float16)(value, value, value, value), moment[r * TERMS4 + k], own[k]);
        }
    }
#pragma unroll
    for (int k = 0; k < TERMS4; k++) {
        sums[k] = own[k];
    }
#endif
}

/* 16 posts a work item: out[post][TERMS4] is what squares give them, and coarser posts. */
__kernel void gather_squares(uint first, __global const struct bundle *bundles, __global const uint *starts,
                             __global const uint *list, __global const struct source *squares, uint count,
                             __global const float16 *moments, __global const float4 *kernels,
                             __global const float16 *pyramid, struct ring ring, __global const float16 *coarse,
                             __global const uint *links, __global const float *shares, int linked,
                             __global float16 *out)
{
    size_t index = first + get_global_id(0);
    const struct bundle to = bundles[index];
    float16 sums[LANES * TERMS4];
    int columns = ((WIDTH - 1) >> ring.level) + 1;
    for (int j = 0; j < LANES * TERMS4; j++) {
        sums[j] = 0;
    }
    for (uint i = starts[index]; i < starts[index + 1]; i++) {
        uint begin = list[i] * LANES, end = min(begin + LANES, count);
        for (uint s = begin; s < end; s++) {
            __global const struct source *from = squares + s;
            if (out_of_reach(&to, from, &ring)) {
                continue;
            }
            struct offsets o = offsets_from(&to, from, &ring);
            for (uint set = bits_of(o.inside); set != 0;) {
                int j = take_lane(&set);
                __global const float16 *moment = moments + (size_t)s * MOMENT;
                float4 flux = (float4)(1, 1, 1, 0);
                if (LANE(o.foreign, int, j)) {
                    int2 seen = seen_point(&to, &o, j) >> ring.level;
                    moment = pyramid + (size_t)(seen.x * columns + seen.y) * MOMENT;
                    flux = (float4)(from->red, from->green, from->blue, 0);
                }
                size_t table = CLUSTERS ? (size_t)LANE(to.column, int, j) * (ring.side * ring.side) : 0;
                add_square(sums + j * TERMS4, moment, flux,
                           kernels + (table + LANE(o.place, int, j)) * (PER_TERM ? 4 * TERMS4 : PARTS), ring.side,
                           LANE(o.fx, float, j), LANE(o.fy, float, j));
            }
        }
    }
    for (int j = 0; j < LANES; j++) {
        size_t post = LANE(to.index, int, j);
        if (linked) {
            interpolate(coarse, links + post * LINKS, shares + post * LINKS, sums + j * TERMS4);
        }
#pragma unroll
        for (int k = 0; k < TERMS4; k++) {
            out[post * TERMS4 + k] = sums[j * TERMS4 + k];
        }
    }
}

/* 16 vertices a work item: out[vertex] is what leaves there. */
__kernel void gather(uint first, __global const struct bundle *bundles, __global const float16 *bundle_h,
                     __global const uint *sample_starts, __global const uint *sample_list,
                     __global const struct source *samples, uint sample_count, struct ring sample_ring,
                     __global const uint *point_starts, __global const uint *point_list,
                     __global const struct source *points, uint point_count, struct ring point_ring,
                     __global const float4 *kernels, __global const float4 *point_kernels, __global const float16 *factors,
                     __global const uint *ids, __global const float *weights, __global const float16 *posts,
                     __global const uint *links, __global const float *shares, int linked, __global float4 *out)
{
    size_t index = first + get_global_id(0);
    const struct bundle to = bundles[index];
    __global const float16 *h = bundle_h + index * (LANES * TERMS4);
    float4 sums[LANES];
    for (int j = 0; j < LANES; j++) {
        sums[j] = 0;
    }
    if (sample_count > 0) {
        const struct runs one_by_one = {sample_starts, sample_list, samples, sample_count};
        add_near(&to, index, &one_by_one, false, &sample_ring, sums, factors, h, kernels, ids, weights);
    }
    if (point_count > 0) {
        const struct runs by_points = {point_starts, point_list, points, point_count};
        add_near(&to, index, &by_points, true, &point_ring, sums, factors, h, point_kernels, ids, weights);
    }
    for (int j = 0; j < LANES; j++) {
        size_t receiver = LANE(to.index, int, j);
        if (linked) {
            float16 shared[TERMS4], sum = 0;
#pragma unroll
            for (int k = 0; k < TERMS4; k++) {
                shared[k] = 0;
            }
            interpolate(posts, links + receiver * LINKS, shares + receiver * LINKS, shared);
#pragma unroll
            for (int k = 0; k < TERMS4; k++) {
                sum = fma(shared[k], h[j * TERMS4 + k], sum);
            }
            sums[j] += fold(sum);
        }
        out[receiver] = sums[j] * (1 / (POINT_MM * POINT_MM));
    }
}
