/* Planes of few different values, stored as the numbers of these. Private to libnacre.
 *
 * Half floats below 2^-14 are whole multiples of 2^-24: number k is k * 2^-24, whose second byte is 0 and costs a compressed
 * file next to nothing. The part's attribute nacre.values holds the values, the number's in its place. */
#ifndef NACRE_MATERIAL_LEVELS_H
#define NACRE_MATERIAL_LEVELS_H

#include "nacre/exr_file.h"

#include <stdbool.h>

/* Put numbers in place of the values of all planes of a part, NaN aside, unless there are more than `most` different
 * ones. *numbered: done. */
int levels_number(struct exr_part *part, size_t most, bool *numbered, struct nacre_error *error);

/* Put the values back, where a part is numbered. */
int levels_restore(struct exr_part *part, struct nacre_error *error);

#endif
