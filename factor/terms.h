/* Fitting the model with a kernel per term on an OpenCL device: the method "terms".
 *
 * Each step sets every point's values to the best non-negative ones for all others held (the normal equations of the
 * point, a few sweeps of coordinate descent), damped where planes meet themselves, carries the planes on along their last
 * change, and then sets the kernels to the best for those planes. A step that would raise the objective is not taken.
 * docs/factorization.md has the figures. */
#ifndef FACTOR_TERMS_H
#define FACTOR_TERMS_H

#include "factor/method.h"

#include "base/opencl.h"

/* More terms than this make programs that take minutes to compile. */
enum { TERMS_MOST = 64 };

/* Compile the kernels, place problem->data on the device and start from problem->kinds. Planes that the channels share are
 * channel 0's: its steps are those of all. The method keeps `opencl`, which must outlive it. */
int terms_new(const struct opencl *opencl, const struct problem *problem, struct method **method,
              struct nacre_error *error);

#endif
