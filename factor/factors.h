/* The factors F and H of all channels at rest in memory: to start a method with, to measure, to make a material of. */
#ifndef FACTOR_FACTORS_H
#define FACTOR_FACTORS_H

#include "factor/method.h"

struct factors {
    int width, height, channels, terms;
    float *f[RESPONSES_CHANNELS], *h[RESPONSES_CHANNELS]; /* [terms][height][width], scaled units;
                                                             * h NULL: H = F; f NULL: the first's */
    int numbers;                                          /* of a kernel, with a kernel per term */
    float *kernels[RESPONSES_CHANNELS];                   /* [terms][numbers], else NULL */
};

/* Make room for the factors of a problem. The caller calls factors_finish, also after a failure. */
int factors_allocate(struct factors *factors, const struct problem *problem,
                     struct nacre_error *error);
void factors_finish(struct factors *factors); /* zeroed ones are allowed */

/* Copy factors of the same sizes. */
void factors_copy(struct factors *to, const struct factors *from);

/* Copy a method's factors, and give it these. */
int factors_read(struct factors *factors, struct method *method, struct nacre_error *error);
int factors_write(const struct factors *factors, struct method *method, struct nacre_error *error);

/* Fill `to` from factors of another number of terms: of more those that weigh most; behind fewer come random ones, small
 * enough to change the model by about a hundredth. */
int factors_fit(const struct factors *from, uint64_t seed, struct factors *to,
                struct nacre_error *error);

#endif
