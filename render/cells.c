/* Sorting samples into cubes along a Morton curve and merging them. */
#include "render/cells.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct keyed {
    uint64_t key;
    uint32_t texel, index;
};

/* Bits of a 21-bit number, two zeros between each. */
static uint64_t spread_bits(uint64_t v)
{
    v &= 0x1fffff;
    v = (v | v << 32) & UINT64_C(0x1f00000000ffff);
    v = (v | v << 16) & UINT64_C(0x1f0000ff0000ff);
    v = (v | v << 8) & UINT64_C(0x100f00f00f00f00f);
    v = (v | v << 4) & UINT64_C(0x10c30c30c30c30c3);
    return (v | v << 2) & UINT64_C(0x1249249249249249);
}

uint64_t cells_key(const float position[3], const float origin[3], double cell_mm)
{
    uint64_t key = 0;
    for (unsigned k = 0; k < 3; k++) {
        double cell = floor(((double)position[k] - origin[k]) / cell_mm);
        key |= spread_bits((uint64_t)fmin(fmax(cell, 0), 0x1fffff)) << k;
    }
    return key;
}

static int compare_keyed(const void *a, const void *b)
{
    const struct keyed *one = a, *two = b;
    if (one->key != two->key) {
        return one->key < two->key ? -1 : 1;
    }
    if (one->texel != two->texel) {
        return one->texel < two->texel ? -1 : 1;
    }
    return one->index < two->index ? -1 : one->index > two->index; /* the same order every time */
}

static double brightness(const struct light_sample *sample)
{
    return (double)sample->flux[0] + sample->flux[1] + sample->flux[2];
}

/* One sample in place of samples[begin..end), which share surface point and chart. */
static struct light_sample merge(const struct light_sample *samples, size_t begin, size_t end)
{
    struct light_sample merged = samples[begin];
    double position[3] = {0}, normal[3] = {0}, flux[3] = {0}, x = 0, y = 0, total = 0, area = 0;
    for (size_t i = begin; i < end; i++) {
        double weight = brightness(&samples[i]);
        for (int k = 0; k < 3; k++) {
            position[k] += weight * samples[i].position[k];
            normal[k] += weight * samples[i].normal[k];
            flux[k] += samples[i].flux[k];
        }
        x += weight * samples[i].x;
        y += weight * samples[i].y;
        area += samples[i].area_mm2;
        total += weight;
    }
    for (int k = 0; k < 3; k++) {
        merged.position[k] = (float)(position[k] / total);
        merged.normal[k] = (float)(normal[k] / total);
        merged.flux[k] = (float)flux[k];
    }
    merged.x = (float)(x / total);
    merged.y = (float)(y / total);
    merged.area_mm2 = (float)area;
    return merged;
}

/* Whether two samples of one cell may be summed up: on the same spot of the material and facing alike. */
static bool alike(const struct light_sample *a, const struct light_sample *b)
{
    double facing = (double)a->normal[0] * b->normal[0] + (double)a->normal[1] * b->normal[1] +
                    (double)a->normal[2] * b->normal[2];
    return a->texel == b->texel && a->chart == b->chart && facing > 0 && fabsf(a->x - b->x) < 4 &&
           fabsf(a->y - b->y) < 4;
}

static void add_cell(struct cells *cells, size_t begin, size_t end)
{
    struct cell *cell = &cells->cells[cells->cell_count++];
    float low[3], high[3];
    memcpy(low, cells->samples[begin].position, sizeof low);
    memcpy(high, low, sizeof high);
    cell->sample_begin = (uint32_t)begin;
    cell->sample_end = (uint32_t)end;
    cell->merged_begin = (uint32_t)cells->merged_count;
    for (size_t i = begin; i < end;) {
        size_t next = i;
        for (; next < end && alike(&cells->samples[i], &cells->samples[next]); next++) {
            for (int k = 0; k < 3; k++) {
                low[k] = fminf(low[k], cells->samples[next].position[k]);
                high[k] = fmaxf(high[k], cells->samples[next].position[k]);
            }
        }
        cells->merged[cells->merged_count++] = merge(cells->samples, i, next);
        i = next;
    }
    cell->merged_end = (uint32_t)cells->merged_count;
    double square = 0;
    for (int k = 0; k < 3; k++) {
        cell->centre[k] = (low[k] + high[k]) / 2;
        square += ((double)high[k] - low[k]) * ((double)high[k] - low[k]) / 4;
    }
    cell->radius_mm = (float)sqrt(square);
}

static void add_block(struct cells *cells, size_t begin, size_t end)
{
    struct block *block = &cells->blocks[cells->block_count++];
    block->cell_begin = (uint32_t)begin;
    block->cell_end = (uint32_t)end;
    memcpy(block->low, cells->samples[cells->cells[begin].sample_begin].position,
           sizeof block->low);
    memcpy(block->high, block->low, sizeof block->high);
    for (size_t i = cells->cells[begin].sample_begin; i < cells->cells[end - 1].sample_end; i++) {
        for (int k = 0; k < 3; k++) {
            block->low[k] = fminf(block->low[k], cells->samples[i].position[k]);
            block->high[k] = fmaxf(block->high[k], cells->samples[i].position[k]);
        }
    }
}

/* Keys of the lit samples in order; their number goes to *count. */
static struct keyed *sort_samples(const struct light_samples *samples, double cell_mm,
                                  size_t *count)
{
    struct keyed *order = calloc(samples->count + 1, sizeof *order);
    float origin[3] = {HUGE_VALF, HUGE_VALF, HUGE_VALF};
    *count = 0;
    for (size_t i = 0; i < samples->count; i++) {
        for (int k = 0; k < 3; k++) {
            origin[k] = fminf(origin[k], samples->list[i].position[k]);
        }
    }
    for (size_t i = 0; order && i < samples->count; i++) {
        const struct light_sample *sample = &samples->list[i];
        if (brightness(sample) > 0) {
            order[(*count)++] = (struct keyed){cells_key(sample->position, origin, cell_mm),
                                               sample->texel, (uint32_t)i};
        }
    }
    if (order) {
        qsort(order, *count, sizeof *order, compare_keyed);
    }
    return order;
}

int cells_make(struct cells *cells, const struct light_samples *samples, double cell_mm,
               struct nacre_error *error)
{
    int status = NACRE_FAILED;
    size_t count, cell_begin = 0, block_begin = 0;
    struct keyed *order = sort_samples(samples, cell_mm, &count);
    *cells = (struct cells){.sample_count = count};
    cells->samples = calloc(count + 1, sizeof *cells->samples);
    cells->merged = calloc(count + 1, sizeof *cells->merged);
    cells->cells = calloc(count + 1, sizeof *cells->cells);
    cells->blocks = calloc(count + 1, sizeof *cells->blocks);
    if (!order || !cells->samples || !cells->merged || !cells->cells || !cells->blocks) {
        (void)nacre_fail_memory(error, "sorting the light samples");
        goto out;
    }
    for (size_t i = 0; i < count; i++) {
        cells->samples[i] = samples->list[order[i].index];
    }
    for (size_t i = 1; i <= count; i++) {
        if (i == count || order[i].key != order[i - 1].key) {
            add_cell(cells, cell_begin, i);
            cell_begin = i;
            /* Dropping two bits an axis: 4 x 4 x 4 cells share the rest of the key. */
            if (i == count || order[i].key >> 6 != order[i - 1].key >> 6) {
                add_block(cells, block_begin, cells->cell_count);
                block_begin = cells->cell_count;
            }
        }
    }
    status = NACRE_OK;
out:
    free(order);
    if (status != NACRE_OK) {
        cells_finish(cells);
    }
    return status;
}

void cells_finish(struct cells *cells)
{
    free(cells->samples);
    free(cells->merged);
    free(cells->cells);
    free(cells->blocks);
    *cells = (struct cells){0};
}
