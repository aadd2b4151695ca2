/* Planes of few different values, stored as the numbers of these. Private to libnacre.
 *
 * Half floats below 2^-14 are whole multiples of 2^-24: number k is k * 2^-24, whose second byte is 0 and costs a compressed
 * file next to nothing. Evenly spaced roots or logarithms are told by the part's attribute nacre.roots or nacre.logarithms in
 * a few numbers; of others nacre.values lists them all. */
#ifndef NACRE_MATERIAL_LEVELS_H
#define NACRE_MATERIAL_LEVELS_H

#include "nacre/exr_file.h"

#include <stdbool.h>

/* Put numbers in place of the values of all planes of a part, NaN aside, unless there are more than 2^bits different
 * ones. *numbered: done. */
int levels_number(struct exr_part *part, int bits, bool *numbered, struct nacre_error *error);

/* Put the values back, where a part is numbered. */
int levels_restore(struct exr_part *part, struct nacre_error *error);

#endif
