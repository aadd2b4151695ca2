/* The paper's model with soft weights: every surface point mixes all kernels,
 * R = (sum_t F(x_i, t) H(t, x_o)) sum_j w_j(x_i) g_j(x_o - x_i), all of it fitted together. */
#ifndef TESTS_BENCH_REPRESENTATIONS_SOFT_H
#define TESTS_BENCH_REPRESENTATIONS_SOFT_H

#include "entries.h"
#include "minimise.h"

#include "nacre/material.h"

/* Fit it to entries that were not folded, from a material with hard clusters. *soft becomes a material of layout "single"
 * that mixes all clusters' kernels; nacre_material_finish it. Returns how many iterations it took. */
int soft_fit(const struct entries *entries, const struct nacre_material *hard,
             const struct minimise_limits *limits, struct nacre_material *soft);

#endif
