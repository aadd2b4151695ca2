/* Giving values to points that were not measured, so that renders have no holes. */
#ifndef FACTOR_FILL_H
#define FACTOR_FILL_H

#include "nacre/error.h"

#include <stddef.h>
#include <stdint.h>

/* Spread ids[height][width] from known points (known[height][width] not 0) outwards, ring by ring: each point takes the
 * most frequent of its eight neighbours' that are known by then, of equals the smallest. Where none is known ids stay. */
int fill_labels(int width, int height, const uint8_t *known, uint32_t *ids,
                struct nacre_error *error);

/* The same for planes[count] of floats at once, `stride` floats apart: each point takes the mean of its known neighbours
 * in the same cluster, where it has any, else of all. */
int fill_planes(int width, int height, const uint8_t *known, const uint32_t *ids, float *planes,
                size_t count, size_t stride, struct nacre_error *error);

#endif
