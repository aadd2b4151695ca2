/* A method and the paper's updates on one problem, in turns with sgemm, until the method reaches the goal. */
#ifndef TESTS_BENCH_RACE_H
#define TESTS_BENCH_RACE_H

#include "cases.h"
#include "profile.h"
#include "timing.h"

#include "base/opencl.h"

struct race {
    const struct bench_case *of;
    double flops;           /* useful ones of an update: 12 T for each entry inside the sample */
    struct moment product;  /* a run of sgemm, median */
    struct moment update;   /* one of our updates, median */
    struct moment peer;     /* one of the plain program's */
    struct moment descent;  /* hals, from the start to the goal */
    int steps;              /* its steps; 0: the goal was not reached */
    double prefix;          /* the objective after CASE_PREFIX updates, and ... */
    double reached;         /* ... that of hals at the end */
    struct profile profile; /* of its kernels */
};

/* Run it, with responses as half floats or floats; up to a minute. Ends the program after an error. */
struct race race_run(const struct bench_case *c, bool half, const struct opencl *opencl);

/* sgemm's rate in this race, flops a second of wall and of processor time. */
struct moment race_sgemm(const struct race *race);

/* The baseline that does not depend on how good our updates are: the time of CASE_UPDATES updates at 45 % of sgemm's
 * rate. */
struct moment race_pinned(const struct race *race);

#endif
