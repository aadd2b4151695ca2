/* The reciprocal forms that study compares: a sum over terms or pairs of terms of planes at both ends and a kernel between
 * them, or the square of one.
 *
 *     s(x_i, x_o) = sum over a, b of u_a(x_i) k_ab(x_o - x_i) u_b(x_o),   R = s or s^2, plus c(x_i) where x_o = x_i
 *
 * with k_ba(-d) = k_ab(d), a = b alone where pairs are not asked for. Planes are shared by the colour channels, kernels and c
 * are not. Nothing is negative, but for the square everything may be. */
#ifndef TESTS_BENCH_REPRESENTATIONS_BILINEAR_H
#define TESTS_BENCH_REPRESENTATIONS_BILINEAR_H

#include "entries.h"
#include "minimise.h"

#include <stdint.h>

struct bilinear_form {
    int terms;
    bool pairs, squared, radial;
};

struct bilinear {
    struct bilinear_form form;
    int width, height, channels, window;
    int kernels; /* of a channel */
    int places;  /* numbers of a kernel */
    int count;   /* of products a, b, each with its kernel and, for one used backwards too, none */
    int *a, *b, *id; /* [count] */
    int *place;      /* [K][K]: of each distance, the number of the kernel that holds there */
    size_t numbers;
    double *planes; /* [terms][height][width], the beginning of all numbers */
    double *kernel; /* [channels][kernels][places], the rest of them */
    double *centre; /* [channels][height][width] */
    double objective;
    int iterations;
};

/* Fit a form to entries that were folded. `seed` is of where it starts. bilinear_finish. */
void bilinear_fit(const struct entries *entries, struct bilinear_form form, uint64_t seed,
                  const struct minimise_limits *limits, struct bilinear *fit);

/* All responses, [height][width][channels][K][K]; 0 outside the sample. */
void bilinear_predict(const struct bilinear *fit, float *responses);

/* Round planes to `bits` bits in square root (where they have signs, as they are), the centre in its logarithm, and kernels
 * to half floats; and the bytes that this takes. */
void bilinear_quantise(struct bilinear *fit, int bits);
size_t bilinear_bytes(const struct bilinear *fit, int bits);

void bilinear_finish(struct bilinear *fit);

#endif
