/* The smooth kernels of a material as sums of a few: light of many surface points is then summed up whatever kernels
 * they have.
 *
 * Layouts single and pair: g_a(b, d) ~ sum_r U(a, r) basis_r(b, d), by the singular value decomposition of the kernels
 * of each colour, a being x_i's cluster and b x_o's (0 in layout single). Layout term: basis_t is the kernel of term t. */
#ifndef RENDER_BASIS_H
#define RENDER_BASIS_H

#include "nacre/error.h"

#include <stddef.h>

struct appearance;

struct basis {
    int parts;    /* basis kernels, or terms */
    int columns;  /* 1, or clusters in layout pair */
    float *table; /* [columns][side][side][parts][4], side = K + 2 as in appearance.h */
    float *share; /* U: [clusters][parts][4]; NULL in layout term */
    int steps;
    double *
        bend; /* by distance in surface points: the kernels' second differences there over the kernels' sum */
};

/* Work it out; the appearance's factors, kernels and clusters are made. */
int basis_make(struct basis *basis, const struct appearance *appearance, struct nacre_error *error);
void basis_finish(struct basis *basis);

#endif
