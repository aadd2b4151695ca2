/* The error against the noise-free response, which nobody measured: of each reciprocal pair R(x_i, x_o), R(x_o, x_i) one
 * is fitted, and the other, whose noise the model has not seen, is the judge. */
#ifndef FACTOR_CROSS_H
#define FACTOR_CROSS_H

#include "factor/factorize.h"

/* Sums over pairs that were both measured, all channels, so without the centre. */
struct cross_report {
    size_t pairs;
    double error; /* ||S - factored|| / ||S||, S the noise-free response; 0 where noise hides it */
    double noise; /* ||R - S|| / ||S|| */
};

/* Leave one of each pair out of a copy of the responses, chosen by lot for each pair; what has no counterpart stays.
 * Belongs to the caller, who calls responses_finish. Refuses where memory is short. */
int cross_halve(const struct responses *responses, struct responses *kept,
                struct nacre_error *error);

/* Judge a material that was made of the kept ones by those that were left out. */
int cross_judge(const struct responses *responses, const struct nacre_material *material,
                struct cross_report *report, struct nacre_error *error);

/* All of it, with a material made by these options. A gain at both ends, [height][width] or NULL, which a half of the pairs
 * does not tell, is divided out before: noise is then told relative to responses without it. */
int cross_measure(const struct responses *responses, const float *gain, double pitch_mm,
                  const struct factor_options *options, const struct opencl *opencl,
                  struct progress *progress, struct cross_report *report,
                  struct nacre_error *error);

#endif
