/* Making a material of factors: units, balance, points without measurement, albedo. */
#ifndef FACTOR_ASSEMBLE_H
#define FACTOR_ASSEMBLE_H

#include "factor/factors.h"

#include "nacre/material.h"

/* Fill the planes of an allocated material (hard clusters) from factors, the problem's kernels and clusters.
 * ids are complete; F and H are spread from measured points to those of which nothing was measured. */
int assemble_material(const struct problem *problem, const struct factors *factors,
                      struct nacre_material *material, struct nacre_error *error);

/* known[height][width]: points of which something was measured in this channel, as x_i, or (outgoing) as x_o. */
void assemble_known(const struct responses *responses, int channel, bool outgoing, uint8_t *known);

/* albedo[height][width]: the sum of each response of a channel, in its own unit; NaN where nothing of it was measured. */
void assemble_albedo(const struct responses *responses, int channel, float *albedo);

#endif
