/* Sorting by rows. */
#include "render/convolve_rows.h"

#include <stdlib.h>

int convolve_rows_make(struct convolve_rows *rows, int first, int row_count, const int32_t *row,
                       size_t count, struct nacre_error *error)
{
    *rows = (struct convolve_rows){.first = first,
                                   .count = row_count,
                                   .starts = calloc((size_t)row_count + 2, sizeof *rows->starts),
                                   .order = malloc((count + 1) * sizeof *rows->order)};
    if (!rows->starts || !rows->order) {
        convolve_rows_finish(rows);
        (void)nacre_fail_memory(error, "the light in the texture");
        return NACRE_FAILED;
    }
    uint32_t *at = rows->starts + 1, sum = 0; /* ends up as the starts, one row on */
    for (size_t i = 0; i < count; i++) {
        if (row[i] != INT32_MIN) {
            at[row[i] - first]++;
        }
    }
    for (int i = 0; i < row_count; i++) {
        uint32_t own = at[i];
        at[i] = sum;
        sum += own;
    }
    for (size_t i = 0; i < count; i++) {
        if (row[i] != INT32_MIN) {
            rows->order[at[row[i] - first]++] = (uint32_t)i;
        }
    }
    return NACRE_OK;
}

void convolve_rows_finish(struct convolve_rows *rows)
{
    free(rows->starts);
    free(rows->order);
    *rows = (struct convolve_rows){0};
}
