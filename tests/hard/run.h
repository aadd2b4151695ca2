/* One hard case run by one method: the figures that tell whether it stayed stable. */
#ifndef TESTS_HARD_RUN_H
#define TESTS_HARD_RUN_H

#include "collection.h"

#include "factor/factorize.h"

#include <stdbool.h>

/* What is worst over all channels and steps. Energies and objectives are half sums of squares over the kernels, summed
 * in double precision from the factors themselves. */
struct hard_figures {
    bool finite, positive; /* all of F, H and the objective; F, H >= 0 */
    double rise;           /* of the objective in one step, beyond hard_noise, over what it was */
    double device; /* what the device calls the objective, less what it is, over what is allowed */
    double energy; /* of the responses: the objective of a model that is 0 */
    double objective; /* at the end */
    double reference; /* of the same method in double precision */
    int refusals;     /* steps that the method took back, in double precision */
};

/* Of a model of single precision: roundings of 2^-24 in a model that fits the responses. A step may raise the objective,
 * and the device misjudge it, by this share of the energy. */
double hard_noise(void);

/* Clusters, kernels and so many steps of the method, with responses held as floats or half floats; the same in double
 * precision. Ends the test where anything fails. With FACTOR_WEIGHT_RESPONSE cases of one channel alone. */
struct hard_how {
    enum factor_method method;
    enum factor_weight weight;
    bool half;
};
struct hard_figures hard_run(const struct hard_case *hard, const struct opencl *opencl,
                             struct hard_how how);

/* F and H of channel 0 after the steps, one behind the other, in memory that the caller frees: float[*count]. With
 * `dirty` garbage lies behind the mask; *changed entries of it. */
float *hard_factors(const struct sample *sample, const struct hard_case *hard,
                    const struct opencl *opencl, struct hard_how how, bool dirty, size_t *count,
                    size_t *changed);

/* The whole way from responses to a material as read back from its file, whose error summary->error holds. The caller
 * finishes both. */
void hard_material(const struct sample *sample, const struct hard_case *hard,
                   const struct opencl *opencl, struct hard_how how, enum factor_store store,
                   struct nacre_material *material, struct factor_summary *summary);

/* Write a material to a file, read it back and remove it. */
void hard_pass_through_file(struct nacre_material *material);

#endif
