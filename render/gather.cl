/* Light gathered from samples by receivers; gather_reference.c is the same in double precision.
 * What is specialised, by -D: */
#ifndef TERMS4
#define TERMS4 1 /* terms / 4 */
#endif
#ifndef PLANES
#define PLANES 3 /* channels of the factors: 1 or 3 */
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
#ifndef NEAR_MM
#define NEAR_MM 3.0f /* nearer cells: sample by sample */
#endif
#ifndef MIDDLE_MM
#define MIDDLE_MM 8.0f /* nearer cells: by quarters of a surface point; farther ones as a whole */
#endif

#define SIDE (WINDOW + 2)
#define REACH_MM ((WINDOW / 2 + 1) * 1.4142136f * POINT_MM)

struct receiver {
    float4 position, along_x, along_y, normal;
    int4 place; /* chart, column, flip_x, flip_y */
};

int wrap(int i, int size)
{
    int period = MIRROR ? 2 * size : size;
    int inside = i % period;
    inside += inside < 0 ? period : 0;
    return inside < size ? inside : 2 * size - 1 - inside;
}

float total(float4 v)
{
    return (v.x + v.y) + (v.z + v.w);
}

/* sum_t F H G, by colour, at padded kernel offset (u, v) + fraction f. */
float4 response(uint texel, int column, int u, int v, float2 f, __global const float4 *factors,
                const float4 *h, __global const float4 *kernels, __global const uint *ids,
                __global const float *weights)
{
    __global const float4 *row = factors + (size_t)texel * (PLANES * TERMS4);
    float4 corner = (float4)((1 - f.x) * (1 - f.y), f.x * (1 - f.y), (1 - f.x) * f.y, f.x * f.y);
#if PER_TERM
    __global const float4 *g = kernels + ((size_t)v * SIDE + u) * (TERMS4 * 4);
    float4 sum = 0;
    for (int t = 0; t < TERMS4 * 4; t++) {
        float4 kernel_value = corner.x * g[t] + corner.y * g[t + TERMS4 * 4] +
                              corner.z * g[t + SIDE * TERMS4 * 4] +
                              corner.w * g[t + (SIDE + 1) * TERMS4 * 4];
        float4 product = ((__global const float *)row)[t] * ((const float *)h)[t];
        if (PLANES == 3) {
            product.y = ((__global const float *)row)[t + TERMS4 * 4] *
                        ((const float *)h)[t + TERMS4 * 4];
            product.z = ((__global const float *)row)[t + TERMS4 * 8] *
                        ((const float *)h)[t + TERMS4 * 8];
        }
        sum += product * kernel_value;
    }
    return sum;
#else
    float4 kernel_value = 0;
    for (int a = 0; a < MIXED; a++) {
        size_t id = ids[(size_t)texel * MIXED + a] * (CLUSTERS ? CLUSTERS : 1) + column;
        __global const float4 *g = kernels + (id * SIDE + v) * SIDE + u;
        float4 value = corner.x * g[0] + corner.y * g[1] + corner.z * g[SIDE] + corner.w * g[SIDE + 1];
        kernel_value += (MIXED > 1 ? weights[(size_t)texel * MIXED + a] : 1.0f) * value;
    }
    float4 sums[PLANES];
    for (int c = 0; c < PLANES; c++) {
        sums[c] = row[c * TERMS4] * h[c * TERMS4];
        for (int t = 1; t < TERMS4; t++) {
            sums[c] = mad(row[c * TERMS4 + t], h[c * TERMS4 + t], sums[c]);
        }
    }
    float4 product = total(sums[0]);
    if (PLANES == 3) {
        product.y = total(sums[PLANES / 2]);
        product.z = total(sums[PLANES - 1]);
    }
    return product * kernel_value;
#endif
}

/* What one sample gives a receiver. sample: position and x; flux and y; normal. spot: texel, chart. */
float4 pair(const struct receiver *to, const float4 *h, __global const float4 *sample,
            __global const uint *spot, __global const float4 *factors, __global const float4 *kernels,
            __global const uint *ids, __global const float *weights)
{
    float4 place = sample[0], flux = sample[1];
    float4 offset = (float4)(to->position.xyz - place.xyz, 0);
    float square = dot(offset, offset);
    if (square >= REACH_MM * REACH_MM) {
        return 0;
    }
    if (SAME_SIDE && dot(to->normal.xyz, sample[2].xyz) <= 0) {
        return 0;
    }
    float a = dot(offset.xyz, to->along_x.xyz), b = dot(offset.xyz, to->along_y.xyz);
    float across = a * a + b * b;
    if (!(across > 1e-10f * square)) { /* straight through the material: no direction is better than another */
        a = 1;
        b = 0;
        across = 1;
    }
    float scale = sqrt(square / across) / POINT_MM;
    float dx = a * scale, dy = b * scale;
    float u = to->place.z * dx + (WINDOW / 2 + 1), v = to->place.w * dy + (WINDOW / 2 + 1);
    if (!(u > 0 && u < WINDOW + 1 && v > 0 && v < WINDOW + 1)) {
        return 0;
    }
    uint texel = spot[0];
    if (spot[1] != (uint)to->place.x || fabs(to->along_x.w - place.w) > WINDOW / 2 + 1 ||
        fabs(to->along_y.w - flux.w) > WINDOW / 2 + 1) {
        texel = wrap(convert_int_rtn(to->along_y.w - dy), HEIGHT) * WIDTH +
                wrap(convert_int_rtn(to->along_x.w - dx), WIDTH);
    }
    int iu = (int)u, iv = (int)v;
    return flux * response(texel, to->place.y, iu, iv, (float2)(u - iu, v - iv), factors, h, kernels,
                           ids, weights);
}

/* One receiver a work item. groups[receiver] names the part of `lists` that holds the blocks in its reach. */
__kernel void gather(uint first, __global const struct receiver *receivers,
                     __global const float4 *receiver_h, __global const uint *groups,
                     __global const uint *list_starts, __global const uint *lists,
                     __global const float4 *blocks, __global const uint2 *block_cells,
                     __global const float4 *cells, __global const uint4 *cell_samples,
                     __global const float4 *samples, __global const uint *spots,
                     __global const float4 *quarters, __global const uint *quarter_spots,
                     __global const float4 *wholes, __global const uint *whole_spots,
                     __global const float4 *factors, __global const float4 *kernels,
                     __global const uint *ids, __global const float *weights, __global float4 *out)
{
    size_t index = first + get_global_id(0);
    struct receiver to = receivers[index];
    float4 h[PLANES * TERMS4];
    for (int i = 0; i < PLANES * TERMS4; i++) {
        h[i] = receiver_h[index * (PLANES * TERMS4) + i];
    }
    float4 sum = 0;
    uint group = groups[index];
    for (uint i = list_starts[group]; i < list_starts[group + 1]; i++) {
        uint block = lists[i];
        float3 outside = fmax(fmax(blocks[2 * block].xyz - to.position.xyz,
                                   to.position.xyz - blocks[2 * block + 1].xyz), 0.0f);
        if (dot(outside, outside) >= REACH_MM * REACH_MM) {
            continue;
        }
        float4 block_sum = 0;
        for (uint cell = block_cells[block].x; cell < block_cells[block].y; cell++) {
            float3 away = cells[cell].xyz - to.position.xyz;
            float distance = sqrt(dot(away, away)) - cells[cell].w;
            if (distance >= REACH_MM) {
                continue;
            }
            uint4 range = cell_samples[cell];
            if (distance < NEAR_MM) {
                for (uint s = range.x; s < range.y; s++) {
                    block_sum += pair(&to, h, samples + 3 * (size_t)s, spots + 2 * (size_t)s, factors,
                                      kernels, ids, weights);
                }
            } else if (distance < MIDDLE_MM) {
                for (uint s = range.z; s < range.w; s++) {
                    block_sum += pair(&to, h, quarters + 3 * (size_t)s, quarter_spots + 2 * (size_t)s,
                                      factors, kernels, ids, weights);
                }
            } else {
                block_sum += pair(&to, h, wholes + 3 * (size_t)cell, whole_spots + 2 * (size_t)cell,
                                  factors, kernels, ids, weights);
            }
        }
        sum += block_sum;
    }
    out[index] = sum * (1.0f / (POINT_MM * POINT_MM));
}
