/* Whether a material is one: the same questions before writing and after reading. Private to
 * libnacre. */
#ifndef NACRE_MATERIAL_CHECK_H
#define NACRE_MATERIAL_CHECK_H

#include "nacre/material.h"

/* Refuse sizes that cannot be, with a text that names them. */
int material_check_sizes(const struct nacre_material *material, struct nacre_error *error);

/* Refuse values that no model has: factors, kernels and centres that are negative, not finite or
 * too large for HALF, ids that name no kernel or the same one twice, weights that do not sum to 1.
 * The text names part, channel, point. */
int material_check_values(const struct nacre_material *material, struct nacre_error *error);

#endif
