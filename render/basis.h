/* The smooth kernels of a material as sums of a few: light of many surface points is then summed up whatever kernels
 * they have. What is known of how fast the few vary bounds what the summing up may cost.
 *
 * Layouts single and pair: g_a(b, d) ~ sum_r U(a, r) basis_r(b, d), by the singular value decomposition of the kernels
 * of each colour, a being x_i's cluster and b x_o's (0 in layout single). A lane is a pair of r and colour, 3 r + c, and a
 * row is a term. Layout term: exact; one row, and a lane is a pair of term and colour, 4 t + c. */
#ifndef RENDER_BASIS_H
#define RENDER_BASIS_H

#include "nacre/error.h"

#include <stdbool.h>
#include <stddef.h>

struct appearance;

enum { BASIS_STEPS_A_POINT = 2 };

struct basis {
    int vectors; /* of 16 lanes */
    int rows;
    int parts;    /* basis kernels of one colour: r, or terms */
    int columns;  /* 1, or clusters in layout pair */
    float *table; /* [columns][side][side][16 * vectors], side = K + 2 as in appearance.h */
    float *share; /* U: [clusters][16 * vectors]; NULL in layout term */
    float *rest;  /* largest |g_a - sum_r|, [clusters][3]; NULL in layout term */
    float *top_h; /* largest H of the material: [rows][16 * vectors] */
    /* At all offsets of `step` half surface points or more, [steps][parts]: the basis kernels' largest change over one
     * surface point, their largest second difference, and their largest change with direction, their largest size; [steps]: the part of
     * `rest` that is left there. */
    int steps;
    float *slope, *bend, *swing, *size, *left;
};

/* Work it out; the appearance's factors, kernels and clusters are made. */
int basis_make(struct basis *basis, const struct appearance *appearance, struct nacre_error *error);
void basis_finish(struct basis *basis);

/* Which part lane `lane` belongs to, or -1 for one that is not used. */
int basis_part(const struct basis *basis, bool per_term, int lane);

#endif
