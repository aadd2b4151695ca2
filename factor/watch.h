/* A look at a factorization while it runs, for what studies which iteration buys how much. */
#ifndef FACTOR_WATCH_H
#define FACTOR_WATCH_H

#include "nacre/error.h"

#include <stdbool.h>

struct attempt;

/* A factorization as it is after one of its iterations. */
struct factor_look {
    const struct attempt *attempt; /* whose factors have been read */
    int iterations;
    double
        seconds; /* of the run so far: neither looks nor compiling count, but what others had prepared does */
    bool last; /* one of the run's own criteria ends it here */
};

/* With a watcher the run makes no material of its own. Looking changes no bit of what follows. */
struct factor_watcher {
    /* Whether to look after so many iterations; it is looked after the last one in any case. */
    bool (*wants)(void *data, int iterations);
    /* Look, and set *stop to end the run. */
    int (*look)(void *data, const struct factor_look *look, bool *stop, struct nacre_error *error);
    void *data;
};

#endif
