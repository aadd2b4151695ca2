/* How far planes with a kernel each would lower the objective by fitting the scan's noise. */
#ifndef FACTOR_TERMS_NOISE_H
#define FACTOR_TERMS_NOISE_H

#include "factor/factors.h"

/* In the responses' own unit, of a few hundred points spread over the sample. 0 where pairs do not tell the noise: where
 * they are not reciprocal or only one of each was measured. */
double terms_noise_gain(const struct terms_data *data, const struct factors *factors);

#endif
