/* Rounding numbers to what files would hold of them. */
#ifndef TESTS_BENCH_REPRESENTATIONS_QUANTISE_H
#define TESTS_BENCH_REPRESENTATIONS_QUANTISE_H

#include "nacre/material.h"

#include <stddef.h>

/* To 2^bits values from 0 to the greatest, even in their square roots. */
void quantise_root(double *values, size_t count, int bits);

/* To 2^bits values between the least and the greatest. */
void quantise_evenly(double *values, size_t count, int bits);

/* To 0 and 2^bits - 1 values between the least above 1e-3 of the greatest and the greatest, even in their logarithms. */
void quantise_logarithm(double *values, size_t count, int bits);

/* To half floats, after a power of two that makes the greatest one of the largest they hold. */
void quantise_half(double *values, size_t count);

/* The planes F and H of the paper's model in their square roots, kernels to half floats; sets `bits`. */
void quantise_material(struct nacre_material *material, int bits);

#endif
