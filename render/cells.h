/* Light samples sorted by place and by surface point of the material, each group also summed up for
 * receivers that are not near. */
#ifndef RENDER_CELLS_H
#define RENDER_CELLS_H

#include "nacre/error.h"
#include "render/samples.h"

#include <stddef.h>
#include <stdint.h>

/* The samples of one block that lie on the same surface point of the material and face alike. */
struct cell {
    float centre[3];                     /* of the samples' box */
    float radius_mm;                     /* half the diagonal of the samples' box */
    uint32_t sample_begin, sample_end;   /* in cells.samples */
    uint32_t quarter_begin, quarter_end; /* in cells.quarters */
};

/* A cube in space, four surface points wide. */
struct block {
    float low[3], high[3]; /* of its samples */
    uint32_t cell_begin, cell_end;
};

struct cells {
    size_t sample_count, quarter_count, cell_count, block_count;
    struct light_sample *samples;  /* those that are lit, cell by cell */
    struct light_sample *quarters; /* one for each quarter of a surface point, where its light is */
    struct light_sample *wholes;   /* one for each cell */
    struct cell *cells;
    struct block *blocks;
};

/* Sort the samples that carry flux. */
int cells_make(struct cells *cells, const struct light_samples *samples, double point_mm,
               struct nacre_error *error);
void cells_finish(struct cells *cells);

/* Interleave the bits of the coordinates of cubes, so that neighbours in space are neighbours in
 * the order. */
uint64_t cells_key(const float position[3], const float origin[3], double cube_mm);

#endif
