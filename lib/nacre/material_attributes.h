/* The attributes of material.exr. Private to libnacre. */
#ifndef NACRE_MATERIAL_ATTRIBUTES_H
#define NACRE_MATERIAL_ATTRIBUTES_H

#include "nacre/exr_file.h"
#include "nacre/material.h"

/* Add them to the first part. Fails only where memory runs out, without a text. */
int material_add_attributes(struct exr_part *part, bool numbered,
                            const struct nacre_material *material);

/* Read them from the first part into *material, whose planes are untouched; sizes are not yet checked. */
int material_read_attributes(const struct exr_part *first, struct nacre_material *material,
                             struct nacre_error *error);

#endif
