/* Random numbers that depend on a seed and a counter alone, so that results do not depend on threads or layout. */
#ifndef FACTOR_RANDOM_H
#define FACTOR_RANDOM_H

#include <stdint.h>

/* 64 well-mixed bits of (seed, counter): the splitmix64 generator's output function. */
static inline uint64_t random_bits(uint64_t seed, uint64_t counter)
{
    uint64_t z = seed * 0xd1342543de82ef95u + (counter + 1) * 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

/* Uniform in (0, 1]. */
static inline double random_uniform(uint64_t seed, uint64_t counter)
{
    return (double)((random_bits(seed, counter) >> 11) + 1) * 0x1p-53;
}

#endif
