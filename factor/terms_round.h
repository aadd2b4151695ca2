/* Rounding planes to few values so that what one term loses at a point others make up for. */
#ifndef FACTOR_TERMS_ROUND_H
#define FACTOR_TERMS_ROUND_H

#include "factor/factors.h"

/* planes[terms][points] become levels 0 ... 2^bits - 1, the roots of values over each plane's largest, which
 * `largest`[terms] gets.
 *
 * At a measured point these are not the nearest ones but, term by term from there, those that change its light least: least
 * z^T A z, z the change of its values and A its normal matrix by the factors' other side and kernels. What is 0 stays 0. */
int terms_round(const struct terms_data *data, const struct factors *factors, int set, int side,
                int bits, float *planes, double *largest, struct nacre_error *error);

#endif
