/* Taking samples as sources, and level after level of what they are summed up to. */
#include "render/sources.h"

#include "render/bundles.h"
#include "render/sources_merge.h"
#include "render/sources_moments.h"
#include "render/sources_place.h"

#include <stdlib.h>
#include <string.h>

void source_set_finish(struct source_set *set)
{
    free(set->list);
    *set = (struct source_set){0};
}

int sources_take(struct source_set *set, const struct light_samples *samples,
                 struct nacre_error *error)
{
    uint32_t *order = calloc(samples->count + 1, sizeof *order);
    *set = (struct source_set){0};
    set->list = calloc(samples->count + 1, sizeof *set->list);
    for (size_t i = 0; order && set->list && i < samples->count; i++) {
        if (sources_brightness(samples->list[i].flux) > 0) {
            order[set->count++] = (uint32_t)i;
        }
    }
    if (!order || !set->list ||
        (set->count > 0 &&
         bundles_order(samples->list[0].position, sizeof *samples->list / sizeof(float), order,
                       set->count) != 0)) {
        free(order);
        source_set_finish(set);
        return nacre_fail_memory(error, "the light samples");
    }
    for (size_t i = 0; i < set->count; i++) {
        const struct light_sample *sample = &samples->list[order[i]];
        struct source *source = &set->list[i];
        *source = (struct source){
            .x = sample->x, .y = sample->y, .chart = sample->chart, .texel = sample->texel};
        memcpy(source->position, sample->position, sizeof source->position);
        memcpy(source->normal, sample->normal, sizeof source->normal);
        memcpy(source->flux, sample->flux, sizeof source->flux);
    }
    free(order);
    return NACRE_OK;
}

static int sum_squares(struct sources *sources, const struct appearance *appearance, int index,
                       double point_mm)
{
    struct lattice lattice = {.from = index > 0 ? &sources->squares[index - 1] : &sources->points,
                              .size = (double)(2 << index),
                              .point_mm = point_mm};
    int status = lattice_make(&lattice, &sources->squares[index]);
    if (status == 0) {
        status = moments_sum(sources, appearance, index, &lattice);
    }
    lattice_finish(&lattice);
    return status;
}

int sources_extend(struct sources *sources, struct source_set *samples,
                   const struct appearance *appearance, const struct levels *levels,
                   double point_mm, struct nacre_error *error)
{
    size_t parts =
        appearance->layout == NACRE_KERNEL_PER_TERM ? 1 : (size_t)appearance->basis.parts;
    int status = 0;
    sources->moment_size = parts * (size_t)appearance->terms * 4;
    if (levels->merges && !sources->points.list) {
        status = sources_merge(samples, 1, point_mm, &sources->points, &sources->variance);
    }
    for (int i = sources->count; status == 0 && i < levels->count; i++) {
        status = sum_squares(sources, appearance, i, point_mm);
        if (status == 0) {
            status = moments_fill_pyramid(sources, appearance, i);
        }
        sources->count += status == 0;
    }
    return status == 0 ? NACRE_OK : nacre_fail_memory(error, "summing up the light samples");
}

void sources_finish(struct sources *sources)
{
    source_set_finish(&sources->points);
    for (int i = 0; i < LEVELS_MAXIMUM; i++) {
        free(sources->squares[i].list);
        free(sources->moments[i]);
        free(sources->pyramid[i]);
    }
    *sources = (struct sources){0};
}
