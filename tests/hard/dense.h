/* Weighted non-negative matrix factorization with dense matrices, as section 5.3 writes it before W is chosen; shares
 * nothing with factor/ or with the other references. */
#ifndef TESTS_HARD_DENSE_H
#define TESTS_HARD_DENSE_H

#include <stddef.h>

/* All matrices are [points][points], row i: light enters at point i; f: [points][terms], h: [terms][points]. */
struct dense {
    size_t points, terms;
    double *r, *g,
        *w; /* responses, homogeneous part, weights; w = 0: outside the window or not measured */
    double *f, *h;
};

/* F <- F * ((W^2 * G * R) H^T) / ((W^2 * G * ((F H) * G)) H^T), and H likewise; 0 where the denominator is. */
void dense_update_f(struct dense *dense);
void dense_update_h(struct dense *dense);

#endif
