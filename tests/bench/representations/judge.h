/* How far modelled responses are from measured ones and from what the measurement hides behind its noise. */
#ifndef TESTS_BENCH_REPRESENTATIONS_JUDGE_H
#define TESTS_BENCH_REPRESENTATIONS_JUDGE_H

#include "sample.h"

/* Mean over the points of ||measured - model|| / ||measured||, with and without x_o = x_i. */
struct errors {
    double whole, without_centre;
};
struct errors judge_errors(const struct sample *sample, const float *model);

/* ||S - model|| / ||S|| over all x_o other than x_i, S the noise-free response. Where it is known, of a model of all that was
 * measured; elsewhere, of a model of `kept`, by what was left out of it (factor/cross.h). */
double judge_noise_free(const struct sample *sample, const float *model);

/* ||measured - S|| / ||S|| of the same entries. */
double judge_noise(const struct sample *sample);

#endif
