/* The problems of the benchmarks: the paper's sizes, and what a thousand of its updates reach there. */
#ifndef TESTS_BENCH_CASES_H
#define TESTS_BENCH_CASES_H

#include "field.h"

#include "factor/attempt.h"

enum { CASE_UPDATES = 1000, CASE_PREFIX = 20, CASE_CHANNELS = 3 };

/* A problem and its goal. The goal is what CASE_UPDATES multiplicative updates reach: half an hour for all cases, so it
 * is not measured in each run but kept in cases.c, as the samples, the clusters and the first factors come from seeds.
 * Whether it still belongs to them is seen from the objective after the first CASE_PREFIX updates, which each run makes
 * anyway, and for the smallest case by making all of them. */
struct bench_case {
    const char *name;
    enum field_kind kind;
    int width, height, window, channels, terms, clusters;
    /* In the responses' unit, summed over channels: after CASE_PREFIX and after CASE_UPDATES updates. 0: not known, and
     * the updates alone are timed. */
    double prefix, goal;
};

/* Objectives agree that far from device to device, and after any change that is not of the problem itself. */
#define CASE_TOLERANCE 1e-3

/* All cases; the first is the smallest. Ends with one without a name. */
extern const struct bench_case cases[];

/* The case with that name, channels and clusters, or NULL. */
const struct bench_case *case_find(const char *name, int channels, int clusters);

/* The samples' seed. */
enum { CASE_SEED = 1 };

/* A case's responses, with the clusters, kernels and seeds that factorize() gives them. */
struct case_problem {
    struct responses responses;
    struct attempt attempt;
};

/* With the responses as half floats or floats. Ends the program after an error. The problem points into *made, which must
 * stay where it is. */
void case_make(const struct bench_case *c, int lanes, bool half, struct case_problem *made);
void case_finish(struct case_problem *made);

/* The first channel's responses in scaled units, window by window: [height][width][K][K], 0 outside the sample. Heap. */
float *case_windows(const struct case_problem *made);

/* The sum over channels of a method's objective, in the responses' unit. */
double case_objective(const struct case_problem *made, struct method *method);

#endif
