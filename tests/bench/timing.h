/* What the benchmarks share: times, medians, and the rate of sgemm to compare with. */
#ifndef TESTS_BENCH_TIMING_H
#define TESTS_BENCH_TIMING_H

#include <stddef.h>

enum { SGEMM_SIZE = 1536 };

/* A moment in wall time and in processor time of the whole process. */
struct moment {
    double wall, processor;
};

struct moment timing_now(void);
struct moment timing_since(struct moment start);

/* Sorts the values. */
double timing_median(double *values, int count);

/* The matrices of one sgemm of SGEMM_SIZE, and the time it takes. */
struct sgemm {
    float *a, *b, *c;
};
struct sgemm sgemm_new(void);
struct moment sgemm_run(const struct sgemm *sgemm);
void sgemm_finish(struct sgemm *sgemm);

/* Entries x_i, x_o inside a sample for all points. */
double entries_inside(int width, int height, int window);

/* End the program with one sentence; and zeroed memory, or the end of the program. */
void fail(const char *text) __attribute__((noreturn));
void *allocate(size_t bytes);

#endif
