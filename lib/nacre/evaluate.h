/* Evaluating and importance-sampling a material: what a renderer needs of it. */
#ifndef NACRE_EVALUATE_H
#define NACRE_EVALUATE_H

#include "nacre/material.h"

/* R_d(x_i, x_o) of the model in one channel; 0 outside the window or the sample. Points are (x, y) and must be inside
 * the sample for x_i. */
float nacre_material_evaluate(const struct nacre_material *material, int channel, int xi, int yi,
                              int xo, int yo);

/* The whole response of x_i = (x, y): response[channels][K][K], laid out as in scan.h. */
void nacre_material_response(const struct nacre_material *material, int x, int y, float *response);

/* Choose where light that enters at x_i leaves, in proportion to the response in `channel`, from two numbers u[2]
 * uniform in [0, 1). Writes x_o and the probability of having chosen it; returns the response's sum (the albedo of
 * x_i), or 0 with x_o = x_i and probability 0 where nothing leaves. R_d / probability is the constant albedo. */
float nacre_material_sample(const struct nacre_material *material, int channel, int xi, int yi,
                            const float u[2], int *xo, int *yo, float *probability);

/* Sampling a material with a kernel per term at a cost of M and not of M K^2: tables made once of its kernels. */
struct nacre_sampler;

/* Make the tables, 8 bytes for each number of the kernels. Refuses layouts other than NACRE_KERNEL_PER_TERM. The material must
 * outlive the sampler and stay as it is; nacre_sampler_free. Several threads may draw from one sampler. */
int nacre_sampler_new(const struct nacre_material *material, struct nacre_sampler **sampler,
                      struct nacre_error *error);

/* Choose where light that enters at x_i leaves, in `channel`, from two numbers u[2] uniform in [0, 1): first a term in
 * proportion to F(x_i, t) sum(g_t) mean(H(t, .)), or the centre in proportion to c(x_i), then x_o - x_i from the term's
 * kernel. Writes x_o, which may lie outside the sample, and returns a weight: the mean of weight * f(x_o) over u is the sum of
 * R_d(x_i, x_o) f(x_o) over x_o, for any f. It is 0 outside the sample, and with x_o = x_i where nothing leaves. */
float nacre_sampler_draw(const struct nacre_sampler *sampler, int channel, int xi, int yi,
                         const float u[2], int *xo, int *yo);

/* The probability of choosing x_o, whatever the term; it sums to 1 over the window, or is 0 where nothing leaves. R_d divided by
 * it is a weight of less variance, also for other channels than the one that chose; it costs M more multiply-adds. */
float nacre_sampler_probability(const struct nacre_sampler *sampler, int channel, int xi, int yi,
                                int xo, int yo);

void nacre_sampler_free(struct nacre_sampler *sampler); /* NULL is allowed */

#endif
