/* Making a material of planes with a kernel each: units, quantised planes, the centre, points without measurement. */
#ifndef FACTOR_TERMS_MATERIAL_H
#define FACTOR_TERMS_MATERIAL_H

#include "factor/factors.h"

#include "nacre/material.h"

/* Room for the material of a problem with a kernel per term, planes of so many bits, 0: half floats. */
int terms_material_allocate(int seed, int bits, double pitch_mm, const struct problem *problem,
                            struct nacre_material *material, struct nacre_error *error);

/* Fill it, as the file will have it. */
int terms_material_fill(const struct problem *problem, const struct factors *factors,
                        struct nacre_material *material, struct nacre_error *error);

/* Planes in place by those that the file will hold. */
int terms_material_round(const struct problem *problem, int bits, struct factors *factors,
                         struct nacre_error *error);

#endif
