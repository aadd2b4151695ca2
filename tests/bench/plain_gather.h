/* The gather as plainly as it is fast: every light sample within reach, one by one, on the OpenCL device. */
#ifndef TESTS_BENCH_PLAIN_GATHER_H
#define TESTS_BENCH_PLAIN_GATHER_H

#include "render/gather.h"

/* Add to radiosity[vertex][3] as gather_run does, for layout single with hard clusters and three channels. `every`: only
 * one in so many bundles of 16 receivers is worked out, and done[vertex] is set for those. Ends the program where it
 * fails. Returns processor seconds without building the kernel; those of the launches are scaled to all bundles. */
double plain_gather(const struct gather *gather, const struct opencl *opencl, size_t every,
                    float (*radiosity)[3], bool *done);

#endif
