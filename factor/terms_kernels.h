/* The best kernels for given planes: non-negative least squares on sums over points. */
#ifndef FACTOR_TERMS_KERNELS_H
#define FACTOR_TERMS_KERNELS_H

#include "factor/terms_data.h"

/* numbers[terms][grid->count], as they are and as they become: those that minimise, over the entries of a window, the sum
 * of 1/2 k^T A k - b^T k, k the kernels' values at the entry. equations[K][K][PAIRS + terms] hold A's lower triangle, row
 * by row, and b. With `both_ways` entries from the centre on alone are looked at, and kernels are even. Entries more than
 * `most` rows or columns from the centre are not looked at, and numbers that they depend on stay. */
int terms_kernels_solve(const struct terms_grid *grid, int terms, bool both_ways, int most,
                        const float *equations, float *numbers, struct nacre_error *error);

#endif
