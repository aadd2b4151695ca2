/* Paths of light through a slab of voxels, each of one material: radiative transfer without approximation.
 *
 * A path is one work-item's; its random numbers are a function of the seed and of its number alone, and what it
 * contributes is added up in fixed point, so results do not depend on the order of work-items. Built with
 *   -DEXITANCE   tally the flux through the surface; otherwise the radiance towards the normal
 *   -DMATCHED    every index of refraction is 1
 *   -DISOTROPIC  every material scatters evenly
 *   -DCLEAR      no material absorbs
 *   -DALIKE      there is one material */

#define PI 3.14159265358979f

/* The same as struct slab in montecarlo.c. */
struct slab {
    int nx, ny, nz, side; /* voxels; along a surface point */
    int margin, width, height, window;
    float cell, layer; /* sides of a voxel, mm */
    float majorant;    /* the largest extinction, per mm */
    uint seed, channel, first;
};

/* Philox 4 x 32 with 10 rounds (Salmon et al. 2011): four random words of a counter and a key. */
uint4 philox(uint4 counter, uint2 key)
{
    for (int i = 0; i < 10; i++) {
        uint high0 = mul_hi(0xd2511f53u, counter.x);
        uint low0 = 0xd2511f53u * counter.x;
        uint high1 = mul_hi(0xcd9e8d57u, counter.z);
        uint low1 = 0xcd9e8d57u * counter.z;
        counter = (uint4)(high1 ^ counter.y ^ key.x, low1, high0 ^ counter.w ^ key.y, low0);
        key += (uint2)(0x9e3779b9u, 0xbb67ae85u);
    }
    return counter;
}

/* Uniform in (0, 1). */
float4 uniform(uint4 words)
{
    return (convert_float4(words >> 9) + 0.5f) * 0x1p-23f;
}

/* Add to a number of 64 bits, its low word first, with 40 of them behind the point. */
void add(volatile __global uint *sum, float value)
{
    ulong fixed = convert_ulong_rte(value * 0x1p40f);
    uint low = (uint)fixed;
    uint high = (uint)(fixed >> 32);
    uint before = atomic_add(sum, low);
    high += before + low < before;
    if (high > 0) {
        atomic_add(sum + 1, high);
    }
}

/* The part of light that is reflected inside at cosine c. */
float fresnel(float index, float c)
{
    float sine = index * sqrt(fmax(0.0f, 1 - c * c));
    if (sine >= 1) {
        return 1;
    }
    float outside = sqrt(1 - sine * sine);
    float s = (index * c - outside) / (index * c + outside);
    float p = (c - index * outside) / (c + index * outside);
    return 0.5f * (s * s + p * p);
}

/* Henyey and Greenstein's phase function of the scattering angle's cosine, per steradian. */
float phase(float g, float c)
{
    float d = 1 + g * g - 2 * g * c;
    return (1 - g * g) / (4 * PI * d * sqrt(d));
}

/* A direction scattered from d. */
float3 scatter(float3 d, float g, float u, float v)
{
    float c = 1 - 2 * u;
#ifndef ISOTROPIC
    if (fabs(g) > 1e-3f) {
        float ratio = (1 - g * g) / (1 - g + 2 * g * u);
        c = (1 + g * g - ratio * ratio) / (2 * g);
    }
#endif
    float s = sqrt(fmax(0.0f, 1 - c * c));
    float angle = 2 * PI * v;
    float3 aside = fabs(d.z) < 0.9f ? (float3)(0, 0, 1) : (float3)(1, 0, 0);
    float3 a = normalize(cross(d, aside));
    float3 b = cross(d, a);
    return normalize(c * d + s * (cos(angle) * a + sin(angle) * b));
}

/* Which entry of the window around point `source` the place at (x, y) belongs to, -1 where none. */
int entry_at(__constant struct slab *slab, int2 source, int x, int y)
{
    int px = x / slab->side - slab->margin;
    int py = y / slab->side - slab->margin;
    int u = px - source.x + slab->window / 2;
    int v = py - source.y + slab->window / 2;
    bool within = x >= slab->margin * slab->side && px < slab->width &&
                  y >= slab->margin * slab->side && py < slab->height && u >= 0 && v >= 0 &&
                  u < slab->window && v < slab->window;
    return within ? v * slab->window + u : -1;
}

/* What becomes of all light, in the order of struct montecarlo_totals. */
enum { UP, DOWN, ASIDE, ABSORBED, CAMERA, TOTALS };

/* `materials` are (scattering, extinction, g, index of refraction); `above` is the optical depth over each voxel, and
 * that of the whole column behind the last. */
__kernel void trace(__constant struct slab *slab, __constant float4 *materials,
                    __global const uchar *voxels, __global const float *above,
                    __global const int2 *points, volatile __global uint *tallies,
                    volatile __global uint *totals)
{
    uint number = slab->first + get_global_id(0);
    int which = get_global_id(1);
    int2 source = points[which];
    uint2 key = (uint2)(slab->seed, slab->channel);
    uint place = (uint)source.y * (uint)slab->width + (uint)source.x;
    uint4 counter = (uint4)(0, number, place, 0);
    volatile __global uint *tally = tallies + (size_t)which * slab->window * slab->window * 2;
    float thickness = slab->nz * slab->layer;
    float pitch = slab->side * slab->cell;
    float wide = slab->nx * slab->cell;
    float high = slab->ny * slab->cell;
    float sums[TOTALS] = {0};

    float4 u = uniform(philox(counter, key));
    float3 at = (float3)((source.x + slab->margin + u.x) * pitch,
                         (source.y + slab->margin + u.y) * pitch, 0);
    float3 d = (float3)(0, 0, 1);
    float weight = 1;
#ifndef MATCHED
    {
        int x = min((int)(at.x / slab->cell), slab->nx - 1);
        int y = min((int)(at.y / slab->cell), slab->ny - 1);
        weight = 1 - fresnel(materials[voxels[((size_t)y * slab->nx + x) * slab->nz]].w, 1);
    }
#endif
    while (weight > 0) {
        counter.x++;
        u = uniform(philox(counter, key));
        float step = -log(u.x) / slab->majorant;
        float3 from = at;
        at += step * d;
        bool outside = at.z <= 0 || at.z >= thickness;
        if (outside) {
            /* Back to the surface; what is left of the step is forgotten, as free paths have no memory. */
            float surface = at.z <= 0 ? 0 : thickness;
            at = from + (surface - from.z) / d.z * d;
            at.z = surface;
        }
        if (!(at.x >= 0 && at.x < wide && at.y >= 0 && at.y < high)) {
            sums[ASIDE] += weight;
            break;
        }
        int x = min((int)(at.x / slab->cell), slab->nx - 1);
        int y = min((int)(at.y / slab->cell), slab->ny - 1);
        int z = min((int)(at.z / slab->layer), slab->nz - 1);
        size_t column = (size_t)y * slab->nx + x;
        float4 material = materials[voxels[column * slab->nz + z]];
        if (outside) {
            float reflected = 0;
#ifndef MATCHED
            reflected = fresnel(material.w, fabs(d.z));
#endif
            float out = weight * (1 - reflected);
            sums[d.z < 0 ? UP : DOWN] += out;
#ifdef EXITANCE
            int entry = entry_at(slab, source, x, y);
            if (d.z < 0 && entry >= 0) {
                add(tally + 2 * entry, out);
            }
#endif
            weight *= reflected;
            d.z = -d.z;
            continue;
        }
#ifndef ALIKE
        if (u.y * slab->majorant >= material.y) {
            continue; /* no collision in this material */
        }
#endif
#ifndef CLEAR
        float albedo = material.x / material.y;
        sums[ABSORBED] += weight * (1 - albedo);
        weight *= albedo;
#endif
#ifndef EXITANCE
        __global const float *depths = above + column * (slab->nz + 1);
        float depth = depths[z] + material.y * (at.z - z * slab->layer);
        float all = depths[slab->nz];
        float seen = phase(material.z, -d.z) * exp(-depth);
#ifndef MATCHED
        /* Also down, mirrored by the bottom; and any number of times there and back. */
        float index = materials[voxels[column * slab->nz]].w;
        float top = fresnel(index, 1);
        float bottom = fresnel(materials[voxels[column * slab->nz + slab->nz - 1]].w, 1);
        seen += phase(material.z, d.z) * bottom * exp(depth - 2 * all);
        seen *= (1 - top) / (index * index) / (1 - top * bottom * exp(-2 * all));
#endif
        seen *= PI * weight;
        sums[CAMERA] += seen;
        int entry = entry_at(slab, source, x, y);
        if (entry >= 0) {
            add(tally + 2 * entry, seen);
        }
#endif
        if (weight < 0.02f) {
            /* Russian roulette. */
            weight = u.z < 0.1f ? weight * 10 : 0;
        }
        counter.w++;
        u = uniform(philox(counter, key));
        d = scatter(d, material.z, u.x, u.y);
    }
    for (int i = 0; i < TOTALS; i++) {
        if (sums[i] > 0) {
            add(totals + 2 * (which * TOTALS + i), sums[i]);
        }
    }
}
