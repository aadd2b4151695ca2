/* Making what passes share. */
#include "render/gather_stock.h"

#include "render/gather_device.h"

#include <stdlib.h>
#include <string.h>

enum { BLOCK = 64 };

int gather_stock_make(struct gather_stock *stock, const struct gather *gather,
                      struct nacre_error *error)
{
    struct gather_stage *vertices = &stock->stages[0];
    *stock = (struct gather_stock){.gather = gather};
    stock->surface = gather->surface ? gather->surface : &stock->own;
    if (sources_take(&stock->samples, gather->samples, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (stock->samples.count == 0 || !gather->appearance->gathers) {
        return NACRE_OK;
    }
    if (gather_surface_make(stock->surface, gather->mesh, gather->mapping, gather->appearance,
                            error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    vertices->receivers = stock->surface->receivers.list;
    vertices->count = stock->surface->receivers.count;
    vertices->bundles = stock->surface->bundles; /* which owns them */
    stock->receivers = stock->surface->receivers;
    stock->stage_count = 1;
    return NACRE_OK;
}

/* Where every sample is taken, those of one kernel follow each other in each block: kernels then stay in the cache.
 * Insertion sort, as blocks are short. */
static int sort_by_kernel(struct gather_stock *stock, struct nacre_error *error)
{
    const struct appearance *a = stock->gather->appearance;
    size_t count = stock->samples.count, mixed = (size_t)a->mixed;
    struct source *list = device_allocate((count + 1) * sizeof *list, error);
    if (!list) {
        return NACRE_FAILED;
    }
    memcpy(list, stock->samples.list, count * sizeof *list);
    stock->by_kernel = (struct source_set){count, list};
    for (size_t i = 0; a->ids && i < count; i++) {
        struct source moved = list[i];
        uint32_t id = a->ids[moved.texel * mixed];
        size_t j = i;
        for (; j % BLOCK > 0 && a->ids[list[j - 1].texel * mixed] > id; j--) {
            list[j] = list[j - 1];
        }
        list[j] = moved;
    }
    return NACRE_OK;
}

int gather_stock_extend(struct gather_stock *stock, const struct levels *levels,
                        struct nacre_error *error)
{
    double point = stock->gather->mapping->point_mm;
    if (!levels->merges && !stock->by_kernel.list && sort_by_kernel(stock, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (sources_extend(&stock->sources, &stock->samples, stock->gather->appearance, levels, point,
                       error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (; stock->stage_count <= levels->count; stock->stage_count++) {
        struct gather_stage *fine = &stock->stages[stock->stage_count - 1], *coarse = fine + 1;
        double spacing = (double)(1 << stock->stage_count);
        posts_finish(&fine->posts);
        reach_bundles_finish(&coarse->bundles);
        if (posts_make(&fine->posts, fine->receivers, fine->count, spacing, point, error) !=
            NACRE_OK) {
            return NACRE_FAILED;
        }
        coarse->receivers = fine->posts.list;
        coarse->count = fine->posts.count;
        if (reach_bundle(&coarse->bundles, coarse->receivers, coarse->count, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

void gather_stock_finish(struct gather_stock *stock)
{
    for (int i = 0; i <= LEVELS_MAXIMUM; i++) {
        if (i > 0) {
            reach_bundles_finish(&stock->stages[i].bundles);
        }
        posts_finish(&stock->stages[i].posts);
    }
    gather_surface_finish(&stock->own);
    source_set_finish(&stock->samples);
    source_set_finish(&stock->by_kernel);
    sources_finish(&stock->sources);
    *stock = (struct gather_stock){0};
}
