/* Samples and receivers of a patch by rows of the texture. */
#ifndef RENDER_CONVOLVE_ROWS_H
#define RENDER_CONVOLVE_ROWS_H

#include "nacre/error.h"

#include <stddef.h>
#include <stdint.h>

struct convolve_rows {
    int first;        /* number of the first row */
    int count;        /* of rows */
    uint32_t *starts; /* [count + 1] */
    uint32_t *order;
};

/* Sort indices 0 ... count - 1 into the rows that row[i] tells; those in no row (INT32_MIN) are left out. */
int convolve_rows_make(struct convolve_rows *rows, int first, int row_count, const int32_t *row,
                       size_t count, struct nacre_error *error);
void convolve_rows_finish(struct convolve_rows *rows);

/* Indices of rows begin ... end - 1, as far as there are any, from order[*from] to before order[*to]. */
static inline void convolve_rows_between(const struct convolve_rows *rows, int begin, int end,
                                         size_t *from, size_t *to)
{
    int low = begin - rows->first, high = end - rows->first;
    low = low < 0 ? 0 : low > rows->count ? rows->count : low;
    high = high < low ? low : high > rows->count ? rows->count : high;
    *from = rows->starts ? rows->starts[low] : 0;
    *to = rows->starts ? rows->starts[high] : 0;
}

#endif
