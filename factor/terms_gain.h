/* Gains that a scan has left at both ends, found by its reciprocal pairs. */
#ifndef FACTOR_TERMS_GAIN_H
#define FACTOR_TERMS_GAIN_H

#include "factor/terms_data.h"

/* Resolve options.reciprocity: measure what pairs differ by, fit a smooth gain where that is asked for or (TERMS_AUTO)
 * explains it, and fill `gain`, `asymmetry` and `asymmetry_left`. */
int terms_gain_find(struct terms_data *data, struct nacre_error *error);

#endif
