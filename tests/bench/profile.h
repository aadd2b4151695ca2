/* How often each kernel is launched and how long it runs, seen from outside.
 *
 * A program that links profile.c has its calls of clCreateCommandQueue and clEnqueueNDRangeKernel go through it, the
 * library's own too, so the library itself need not know of profiling. */
#ifndef TESTS_BENCH_PROFILE_H
#define TESTS_BENCH_PROFILE_H

#include <stdbool.h>

enum { PROFILE_KERNELS = 32 };

struct profile_kernel {
    char name[64];
    int launches;
    double seconds; /* on the device, of the launches that are done */
};

struct profile {
    struct profile_kernel kernels[PROFILE_KERNELS]; /* as first launched */
    int count;
};

/* Count launches from now on, or no longer; at first none is counted. */
void profile_count(bool on);

/* Forget what was counted. */
void profile_clear(void);

/* What was counted since then; waits until it is done. */
struct profile profile_read(void);

#endif
