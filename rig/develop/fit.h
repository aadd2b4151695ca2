/* Least squares for pixels that see mixtures of surface points. */
#ifndef RIG_DEVELOP_FIT_H
#define RIG_DEVELOP_FIT_H

#include "nacre/error.h"
#include "rig/develop/footprint.h"

#include <stddef.h>
#include <stdint.h>

/* Solve sum_k s_kp w_k sum_q s_kq x_q = right_p for x[points] by conjugate gradients with diagonal preconditioning, k
 * running over the `count` listed pixels, s_kp being the shares of `footprints` and w_k weight[k]. x holds the first
 * guess. A point that no weighted pixel sees keeps it. Stops when the residual is below 10^-5 of the right-hand side,
 * or after 40 rounds: where points are narrower than pixels going on would only amplify noise. */
int fit_solve(const struct footprints *footprints, const uint32_t *pixels, const float *weight,
              size_t count, size_t points, const double *right, double *x,
              struct nacre_error *error);

#endif
