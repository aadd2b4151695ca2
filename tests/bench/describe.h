/* What makes a scan hard or easy to factor, in a few figures: for comparing made-up samples with path-traced ones. */
#ifndef TESTS_BENCH_DESCRIBE_H
#define TESTS_BENCH_DESCRIBE_H

#include "factor/responses.h"

#include "base/opencl.h"

/* Prints the centre's share of the energy, how responses fall off, and the mean error that some numbers of terms and
 * clusters reach. The responses are loaded with layout_lanes of the device. Ends the program after an error. */
void describe(const char *name, const struct responses *responses, const struct opencl *opencl);

#endif
