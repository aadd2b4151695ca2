/* Minimising a smooth function of numbers of which some must not be negative: limited-memory BFGS on the free ones,
 * steps bent along the bounds, and the curvature's diagonal as its first metric. */
#ifndef TESTS_BENCH_REPRESENTATIONS_MINIMISE_H
#define TESTS_BENCH_REPRESENTATIONS_MINIMISE_H

#include <stdbool.h>
#include <stddef.h>

struct function {
    size_t count;
    bool signs; /* numbers may be negative */
    void *data;
    /* Its value at x. Where they are not NULL: its gradient, and the positive diagonal of a metric near its curvature. */
    double (*evaluate)(void *data, const double *x, double *gradient, double *diagonal);
};

struct minimise_limits {
    int iterations;
    double progress; /* ends when 20 iterations lower the value by less than this share */
};

/* Go down from x, which becomes where it ends. The value never rises. Returns the value there; *iterations becomes how
 * many it took. */
double minimise(const struct function *function, const struct minimise_limits *limits, double *x,
                int *iterations);

#endif
