/* k-means clustering: greedy k-means++ from a seed, then Lloyd's iterations. */
#ifndef FACTOR_KMEANS_H
#define FACTOR_KMEANS_H

#include "nacre/error.h"

#include <stddef.h>
#include <stdint.h>

/* Assign each of vectors[count][length] to one of `clusters` clusters, 1 <= clusters <= count. labels[count]. A cluster
 * that loses all its vectors is started again at the vector farthest from its own centre; where there are fewer
 * different vectors than clusters, some stay empty. The same input and seed give the same labels, on any number of
 * threads. */
int kmeans(const float *vectors, size_t count, size_t length, int clusters, uint64_t seed,
           uint32_t *labels, struct nacre_error *error);

#endif
