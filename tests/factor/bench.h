/* What the tests of methods share: a problem around a sample, running a method on it, the same in double precision. */
#ifndef TESTS_FACTOR_BENCH_H
#define TESTS_FACTOR_BENCH_H

#include "reference.h"
#include "sample.h"

#include "factor/method.h"

/* A problem whose clusters are columns of points and whose kernels differ in width. */
struct bench {
    struct responses responses;
    struct problem problem;
    uint32_t *ids;
    float *kernels;
    struct method *method; /* made by the test */
    size_t count;          /* floats of one factor */
    float *f, *h;
};

struct bench bench_new(const struct sample *sample, int terms, int clusters, int lanes);
void bench_finish(struct bench *b);

/* Ends the test with the error's text unless status is NACRE_OK. */
void bench_succeed(int status, const struct nacre_error *error);

/* Read the factors of a channel into b->f and b->h. */
void bench_read(struct bench *b, int channel);

/* So many steps of every channel, asking for the objective in every second one. */
void bench_run(struct bench *b, int count);

/* F and H of channel 0 one behind the other, in memory the caller frees. */
float *bench_factors(struct bench *b);

/* The same problem in double, of one channel, with the factors read last. bench_reference_finish frees it. */
struct reference bench_reference(const struct bench *b, int channel);
void bench_reference_finish(struct reference *reference);

#endif
