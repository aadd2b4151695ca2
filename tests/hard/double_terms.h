/* The objective of a kernel per term in double precision, from planes and kernels, entry by entry. */
#ifndef TESTS_HARD_DOUBLE_TERMS_H
#define TESTS_HARD_DOUBLE_TERMS_H

#include "factor/terms_data.h"

/* Planes and kernels as the method's `read` and `read_kernels` give them, all channels sharing the planes. */
struct double_terms {
    const struct terms_data *data;
    int terms;
    const float *f, *h;                       /* [terms][height][width]; h: NULL where it is f */
    const float *numbers[RESPONSES_CHANNELS]; /* [terms][numbers of a kernel] */
};

struct double_objective {
    double objective; /* in the responses' own unit, what no model can take away included */
    double energy;    /* of a model that is 0 */
    double
        slope; /* largest, over terms and channels, by which the objective changes with the size of a kernel, over the root of
                   * its energy and the responses': 0 where kernels are best for the planes */
};

struct double_objective double_terms_objective(const struct double_terms *model);

#endif
