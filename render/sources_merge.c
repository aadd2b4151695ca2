/* Groups of sources by place in the texture, and in space where they are apart. */
#include "render/sources_merge.h"

#include "render/groups.h"
#include "render/sources_place.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* What is added up of one group. */
struct heap {
    double weight, position[3], normal[3], x, y, flux[3], square, radius_square;
    int32_t chart;
    uint32_t texel;
    bool parted;
};

/* One set being summed up to the next. */
struct merge {
    const struct source_set *from;
    double size; /* of the squares, points */
    double point_mm;
    uint32_t *numbers; /* of each source's group */
    struct groups groups;
    struct heap *heaps;
};

static struct group_key key_of(const struct merge *merge, const struct source *source)
{
    return (struct group_key){source->chart, sources_cell((double)source->x, merge->size),
                              sources_cell((double)source->y, merge->size), 0};
}

static void add_to_heap(struct heap *heap, const struct source *source)
{
    double weight = sources_brightness(source->flux);
    heap->weight += weight;
    heap->x += weight * (double)source->x;
    heap->y += weight * (double)source->y;
    for (int k = 0; k < 3; k++) {
        heap->position[k] += weight * (double)source->position[k];
        heap->normal[k] += weight * (double)source->normal[k];
        heap->flux[k] += (double)source->flux[k];
    }
    heap->chart = source->chart;
    heap->texel = source->texel;
}

static void measure(struct heap *heap, const struct source *source)
{
    double square = 0;
    for (int k = 0; k < 3; k++) {
        double away = (double)source->position[k] - heap->position[k];
        square += away * away;
    }
    heap->square += sources_brightness(source->flux) * square;
    heap->radius_square = fmax(heap->radius_square, square);
}

/* Sum up the sources by their numbers. */
static int fill_heaps(struct merge *merge)
{
    free(merge->heaps);
    merge->heaps = calloc(merge->groups.count + 1, sizeof *merge->heaps);
    if (!merge->heaps) {
        return -1;
    }
    for (size_t i = 0; i < merge->from->count; i++) {
        add_to_heap(&merge->heaps[merge->numbers[i]], &merge->from->list[i]);
    }
    for (size_t i = 0; i < merge->groups.count; i++) {
        struct heap *heap = &merge->heaps[i];
        double scale = heap->weight > 0 ? 1 / heap->weight : 0;
        heap->x *= scale;
        heap->y *= scale;
        for (int k = 0; k < 3; k++) {
            heap->position[k] *= scale;
            heap->normal[k] *= scale;
        }
    }
    for (size_t i = 0; i < merge->from->count; i++) {
        measure(&merge->heaps[merge->numbers[i]], &merge->from->list[i]);
    }
    return 0;
}

static bool must_part(const struct merge *merge, const struct heap *heap)
{
    double most = SOURCES_WIDEST * merge->size * merge->point_mm, length = 0;
    for (int k = 0; k < 3; k++) {
        length += heap->normal[k] * heap->normal[k];
    }
    return heap->radius_square > most * most || length < SOURCES_STRAIGHTEST * SOURCES_STRAIGHTEST;
}

/* Groups by place in the texture; those that are not compact once more by place in space. */
static int group(struct merge *merge)
{
    bool any = false;
    if (groups_begin(&merge->groups, merge->from->count / 2) != 0) {
        return -1;
    }
    struct group_key last = {0};
    for (size_t i = 0; i < merge->from->count; i++) { /* often in the group of the one before */
        struct group_key key = key_of(merge, &merge->from->list[i]);
        bool same = i > 0 && key.kind == last.kind && key.x == last.x && key.y == last.y;
        merge->numbers[i] = same ? merge->numbers[i - 1] : groups_number(&merge->groups, key);
        last = key;
        if (merge->numbers[i] == GROUPS_FULL) {
            return -1;
        }
    }
    if (fill_heaps(merge) != 0) {
        return -1;
    }
    for (size_t i = 0; i < merge->groups.count; i++) {
        merge->heaps[i].parted = must_part(merge, &merge->heaps[i]);
        any = any || merge->heaps[i].parted;
    }
    if (!any) {
        return 0;
    }
    groups_end(&merge->groups);
    if (groups_begin(&merge->groups, merge->from->count / 2) != 0) {
        return -1;
    }
    for (size_t i = 0; i < merge->from->count; i++) {
        const struct source *source = &merge->from->list[i];
        struct group_key key = key_of(merge, source);
        key.part =
            merge->heaps[merge->numbers[i]].parted
                ? groups_part(source->position, source->normal, merge->size * merge->point_mm)
                : 0;
        merge->numbers[i] = groups_number(&merge->groups, key);
        if (merge->numbers[i] == GROUPS_FULL) {
            return -1;
        }
    }
    return fill_heaps(merge);
}

static struct source source_of(const struct heap *heap)
{
    struct source source = {
        .x = (float)heap->x, .y = (float)heap->y, .chart = heap->chart, .texel = heap->texel};
    double length = 0;
    for (int k = 0; k < 3; k++) {
        length += heap->normal[k] * heap->normal[k];
    }
    for (int k = 0; k < 3; k++) {
        source.position[k] = source.middle[k] = (float)heap->position[k];
        source.normal[k] = (float)(heap->normal[k] / (length > 0 ? sqrt(length) : 1));
        source.flux[k] = (float)heap->flux[k];
    }
    return source;
}

int sources_merge(struct source_set *from, double size, double point_mm, struct source_set *to,
                  float *variance)
{
    double square = 0, weight = 0;
    struct merge merge = {.from = from,
                          .size = size,
                          .point_mm = point_mm,
                          .numbers = calloc(from->count + 1, sizeof *merge.numbers)};
    int status = merge.numbers ? group(&merge) : -1;
    if (status == 0) {
        to->count = merge.groups.count;
        to->list = calloc(to->count + 1, sizeof *to->list);
        status = to->list ? 0 : -1;
    }
    for (size_t i = 0; status == 0 && i < to->count; i++) {
        to->list[i] = source_of(&merge.heaps[i]);
        square += merge.heaps[i].square;
        weight += merge.heaps[i].weight;
    }
    *variance = weight > 0 ? (float)(square / weight / (2 * point_mm * point_mm)) : 0;
    for (size_t i = 0; status == 0 && i < from->count; i++) {
        memcpy(from->list[i].middle, to->list[merge.numbers[i]].position,
               sizeof from->list[i].middle);
    }
    groups_end(&merge.groups);
    free(merge.numbers);
    free(merge.heaps);
    return status;
}
