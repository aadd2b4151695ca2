/* One hard case run with a kernel per term: the figures that tell whether it stayed stable. */
#ifndef TESTS_HARD_TERMS_RUN_H
#define TESTS_HARD_TERMS_RUN_H

#include "collection.h"

#include "factor/factorize.h"

#include <stdbool.h>

/* How planes start. */
enum hard_start {
    HARD_AS_FOUND,
    HARD_DEAD,       /* the last term is 0 */
    HARD_IDENTICAL,  /* the last term is the first */
    HARD_RECIPROCAL, /* as found; pairs are taken for two measurements of one number */
    HARD_WHOLE,      /* so too, and each step visits all entries */
};

/* What is worst over all steps. Objectives are summed in double precision from planes and kernels. */
struct hard_terms_figures {
    bool finite, positive;
    double rise;   /* of the objective in one step, beyond hard_noise, over what it was */
    double device; /* what the device calls the objective, less what it is, over what is allowed */
    double slope;  /* how far kernels are from the best for their planes: double_terms.h */
    double energy, objective; /* of no model; at the end */
    int reach;                /* of the steps that do not visit all entries */
};

/* With so many terms and steps; 0: the case's own. */
struct hard_terms_figures hard_terms_run(const struct hard_case *hard, const struct opencl *opencl,
                                         enum hard_start start, int terms, int steps);

/* The whole way to a material with planes of so many bits as read back from its file. The caller finishes both. */
void hard_terms_material(const struct hard_case *hard, int bits, const struct opencl *opencl,
                         struct nacre_material *material, struct factor_summary *summary);

#endif
