/* The paper's updates in double precision, written from section 5.3 as it stands and sharing nothing with factor/. */
#ifndef TESTS_FACTOR_REFERENCE_H
#define TESTS_FACTOR_REFERENCE_H

#include <stdbool.h>
#include <stdint.h>

/* One channel. Responses and kernels are in the units of the caller; nothing is owned. */
struct reference {
    int width, height, window, terms;
    double *responses;   /* [height][width][K][K], NaN where not measured */
    const uint32_t *ids; /* [height][width] */
    double *kernels;     /* [clusters][K][K] */
    double *f, *h;       /* [terms][height][width] */
};

/* Update F (or H) by the rules of section 5.3 before they are simplified, with W^2 = 1 / g; a negative response belongs
 * to the denominator. */
void reference_update(struct reference *reference, bool of_h);

/* Set F (or H) of each point by `sweeps` passes of coordinate descent on its normal equations, the same weights. */
void reference_descend(struct reference *reference, bool of_h, int sweeps);

/* Half the weighted squared error. */
double reference_objective(const struct reference *reference);

/* sum_t F H g of one pair of points, x_o = x_i + (dx, dy). */
double reference_model(const struct reference *reference, int x, int y, int dx, int dy);

#endif
