/* Random numbers that depend on what they are for and on nothing else, so that results are the same on any number of
 * threads. */
#ifndef RENDER_RANDOM_H
#define RENDER_RANDOM_H

#include <stdint.h>

/* A finaliser of good avalanche (Stafford's mix 13 of MurmurHash3's). */
static inline uint64_t random_mix(uint64_t x)
{
    x = (x ^ (x >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    x = (x ^ (x >> 27)) * UINT64_C(0x94d049bb133111eb);
    return x ^ (x >> 31);
}

/* Number `index` of stream `stream` under `seed`, uniform in [0, 1). */
static inline double random_uniform(uint64_t seed, uint64_t stream, uint64_t index)
{
    uint64_t x = random_mix(seed + UINT64_C(0x9e3779b97f4a7c15));
    x = random_mix(x ^ (stream + UINT64_C(0x632be59bd9b4e019)));
    x = random_mix(x ^ (index + UINT64_C(0x8cb92ba72f3d8dd7)));
    return (double)(x >> 11) * 0x1p-53;
}

#endif
