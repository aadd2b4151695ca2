/* Sorting samples into cubes along a Morton curve and by surface point, and summing them up. */
#include "render/cells.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BLOCK_POINTS = 4 };

struct keyed {
    uint64_t block;
    int32_t kind; /* chart and the axis that the normal is nearest to */
    int32_t x, y; /* unwrapped surface point */
    int32_t quarter;
    uint32_t index;
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

uint64_t cells_key(const float position[3], const float origin[3], double cube_mm)
{
    uint64_t key = 0;
    for (unsigned k = 0; k < 3; k++) {
        double cube = floor(((double)position[k] - (double)origin[k]) / cube_mm);
        key |= spread_bits((uint64_t)fmin(fmax(cube, 0), 0x1fffff)) << k;
    }
    return key;
}

static int compare(int64_t a, int64_t b)
{
    return (a > b) - (a < b);
}

static int compare_keyed(const void *a, const void *b)
{
    const struct keyed *one = a, *two = b;
    if (one->block != two->block) {
        return one->block < two->block ? -1 : 1;
    }
    int order = compare(one->kind, two->kind);
    order = order ? order : compare(one->y, two->y);
    order = order ? order : compare(one->x, two->x);
    order = order ? order : compare(one->quarter, two->quarter);
    return order ? order : compare(one->index, two->index); /* the same order every time */
}

static bool same_cell(const struct keyed *a, const struct keyed *b)
{
    return a->block == b->block && a->kind == b->kind && a->x == b->x && a->y == b->y;
}

static double brightness(const struct light_sample *sample)
{
    return (double)sample->flux[0] + (double)sample->flux[1] + (double)sample->flux[2];
}

/* One sample in place of samples[begin..end), at their mean place by flux. */
static struct light_sample sum_up(const struct light_sample *samples, size_t begin, size_t end)
{
    struct light_sample whole = samples[begin];
    double position[3] = {0}, normal[3] = {0}, flux[3] = {0}, x = 0, y = 0, total = 0, area = 0;
    for (size_t i = begin; i < end; i++) {
        double weight = brightness(&samples[i]);
        for (int k = 0; k < 3; k++) {
            position[k] += weight * (double)samples[i].position[k];
            normal[k] += weight * (double)samples[i].normal[k];
            flux[k] += (double)samples[i].flux[k];
        }
        x += weight * (double)samples[i].x;
        y += weight * (double)samples[i].y;
        area += (double)samples[i].area_mm2;
        total += weight;
    }
    for (int k = 0; k < 3; k++) {
        whole.position[k] = (float)(position[k] / total);
        whole.normal[k] = (float)(normal[k] / total);
        whole.flux[k] = (float)flux[k];
    }
    whole.x = (float)(x / total);
    whole.y = (float)(y / total);
    whole.area_mm2 = (float)area;
    return whole;
}

/* Grow a box from begin's place to those of samples[begin..end). */
static void box_of(const struct light_sample *samples, size_t begin, size_t end, float low[3],
                   float high[3])
{
    memcpy(low, samples[begin].position, sizeof samples->position);
    memcpy(high, samples[begin].position, sizeof samples->position);
    for (size_t i = begin; i < end; i++) {
        for (int k = 0; k < 3; k++) {
            low[k] = fminf(low[k], samples[i].position[k]);
            high[k] = fmaxf(high[k], samples[i].position[k]);
        }
    }
}

static void add_cell(struct cells *cells, const struct keyed *order, size_t begin, size_t end)
{
    struct cell *cell = &cells->cells[cells->cell_count];
    float low[3], high[3];
    double square = 0;
    cells->wholes[cells->cell_count++] = sum_up(cells->samples, begin, end);
    cell->sample_begin = (uint32_t)begin;
    cell->sample_end = (uint32_t)end;
    cell->quarter_begin = (uint32_t)cells->quarter_count;
    for (size_t i = begin; i < end;) {
        size_t next = i + 1;
        while (next < end && order[next].quarter == order[i].quarter) {
            next++;
        }
        cells->quarters[cells->quarter_count++] = sum_up(cells->samples, i, next);
        i = next;
    }
    cell->quarter_end = (uint32_t)cells->quarter_count;
    box_of(cells->samples, begin, end, low, high);
    for (int k = 0; k < 3; k++) {
        double side = (double)high[k] - (double)low[k];
        cell->centre[k] = (low[k] + high[k]) / 2;
        square += side * side / 4;
    }
    cell->radius_mm = (float)sqrt(square);
}

static void add_block(struct cells *cells, size_t begin, size_t end)
{
    struct block *block = &cells->blocks[cells->block_count++];
    block->cell_begin = (uint32_t)begin;
    block->cell_end = (uint32_t)end;
    box_of(cells->samples, cells->cells[begin].sample_begin, cells->cells[end - 1].sample_end,
           block->low, block->high);
}

/* The axis, of six, that a normal is nearest to. */
static int facing(const float normal[3])
{
    int axis = 0;
    for (int k = 1; k < 3; k++) {
        axis = fabsf(normal[k]) > fabsf(normal[axis]) ? k : axis;
    }
    return 2 * axis + (normal[axis] < 0);
}

/* Keys of the lit samples in order; their number goes to *count. */
static struct keyed *sort_samples(const struct light_samples *samples, double point_mm,
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
        float x = floorf(sample->x), y = floorf(sample->y);
        if (brightness(sample) > 0) {
            order[(*count)++] = (struct keyed){
                .block = cells_key(sample->position, origin, BLOCK_POINTS * point_mm),
                .kind = sample->chart * 6 + facing(sample->normal),
                .x = (int32_t)x,
                .y = (int32_t)y,
                .quarter = (sample->x - x >= 0.5F) + 2 * (sample->y - y >= 0.5F),
                .index = (uint32_t)i,
            };
        }
    }
    if (order) {
        qsort(order, *count, sizeof *order, compare_keyed);
    }
    return order;
}

int cells_make(struct cells *cells, const struct light_samples *samples, double point_mm,
               struct nacre_error *error)
{
    int status = NACRE_FAILED;
    size_t count, cell_begin = 0, block_begin = 0;
    struct keyed *order = sort_samples(samples, point_mm, &count);
    *cells = (struct cells){.sample_count = count};
    cells->samples = calloc(count + 1, sizeof *cells->samples);
    cells->quarters = calloc(count + 1, sizeof *cells->quarters);
    cells->wholes = calloc(count + 1, sizeof *cells->wholes);
    cells->cells = calloc(count + 1, sizeof *cells->cells);
    cells->blocks = calloc(count + 1, sizeof *cells->blocks);
    if (!order || !cells->samples || !cells->quarters || !cells->wholes || !cells->cells ||
        !cells->blocks) {
        (void)nacre_fail_memory(error, "sorting the light samples");
        goto out;
    }
    for (size_t i = 0; i < count; i++) {
        cells->samples[i] = samples->list[order[i].index];
    }
    for (size_t i = 1; i <= count; i++) {
        if (i == count || !same_cell(&order[i], &order[i - 1])) {
            add_cell(cells, order, cell_begin, i);
            cell_begin = i;
            if (i == count || order[i].block != order[i - 1].block) {
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
    free(cells->quarters);
    free(cells->wholes);
    free(cells->cells);
    free(cells->blocks);
    *cells = (struct cells){0};
}
