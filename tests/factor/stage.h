/* The method terms on a sample, and what it holds. */
#ifndef TESTS_FACTOR_STAGE_H
#define TESTS_FACTOR_STAGE_H

#include "sample.h"

#include "factor/terms.h"

struct stage {
    struct responses responses;
    struct terms_data data;
    struct problem problem;
    struct method *method;
    uint32_t *kinds;
    float *kernels, *planes, *numbers;
    size_t points, terms;
};

/* Room, then the method itself; both end the test where they fail. */
struct stage stage_open(const struct opencl *opencl, const struct sample *sample, int terms);
void stage_begin(const struct opencl *opencl, struct stage *stage);

/* Read planes and numbers of channel 0. */
void stage_read(struct stage *stage);
void stage_close(struct stage *stage);

#endif
