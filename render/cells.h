/* Light samples sorted into small cubes, each also summed up for receivers that are not near. */
#ifndef RENDER_CELLS_H
#define RENDER_CELLS_H

#include "nacre/error.h"
#include "render/samples.h"

#include <stddef.h>
#include <stdint.h>

/* A cube of side `cell_mm`. */
struct cell {
    float centre[3];                   /* of the samples' box */
    float radius_mm;                   /* half the diagonal of the samples' box */
    uint32_t sample_begin, sample_end; /* in cells.samples */
    uint32_t merged_begin, merged_end; /* in cells.merged */
};

/* A cube of four cells' side. */
struct block {
    float low[3], high[3]; /* of its samples */
    uint32_t cell_begin, cell_end;
};

struct cells {
    size_t sample_count, merged_count, cell_count, block_count;
    /* Lit samples, cell by cell; and in each cell one sample for all that lie on the same surface point of the
     * material, at their mean position by flux. */
    struct light_sample *samples, *merged;
    struct cell *cells;
    struct block *blocks;
};

/* Sort the samples that carry flux. */
int cells_make(struct cells *cells, const struct light_samples *samples, double cell_mm,
               struct nacre_error *error);
void cells_finish(struct cells *cells);

/* Interleave the bits of cell coordinates, so that neighbours in space are neighbours in the order. */
uint64_t cells_key(const float position[3], const float origin[3], double cell_mm);

#endif
