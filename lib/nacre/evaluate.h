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

#endif
