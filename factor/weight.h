/* Minimising relative errors: the weight W = 1 / ||R_i|| of section 5.3 in place of the paper's 1 / sqrt(g).
 *
 * With w_i = n / ||R_i||, the norm that of all channels and n a power of two near its mean, R' = w_i R and F' = w_i F,
 * the objective is half the sum of (R' - g F' H)^2 / n^2. The methods minimise half the sum of (X - k S)^2 / k: they are
 * given X = g R' and k = g^2. */
#ifndef FACTOR_WEIGHT_H
#define FACTOR_WEIGHT_H

#include "factor/method.h"

/* Make a method that lets another, made by `make`, minimise relative errors. Holds the weighted responses as floats
 * beside the problem's own; refuses where memory is short. Objectives are half the sum of squared relative errors,
 * whatever the responses' unit. Keeps what `problem` points at. */
int weight_new(const struct problem *problem,
               int (*make)(void *data, const struct problem *problem, struct method **method,
                           struct nacre_error *error),
               void *data, struct method **method, struct nacre_error *error);

#endif
