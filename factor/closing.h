/* What closes a factorization: factors become a material, rounded as it is stored, whose error is measured. */
#ifndef FACTOR_CLOSING_H
#define FACTOR_CLOSING_H

#include "factor/attempt.h"
#include "factor/factorize.h"
#include "factor/probe.h"

/* Make the material of an attempt's factors (method and history are the caller's to fill in) and measure it as it is
 * stored. The caller finishes both. */
int closing_make(const struct factor_options *options, double pitch_mm,
                 const struct attempt *attempt, struct nacre_material *material,
                 struct error_report *report, struct nacre_error *error);

/* Errors of a few points, with planes as fitted, of the fewest bits, and of the bits that were chosen. */
struct closing_rounding {
    double fitted, coarsest, rounded;
};

/* The fewest bits whose rounding adds less than a set share to the error of the attempt's factors: 8, 10, or 0. */
int closing_choose_bits(const struct probe *probe, const struct attempt *attempt, int *bits,
                        struct closing_rounding *rounding, struct nacre_error *error);

/* Do the costly part of closing_make for a few rows of points of a blank material and forget the result. *share is the
 * share of the whole that this was. */
int closing_rehearse(const struct factor_options *options, const struct attempt *attempt,
                     double *share, struct nacre_error *error);

/* Round planes with a kernel each as closing_make will, and forget the result; nothing where there are none. */
int closing_rehearse_rounding(const struct attempt *attempt, struct nacre_error *error);

/* Seconds that starting and ending the program and writing so many bytes take, taking the disk for a slow one. */
double closing_write_seconds(double bytes);

#endif
