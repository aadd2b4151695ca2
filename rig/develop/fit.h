/* Least squares for pixels that see mixtures of surface points. */
#ifndef RIG_DEVELOP_FIT_H
#define RIG_DEVELOP_FIT_H

#include "nacre/error.h"
#include "rig/develop/footprint.h"

#include <stddef.h>
#include <stdint.h>

/* The normal equations sum_k s_kp w_k s_kq of pixels k, which couple points p and q seen by one pixel: a few bands, one
 * for each distance (dx, dy) that the couples have, those backwards left out. Zero-initialised it is empty. */
struct fit_matrix {
    size_t points, count; /* of bands; the first is the diagonal */
    size_t *offset;       /* [count]: q - p */
    float *bands;         /* [count][points], by p */
};

/* Of the `count` listed pixels with weight[k], s_kp being the shares of `footprints`; surface_width as theirs. */
int fit_matrix_init(struct fit_matrix *matrix, const struct footprints *footprints,
                    int surface_width, const uint32_t *pixels, const float *weight, size_t count,
                    size_t points, struct nacre_error *error);
void fit_matrix_finish(struct fit_matrix *matrix);

/* Solve matrix x = right for x[points] by conjugate gradients with diagonal preconditioning. x holds the first guess. A
 * point that no weighted pixel sees keeps it. Stops when the residual is below 10^-5 of the right-hand side, or after
 * 40 rounds: where points are narrower than pixels going on would only amplify noise. */
int fit_solve(const struct fit_matrix *matrix, const double *right, double *x,
              struct nacre_error *error);

#endif
