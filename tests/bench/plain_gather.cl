/* The plain gather, the pinned baseline of bench_render: every light sample within the kernel's reach one by one, for 16
 * receivers a work item. Offsets are worked out for the 16 at once; F and H are laid out as [term][R, G, B, 0], four terms
 * to a float16. What is specialised, by -D: */
#ifndef TERMS4
#define TERMS4 1 /* terms / 4 */
#endif
#ifndef WINDOW
#define WINDOW 3 /* K */
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
#ifndef POINT_MM
#define POINT_MM 1.0f
#endif

#define SIDE (WINDOW + 2)
#define HALF_WINDOW (WINDOW / 2 + 1)
#define LANES 16

/* 16 receivers, field by field. */
struct bundle {
    float16 px, py, pz, ax, ay, az, bx, by, bz, x, y, flip_x, flip_y;
    int16 chart;
};

struct sample {
    float px, py, pz, x, y, red, green, blue;
    int chart;
    uint texel, unused[2];
};

int wrap(int i, int size)
{
    int period = MIRROR ? 2 * size : size;
    int inside = i % period;
    inside += inside < 0 ? period : 0;
    return inside < size ? inside : 2 * size - 1 - inside;
}

/* sum_t F H by colour. */
float4 product(__global const float16 *f, __global const float16 *h)
{
    float16 sum = f[0] * h[0];
    for (int t = 1; t < TERMS4; t++) {
        sum = fma(f[t], h[t], sum);
    }
    float8 half_sum = sum.lo + sum.hi;
    return half_sum.lo + half_sum.hi;
}

/* The kernel at padded offset `place`, between surface points. */
float4 kernel_at(__global const float4 *g, float fx, float fy)
{
    float4 upper = fma(g[1] - g[0], (float4)fx, g[0]);
    float4 lower = fma(g[SIDE + 1] - g[SIDE], (float4)fx, g[SIDE]);
    return fma(lower - upper, (float4)fy, upper);
}

__kernel void plain_gather(uint first, __global const struct bundle *bundles, __global const float16 *receiver_h,
                           __global const uint *list_starts, __global const uint *lists,
                           __global const uint *leaf_starts, __global const struct sample *samples,
                           __global const float16 *factors, __global const float4 *kernels,
                           __global const uint *ids, __global float4 *out)
{
    size_t index = first + get_global_id(0);
    const struct bundle to = bundles[index];
    __global const float16 *h = receiver_h + index * (LANES * TERMS4);
    float4 sums[LANES];
    for (int j = 0; j < LANES; j++) {
        sums[j] = 0;
    }
    for (uint i = list_starts[index]; i < list_starts[index + 1]; i++) {
        uint leaf = lists[i];
        for (uint s = leaf_starts[leaf]; s < leaf_starts[leaf + 1]; s++) {
            const struct sample from = samples[s];
            float16 ox = to.px - from.px, oy = to.py - from.py, oz = to.pz - from.pz;
            float16 square = fma(ox, ox, fma(oy, oy, oz * oz));
            float16 a = fma(ox, to.ax, fma(oy, to.ay, oz * to.az));
            float16 b = fma(ox, to.bx, fma(oy, to.by, oz * to.bz));
            float16 across = a * a + b * b;
            int16 along = across > 1e-10f * square;
            a = select((float16)1, a, along);
            b = select((float16)0, b, along);
            float16 scale = sqrt(square / select((float16)1, across, along)) * (1 / POINT_MM);
            float16 dx = a * scale, dy = b * scale;
            float16 u = to.flip_x * dx + HALF_WINDOW, v = to.flip_y * dy + HALF_WINDOW;
            int16 inside = u > 0 & u < 2 * HALF_WINDOW & v > 0 & v < 2 * HALF_WINDOW;
            if (!any(inside)) {
                continue;
            }
            int16 foreign =
                to.chart != from.chart | fabs(to.x - from.x) > HALF_WINDOW | fabs(to.y - from.y) > HALF_WINDOW;
            int16 column = convert_int16(u), row = convert_int16(v), place = row * SIDE + column;
            float16 fx = u - convert_float16(column), fy = v - convert_float16(row);
            int16 foreign_texel = (int16)from.texel;
            if (any(foreign & inside)) {
                float16 x = to.x - dx, y = to.y - dy;
                for (int j = 0; j < LANES; j++) {
                    if (((const int *)&foreign)[j]) {
                        ((int *)&foreign_texel)[j] =
                            wrap(convert_int_rtn(((const float *)&y)[j]), HEIGHT) * WIDTH +
                            wrap(convert_int_rtn(((const float *)&x)[j]), WIDTH);
                    }
                }
            }
            float4 flux = (float4)(from.red, from.green, from.blue, 0);
            for (int j = 0; j < LANES; j++) {
                if (((const int *)&inside)[j]) {
                    uint texel = ((const uint *)&foreign_texel)[j];
                    __global const float4 *g =
                        kernels + (size_t)ids[texel] * (SIDE * SIDE) + ((const int *)&place)[j];
                    float4 value = kernel_at(g, ((const float *)&fx)[j], ((const float *)&fy)[j]);
                    sums[j] +=
                        flux * value * product(factors + (size_t)texel * TERMS4, h + j * TERMS4);
                }
            }
        }
    }
    for (int j = 0; j < LANES; j++) {
        out[index * LANES + j] = sums[j] * (1 / (POINT_MM * POINT_MM));
    }
}
