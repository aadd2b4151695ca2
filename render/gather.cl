/* Light gathered by 16 receivers at a time, from light samples and from moments of squares of surface points (cells.h,
 * basis.h); gather_reference.c is the same in double precision, sample by sample. What is specialised, by -D: */
#ifndef TERMS4
#define TERMS4 1 /* terms / 4 */
#endif
#ifndef WINDOW
#define WINDOW 3 /* K */
#endif
#ifndef MIXED
#define MIXED 1 /* kernels mixed at a surface point */
#endif
#ifndef CLUSTERS
#define CLUSTERS 0 /* kernels from one id to the next, for pairs of clusters */
#endif
#ifndef PER_TERM
#define PER_TERM 0 /* 1: a kernel for each term */
#endif
#ifndef VECTORS
#define VECTORS 1 /* float16s of basis kernels */
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

#define SIDE (WINDOW + 2)
#define HALF_WINDOW (WINDOW / 2 + 1)
#define LANES 16
#define LAST (2 * HALF_WINDOW * 0x1.fffffep-1f) /* just inside the padded window */
#define TERMS (4 * TERMS4)
#define LANE(vector, type, j) (((const type *)&(vector))[j])

/* 16 receivers, field by field. */
struct bundle {
    float16 px, py, pz, ax, ay, az, bx, by, bz, nx, ny, nz, x, y, flip_x, flip_y;
    int16 chart, column;
};

struct point {
    float px, py, pz, x, y, red, green, blue, nx, ny, nz;
    int chart;
    uint texel, unused[3];
};

/* Where the kernels are read: the padded offset's whole part and fraction. */
struct offsets {
    float16 dx, dy, fx, fy;
    int16 inside, place;
};

int wrap(int i, int size)
{
    int period = MIRROR ? 2 * size : size;
    int inside = i % period;
    inside += inside < 0 ? period : 0;
    return inside < size ? inside : 2 * size - 1 - inside;
}

struct offsets offsets_from(const struct bundle *to, float px, float py, float pz)
{
    struct offsets o;
    float16 ox = to->px - px, oy = to->py - py, oz = to->pz - pz;
    float16 square = fma(ox, ox, fma(oy, oy, oz * oz));
    float16 a = fma(ox, to->ax, fma(oy, to->ay, oz * to->az));
    float16 b = fma(ox, to->bx, fma(oy, to->by, oz * to->bz));
    float16 across = fma(a, a, b * b);
    /* Else straight through the material: no direction is better than another. */
    int16 along = across > 1e-10f * square;
    a = select((float16)1, a, along);
    b = select((float16)0, b, along);
    float16 scale = sqrt(square / select((float16)1, across, along)) * (1 / POINT_MM);
    o.dx = a * scale;
    o.dy = b * scale;
    float16 u = fma(to->flip_x, o.dx, (float16)HALF_WINDOW), v = fma(to->flip_y, o.dy, (float16)HALF_WINDOW);
    o.inside = (u > 0) & (u < 2 * HALF_WINDOW) & (v > 0) & (v < 2 * HALF_WINDOW);
    u = clamp(u, (float16)0, (float16)LAST); /* lanes outside read something, too */
    v = clamp(v, (float16)0, (float16)LAST);
    int16 column = convert_int16(u), row = convert_int16(v);
    o.fx = u - convert_float16(column);
    o.fy = v - convert_float16(row);
    o.place = row * SIDE + column;
    return o;
}

float4 fold(float16 v)
{
    float8 half_sum = v.lo + v.hi;
    return half_sum.lo + half_sum.hi;
}

float16 basis_at(__global const float16 *g, int step, float fx, float fy)
{
    float16 upper = fma(g[step] - g[0], (float16)fx, g[0]);
    float16 lower = fma(g[(SIDE + 1) * step] - g[SIDE * step], (float16)fx, g[SIDE * step]);
    return fma(lower - upper, (float16)fy, upper);
}

/* sum_t F H G by colour, for receiver j of the bundle. */
float4 response(uint texel, int column, int place, float fx, float fy, __global const float16 *factors,
                __global const float16 *h, __global const float4 *kernels, __global const float16 *basis,
                __global const uint *ids, __global const float *weights)
{
    __global const float16 *f = factors + (size_t)texel * TERMS4;
    float16 sum = 0;
#if PER_TERM
    for (int k = 0; k < TERMS4; k++) {
        sum = fma(f[k] * h[k], basis_at(basis + (size_t)place * TERMS4 + k, TERMS4, fx, fy), sum);
    }
    return fold(sum);
#else
    float4 value = 0;
    for (int k = 0; k < TERMS4; k++) {
        sum = fma(f[k], h[k], sum);
    }
    for (int a = 0; a < MIXED; a++) {
        size_t id = ids[(size_t)texel * MIXED + a] * (CLUSTERS ? CLUSTERS : 1) + column;
        __global const float4 *g = kernels + id * (SIDE * SIDE) + place;
        float4 upper = fma(g[1] - g[0], (float4)fx, g[0]);
        float4 lower = fma(g[SIDE + 1] - g[SIDE], (float4)fx, g[SIDE]);
        value += (MIXED > 1 ? weights[(size_t)texel * MIXED + a] : 1.0f) *
                 fma(lower - upper, (float4)fy, upper);
    }
    return fold(sum) * value;
#endif
}

/* The surface point that receiver j sees in the direction of a sample that is elsewhere in the texture. */
uint seen_texel(const struct bundle *to, const struct offsets *o, int j)
{
    return wrap(convert_int_rtn(LANE(to->y, float, j) - LANE(o->dy, float, j)), HEIGHT) * WIDTH +
           wrap(convert_int_rtn(LANE(to->x, float, j) - LANE(o->dx, float, j)), WIDTH);
}

/* What one light sample, or a sum of some on one surface point, gives each receiver. */
void add_point(const struct bundle *to, __global const struct point *from, float4 *sums,
               __global const float16 *factors, __global const float16 *h, __global const float4 *kernels,
               __global const float16 *basis, __global const uint *ids, __global const float *weights)
{
    struct offsets o = offsets_from(to, from->px, from->py, from->pz);
    if (SAME_SIDE) {
        o.inside &= fma(to->nx, from->nx, fma(to->ny, from->ny, to->nz * from->nz)) > 0;
    }
    if (!any(o.inside)) {
        return;
    }
    int16 foreign = (to->chart != from->chart) | (fabs(to->x - from->x) > HALF_WINDOW) |
                    (fabs(to->y - from->y) > HALF_WINDOW);
    float4 flux = (float4)(from->red, from->green, from->blue, 0);
    for (int j = 0; j < LANES; j++) {
        if (LANE(o.inside, int, j)) {
            uint texel = LANE(foreign, int, j) ? seen_texel(to, &o, j) : from->texel;
            sums[j] += flux * response(texel, LANE(to->column, int, j), LANE(o.place, int, j),
                                       LANE(o.fx, float, j), LANE(o.fy, float, j), factors,
                                       h + j * TERMS4, kernels, basis, ids, weights);
        }
    }
}

#if PER_TERM
#define STATE TERMS4 /* float16s that a receiver's sum takes */
#else
#define STATE 1
#endif

/* What a square's light gives each receiver. sums[LANES][STATE]; h[TERMS][LANES] has H in the lanes of the basis. */
void add_square(const struct bundle *to, float4 from, __global const float16 *moment, float16 *sums,
                const float16 *h, __global const float16 *basis)
{
    struct offsets o = offsets_from(to, from.x, from.y, from.z);
    if (!any(o.inside)) {
        return;
    }
#if PER_TERM
    for (int j = 0; j < LANES; j++) {
        if (LANE(o.inside, int, j)) {
            __global const float16 *g = basis + (size_t)LANE(o.place, int, j) * TERMS4;
            for (int k = 0; k < TERMS4; k++) {
                sums[j * STATE + k] =
                    fma(basis_at(g + k, TERMS4, LANE(o.fx, float, j), LANE(o.fy, float, j)),
                        moment[k], sums[j * STATE + k]);
            }
        }
    }
#else
    for (int j = 0; j < LANES; j += 4) { /* four at a time: the moment is read once for them */
        if (!(LANE(o.inside, int, j) | LANE(o.inside, int, j + 1) | LANE(o.inside, int, j + 2) |
              LANE(o.inside, int, j + 3))) {
            continue;
        }
        for (int k = 0; k < VECTORS; k++) {
            float16 part[4];
            for (int i = 0; i < 4; i++) {
                part[i] = h[j + i] * moment[k];
            }
            for (int t = 1; t < TERMS; t++) {
                float16 m = moment[t * VECTORS + k];
                for (int i = 0; i < 4; i++) {
                    part[i] = fma(h[t * LANES + j + i], m, part[i]);
                }
            }
            for (int i = 0; i < 4; i++) {
                size_t table = CLUSTERS ? (size_t)LANE(to->column, int, j + i) * (SIDE * SIDE) : 0;
                __global const float16 *g =
                    basis + (table + LANE(o.place, int, j + i)) * VECTORS + k;
                float16 value = basis_at(g, VECTORS, LANE(o.fx, float, j + i), LANE(o.fy, float, j + i));
                value = LANE(o.inside, int, j + i) ? value : (float16)0;
                sums[j + i] = fma(value, part[i], sums[j + i]);
            }
        }
    }
#endif
}

/* By colour, what a receiver's sum over squares comes to. */
float4 sum_squares(const float16 *sums, __global const float16 *h)
{
#if PER_TERM
    float16 sum = 0;
    for (int k = 0; k < TERMS4; k++) {
        sum = fma(sums[k], h[k], sum);
    }
    return fold(sum);
#else
    float16 s = sums[0];
    return (float4)(s.s0 + s.s3 + s.s6 + s.s9 + s.sc, s.s1 + s.s4 + s.s7 + s.sa + s.sd,
                    s.s2 + s.s5 + s.s8 + s.sb + s.se, 0);
#endif
}

/* A bundle a work item. point_starts and square_starts name the parts of the lists that are its own. */
__kernel void gather(uint first, __global const struct bundle *bundles, __global const float16 *bundle_h,
                     __global const uint *point_starts, __global const uint *point_list,
                     __global const uint *square_starts, __global const uint *square_list,
                     __global const struct point *points, __global const float4 *squares,
                     __global const float16 *moments, __global const float16 *factors,
                     __global const float4 *kernels, __global const float16 *basis,
                     __global const uint *ids, __global const float *weights, __global float4 *out)
{
    size_t index = first + get_global_id(0);
    const struct bundle to = bundles[index];
    __global const float16 *h = bundle_h + index * (LANES * TERMS4);
    float4 sums[LANES];
    float16 square_sums[LANES * STATE];
    for (int j = 0; j < LANES * STATE; j++) {
        square_sums[j] = 0;
    }
    for (int j = 0; j < LANES; j++) {
        sums[j] = 0;
    }
    for (uint i = point_starts[index]; i < point_starts[index + 1]; i++) {
        add_point(&to, points + point_list[i], sums, factors, h, kernels, basis, ids, weights);
    }
    if (square_starts[index] < square_starts[index + 1]) {
#if PER_TERM
        float16 wide_h[1];
#else
        float16 wide_h[TERMS * LANES];
        for (int j = 0; j < LANES; j++) {
            __global const float4 *own = (__global const float4 *)(h + j * TERMS4);
            for (int t = 0; t < TERMS; t++) {
                float3 v = own[t].xyz;
                wide_h[t * LANES + j] = (float16)(v, v, v, v, v, 0);
            }
        }
#endif
        for (uint i = square_starts[index]; i < square_starts[index + 1]; i++) {
            size_t square = square_list[i];
            add_square(&to, squares[square], moments + square * (PER_TERM ? TERMS4 : TERMS * VECTORS),
                       square_sums, wide_h, basis);
        }
    }
    for (int j = 0; j < LANES; j++) {
        out[index * LANES + j] = (sums[j] + sum_squares(square_sums + j * STATE, h + j * TERMS4)) *
                                 (1 / (POINT_MM * POINT_MM));
    }
}
