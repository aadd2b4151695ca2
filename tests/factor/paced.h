/* A real method whose steps take time on a clock that tests own, and can be watched and stopped. */
#ifndef TESTS_FACTOR_PACED_H
#define TESTS_FACTOR_PACED_H

#include "factor/factorize.h"

struct paced {
    struct clock clock; /* for factor_options.clock */
    int64_t now_ns;
    struct method_maker maker; /* for factor_options.maker */
    const struct opencl *opencl;
    enum factor_method method;
    double seconds_per_term; /* an iteration of all channels takes this times its terms */
    int slow_from; /* 1-based iteration from which on it takes slow_factor times as long; 0: never */
    double slow_factor;
    int cancel_at;           /* iteration that the user stops the run before; 0: none */
    int fail_at, fail_until; /* iterations that cannot be made, if not 0 */
    int iterations;          /* begun so far, of all methods made */
    double longest;          /* iteration so far, in seconds */
    void (*before)(void *data, int iteration); /* called before each; may be NULL */
    void *data;
};

/* Fill it in; set the other members as needed. The clock starts at 1000 s. */
void paced_begin(struct paced *paced, const struct opencl *opencl, enum factor_method method);

/* Seconds since then. */
double paced_seconds(const struct paced *paced);

/* Let the options use clock and methods. */
void paced_apply(struct paced *paced, struct factor_options *options);

#endif
