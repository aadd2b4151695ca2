/* Sorting points in space into compact runs, as the pinned gather takes them. */
#ifndef BENCH_HALVES_H
#define BENCH_HALVES_H

#include <stddef.h>
#include <stdint.h>

/* Reorder the indices so that every run of `run` of them, counted from the first, is compact in space: a tree of halves
 * across the longest side. positions[index * stride] begins a point. */
void halves_sort(const float *positions, size_t stride, uint32_t *order, size_t count, size_t run);

#endif
