/* Error against bytes over the sizes of the paper's model and of the model with a kernel per term. */
#ifndef TESTS_BENCH_REPRESENTATIONS_SWEEP_H
#define TESTS_BENCH_REPRESENTATIONS_SWEEP_H

#include "fitted.h"

/* Fit and tell of all sizes for one sample: a table, what the goals come to, and a plot where there is a folder for it. Returns
 * whether a kernel per term holds the paper's noise-free error in the share of the numbers' bytes that is asked for. */
bool sweep(const struct bench *bench, const struct sample *sample);

#endif
