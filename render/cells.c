/* Sorting samples by place and by surface point, and the nodes of the tree. */
#include "render/cells.h"

#include "render/moments.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    CUBE_POINTS = 16,
    BYTES = 8,
    FINE = 8 /* steps of the texture's curve to a surface point */
};

struct keyed {
    uint64_t high; /* chart and side that it faces, cube in space */
    uint64_t low;  /* place in the texture */
    uint32_t index;
};

/* Bits of a 16-bit number, two zeros between each; of a 24-bit number, one zero between each. */
static uint64_t spread_three(uint64_t v)
{
    uint64_t out = 0;
    for (unsigned bit = 0; bit < 16; bit++) {
        out |= (v >> bit & 1) << (3 * bit);
    }
    return out;
}

static uint64_t spread_two(uint64_t v)
{
    v &= 0xffffff;
    v = (v | v << 16) & UINT64_C(0x0000ffff0000ffff);
    v = (v | v << 8) & UINT64_C(0x00ff00ff00ff00ff);
    v = (v | v << 4) & UINT64_C(0x0f0f0f0f0f0f0f0f);
    v = (v | v << 2) & UINT64_C(0x3333333333333333);
    return (v | v << 1) & UINT64_C(0x5555555555555555);
}

/* The axis, of six, that a normal is nearest to. */
static unsigned facing(const float normal[3])
{
    int axis = 0;
    for (int k = 1; k < 3; k++) {
        axis = fabsf(normal[k]) > fabsf(normal[axis]) ? k : axis;
    }
    return 2U * (unsigned)axis + (normal[axis] < 0);
}

static struct keyed key_of(const struct light_sample *sample, size_t index, const float origin[3],
                           double cube_mm)
{
    struct keyed key = {.index = (uint32_t)index};
    uint64_t cube = 0;
    for (unsigned k = 0; k < 3; k++) {
        double place = floor(((double)sample->position[k] - (double)origin[k]) / cube_mm);
        cube |= spread_three((uint64_t)fmin(fmax(place, 0), 0xffff)) << k;
    }
    key.high = ((uint64_t)(uint32_t)sample->chart * 6 + facing(sample->normal)) << 48 | cube;
    /* 2^20 surface points to either side, in eighths. */
    double x = floor((double)sample->x * FINE) + 0x800000,
           y = floor((double)sample->y * FINE) + 0x800000;
    key.low = spread_two((uint64_t)fmin(fmax(x, 0), 0xffffff)) |
              spread_two((uint64_t)fmin(fmax(y, 0), 0xffffff)) << 1;
    return key;
}

/* One pass of a radix sort, stable. Returns whether anything moved. */
static int sort_by_byte(const struct keyed *from, struct keyed *to, size_t count, int byte)
{
    size_t starts[257] = {0};
    unsigned shift = 8U * (unsigned)(byte % BYTES);
    for (size_t i = 0; i < count; i++) {
        uint64_t key = byte < BYTES ? from[i].low : from[i].high;
        starts[(key >> shift & 0xff) + 1]++;
    }
    for (size_t i = 0; i < 256; i++) {
        if (starts[i + 1] == count) {
            return 0;
        }
        starts[i + 1] += starts[i];
    }
    for (size_t i = 0; i < count; i++) {
        uint64_t key = byte < BYTES ? from[i].low : from[i].high;
        to[starts[key >> shift & 0xff]++] = from[i];
    }
    return 1;
}

/* Keys of the lit samples in order; their number goes to *count. */
static struct keyed *sort_samples(const struct light_samples *samples, double point_mm,
                                  size_t *count)
{
    struct keyed *keys = calloc(samples->count + 1, sizeof *keys);
    struct keyed *other = calloc(samples->count + 1, sizeof *other);
    float origin[3] = {HUGE_VALF, HUGE_VALF, HUGE_VALF};
    *count = 0;
    for (size_t i = 0; i < samples->count; i++) {
        for (int k = 0; k < 3; k++) {
            origin[k] = fminf(origin[k], samples->list[i].position[k]);
        }
    }
    for (size_t i = 0; keys && other && i < samples->count; i++) {
        const float *flux = samples->list[i].flux;
        if (flux[0] + flux[1] + flux[2] > 0) {
            keys[(*count)++] = key_of(&samples->list[i], i, origin, CUBE_POINTS * point_mm);
        }
    }
    for (int byte = 0; keys && other && byte < 2 * BYTES; byte++) {
        if (sort_by_byte(keys, other, *count, byte)) {
            struct keyed *swapped = keys;
            keys = other;
            other = swapped;
        }
    }
    if (!other) {
        free(keys);
        return NULL;
    }
    free(other);
    return keys;
}

/* What the tree is being built from and into. */
struct growth {
    struct cells *cells;
    const struct keyed *keys;
    struct moments *moments;
    size_t node_capacity;
    bool failed;
};

/* Places of the texture's curve that a square of `level` takes. */
static unsigned bits_of(int level)
{
    return 2U * (unsigned)(level - CELLS_LEVEL_BOTTOM);
}

static bool same_square(const struct growth *growth, size_t a, size_t b, int level)
{
    return growth->keys[a].low >> bits_of(level) == growth->keys[b].low >> bits_of(level);
}

static uint32_t add_nodes(struct growth *growth, size_t count)
{
    struct cells *cells = growth->cells;
    while (cells->node_count + count > growth->node_capacity) {
        size_t capacity = growth->node_capacity * 2 + 4096;
        struct cell_node *nodes = realloc(cells->nodes, capacity * sizeof *nodes);
        float *bounds =
            nodes ? realloc(cells->bounds, capacity * growth->moments->bound_size * sizeof *bounds)
                  : NULL;
        cells->nodes = nodes ? nodes : cells->nodes;
        cells->bounds = bounds ? bounds : cells->bounds;
        if (!nodes || !bounds || capacity > UINT32_MAX) {
            growth->failed = true;
            return 0;
        }
        growth->node_capacity = capacity;
    }
    cells->node_count += count;
    return (uint32_t)(cells->node_count - count);
}

static double brightness(const struct light_sample *sample)
{
    return (double)sample->flux[0] + (double)sample->flux[1] + (double)sample->flux[2];
}

/* All samples of a node as one, at their mean place by brightness. */
static struct light_sample sum_up(const struct light_sample *samples, size_t count)
{
    struct light_sample whole = samples[0];
    double position[3] = {0}, normal[3] = {0}, flux[3] = {0}, x = 0, y = 0, total = 0, area = 0;
    for (size_t i = 0; i < count; i++) {
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
    double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (int k = 0; k < 3; k++) {
        whole.position[k] = (float)(position[k] / total);
        whole.normal[k] = (float)(normal[k] / (length > 0 ? length : 1));
        whole.flux[k] = (float)flux[k];
    }
    whole.x = (float)(x / total);
    whole.y = (float)(y / total);
    whole.area_mm2 = (float)area;
    return whole;
}

/* Where a node's samples lie about its place. */
static void measure(struct cell_node *node, const struct light_sample *samples,
                    const struct light_sample *whole)
{
    float radius = 0, apart = 0, flat = 0, half_x = 0, half_y = 0;
    for (size_t i = node->sample_begin; i < node->sample_end; i++) {
        const struct light_sample *s = &samples[i];
        float square = 0, turned = 0, off = 0;
        for (int k = 0; k < 3; k++) {
            float away = s->position[k] - whole->position[k];
            float turn = s->normal[k] - whole->normal[k];
            square += away * away;
            turned += turn * turn;
            off += away * whole->normal[k];
        }
        radius = square > radius ? square : radius;
        apart = turned > apart ? turned : apart;
        flat = fabsf(off) > flat ? fabsf(off) : flat;
        half_x = fabsf(s->x - whole->x) > half_x ? fabsf(s->x - whole->x) : half_x;
        half_y = fabsf(s->y - whole->y) > half_y ? fabsf(s->y - whole->y) : half_y;
    }
    memcpy(node->position, whole->position, sizeof node->position);
    memcpy(node->normal, whole->normal, sizeof node->normal);
    node->radius_mm = sqrtf(radius);
    node->apart = sqrtf(apart);
    node->flat_mm = flat;
    node->x = whole->x;
    node->y = whole->y;
    node->half_x = half_x;
    node->half_y = half_y;
    node->chart = whole->chart;
}

static void fill_node(struct growth *growth, uint32_t index, size_t begin, size_t end, int level,
                      int depth, uint32_t parent);

/* Nodes for the squares of one level that a node's samples lie on. */
static void add_children(struct growth *growth, uint32_t index, int level, int depth)
{
    struct cell_node *node = &growth->cells->nodes[index];
    size_t begin = node->sample_begin, end = node->sample_end, count = 1, place = 0;
    for (size_t i = begin + 1; i < end; i++) {
        count += !same_square(growth, i - 1, i, level);
    }
    uint32_t first = add_nodes(growth, count);
    if (growth->failed) {
        return;
    }
    node = &growth->cells->nodes[index];
    node->child_begin = first;
    node->child_end = first + (uint32_t)count;
    for (size_t i = begin + 1; i <= end && !growth->failed; i++) {
        if (i == end || !same_square(growth, i - 1, i, level)) {
            fill_node(growth, first + (uint32_t)place++, begin, i, level, depth + 1, index);
            begin = i;
        }
    }
}

static float *bounds_of(const struct growth *growth, uint32_t index)
{
    return growth->cells->bounds + index * growth->moments->bound_size;
}

static const struct cell_node *node_at(const struct growth *growth, uint32_t index)
{
    return index == UINT32_MAX ? NULL : &growth->cells->nodes[index];
}

static void fill_square(struct growth *growth, uint32_t index, int level, int depth,
                        uint32_t parent)
{
    moments_open(growth->moments, depth);
    add_children(growth, index, level - 1, depth);
    if (growth->failed) {
        return;
    }
    struct cell_node *node = &growth->cells->nodes[index];
    size_t number = moments_close(growth->moments, node, depth, node_at(growth, parent),
                                  bounds_of(growth, index));
    growth->failed = number >= UINT32_MAX;
    node->source = (uint32_t)number;
}

static void fill_point(struct growth *growth, uint32_t index, const struct light_sample *whole,
                       int level, int depth, uint32_t parent)
{
    struct cells *cells = growth->cells;
    struct cell_node *node = &cells->nodes[index];
    const struct cell_node *above = node_at(growth, parent);
    node->source = (uint32_t)cells->point_count;
    cells->points[cells->point_count++] = *whole;
    moments_point(growth->moments, cells->points, node, whole, depth, above,
                  bounds_of(growth, index));
    if (!above || above->level > 0) {
        moments_count(growth->moments, whole);
    }
    size_t last = node->sample_end - 1;
    while (level > CELLS_LEVEL_BOTTOM && same_square(growth, node->sample_begin, last, level - 1)) {
        level--;
    }
    if (level > CELLS_LEVEL_BOTTOM && last - node->sample_begin > 1) {
        add_children(growth, index, level - 1, depth);
    }
}

static void fill_node(struct growth *growth, uint32_t index, size_t begin, size_t end, int level,
                      int depth, uint32_t parent)
{
    struct cells *cells = growth->cells;
    while (level > 0 && same_square(growth, begin, end - 1, level - 1)) {
        level--; /* nothing in the other squares */
    }
    struct cell_node *node = &cells->nodes[index];
    struct light_sample whole = sum_up(cells->points + begin, end - begin);
    *node = (struct cell_node){
        .level = level, .sample_begin = (uint32_t)begin, .sample_end = (uint32_t)end};
    measure(node, cells->points, &whole);
    if (level > 0) {
        fill_square(growth, index, level, depth, parent);
    } else {
        fill_point(growth, index, &whole, level, depth, parent);
    }
}

static bool same_root(const struct keyed *a, const struct keyed *b)
{
    return a->high == b->high &&
           a->low >> bits_of(CELLS_LEVEL_TOP) == b->low >> bits_of(CELLS_LEVEL_TOP);
}

static void grow(struct growth *growth)
{
    struct cells *cells = growth->cells;
    const struct keyed *keys = growth->keys;
    size_t count = cells->sample_count, begin = 0, root = 0;
    for (size_t i = 0; i < count; i++) {
        cells->root_count += i == 0 || !same_root(&keys[i], &keys[i - 1]);
    }
    (void)add_nodes(growth, cells->root_count);
    for (size_t i = 1; i <= count && !growth->failed; i++) {
        if (i == count || !same_root(&keys[i], &keys[i - 1])) {
            fill_node(growth, (uint32_t)root++, begin, i, CELLS_LEVEL_TOP, 0, UINT32_MAX);
            begin = i;
        }
    }
}

int cells_make(struct cells *cells, const struct light_samples *samples,
               const struct appearance *appearance, double point_mm, struct nacre_error *error)
{
    int status = NACRE_FAILED;
    size_t count;
    struct moments moments = {0};
    struct keyed *keys = sort_samples(samples, point_mm, &count);
    struct growth growth = {.cells = cells, .keys = keys, .moments = &moments};
    *cells = (struct cells){.sample_count = count, .point_count = count};
    /* A tree whose inner nodes have two children or more has fewer than twice as many nodes as leaves. */
    cells->points = calloc(3 * count + 16, sizeof *cells->points);
    if (!keys || !cells->points || moments_begin(&moments, appearance, point_mm) != NACRE_OK) {
        (void)nacre_fail_memory(error, "sorting the light samples");
        goto out;
    }
    for (size_t i = 0; i < count; i++) {
        cells->points[i] = samples->list[keys[i].index];
    }
    grow(&growth);
    if (growth.failed) {
        (void)nacre_fail_memory(error, "summing up the light samples");
        goto out;
    }
    cells->moments = moments.list;
    cells->moment_count = moments.count;
    cells->moment_size = moments.size;
    cells->brightness =
        fmax(moments.brightness[0], fmax(moments.brightness[1], moments.brightness[2]));
    moments.list = NULL;
    status = NACRE_OK;
out:
    free(keys);
    moments_end(&moments);
    if (status != NACRE_OK) {
        cells_finish(cells);
    }
    return status;
}

void cells_finish(struct cells *cells)
{
    free(cells->points);
    free(cells->nodes);
    free(cells->moments);
    free(cells->bounds);
    *cells = (struct cells){0};
}
