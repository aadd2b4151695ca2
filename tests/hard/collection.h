/* The collection of hard cases: small samples, each with one thing that makes factoring it hard. */
#ifndef TESTS_HARD_COLLECTION_H
#define TESTS_HARD_COLLECTION_H

#include "sample.h"

#include <stddef.h>

struct hard_case {
    const char *name;
    const char *what; /* one sentence: what is hard about it */
    int width, height, channels, window;
    int terms, clusters;
    int steps;                             /* of each method; 0: 40 */
    double epsilon;                        /* of the kernels; 0: 1e-5 */
    void (*change)(struct sample *sample); /* what the ordinary sample lacks; NULL: nothing */
    double error; /* the mean relative error that its material may have; 0: 1, that of no model */
};

extern const struct hard_case hard_cases[];
extern const size_t hard_case_count;

/* By its name; ends the test where there is none. */
const struct hard_case *hard_case_of(const char *name);

/* Its responses; the caller calls sample_finish. */
struct sample hard_sample(const struct hard_case *hard);

int hard_steps(const struct hard_case *hard);
double hard_epsilon(const struct hard_case *hard);
double hard_error(const struct hard_case *hard);

#endif
