/* The blocks of a sample that an adapted plan tells apart: what their responses ask for, and the regions that follow. */
#include "rig/develop/adapt_search.h"

#include <stdlib.h>

static size_t needed_exposures(const struct search *search, size_t index,
                               const struct exposure_set *set)
{
    for (size_t e = 1; e < set->count; e++) {
        if (set->noise[index * SET_MAXIMUM + e - 1] <= search->bounds[index]) {
            return e;
        }
    }
    return set->count;
}

/* Whether a place lies within the block or half a block around it. */
static bool is_near(const struct block *block, const struct pilot_place *place, int margin)
{
    return place->x >= block->x - margin && place->x < block->x + block->width + margin &&
           place->y >= block->y - margin && place->y < block->y + block->height + margin;
}

/* The first and the last block along an axis that a place may be near to. */
struct span {
    int first, last;
};

static struct span span_of(int place, int side, int margin, int count)
{
    int first = place > margin ? (place - margin) / side : 0, last = (place + margin) / side;
    return (struct span){first, last < count ? last : count - 1};
}

/* Let the blocks around a response have what it asks for. */
static void ask_response(const struct search *search, size_t index, const struct exposure_set *set)
{
    const struct pilot_place *place = &search->pilot->places[index];
    int margin = search->wish->block / 2, half = search->halves[index];
    size_t exposures = needed_exposures(search, index, set);
    struct span x = span_of(place->x, search->side, margin, search->across);
    struct span y = span_of(place->y, search->side, margin, search->down);
    for (int row = y.first; row <= y.last; row++) {
        for (int column = x.first; column <= x.last; column++) {
            struct block *block = &search->blocks[row * search->across + column];
            if (is_near(block, place, margin)) {
                block->half = half > block->half ? half : block->half;
                block->exposures = exposures > block->exposures ? exposures : block->exposures;
                block->known = true;
            }
        }
    }
}

/* The widest spacing and the most exposures of any block. */
struct block adapt_blocks_most(const struct search *search)
{
    struct block most = {.half = 1, .exposures = 1};
    for (int b = 0; b < search->across * search->down; b++) {
        const struct block *block = &search->blocks[b];
        most.half = block->half > most.half ? block->half : most.half;
        most.exposures = block->exposures > most.exposures ? block->exposures : most.exposures;
    }
    return most;
}

/* A block without responses asks for the most that any does: nothing is known of it. */
void adapt_blocks_ask(const struct search *search, const struct exposure_set *set)
{
    int count = search->across * search->down;
    for (int b = 0; b < count; b++) {
        struct block *block = &search->blocks[b];
        block->half = 1;
        block->exposures = 1;
        block->known = false;
    }
    for (size_t i = 0; i < search->pilot->responses; i++) {
        ask_response(search, i, set);
    }
    struct block most = adapt_blocks_most(search);
    for (int b = 0; b < count; b++) {
        struct block *block = &search->blocks[b];
        if (!block->known) {
            block->half = most.half;
            block->exposures = most.exposures;
        }
    }
}

/* All blocks as the most demanding of them. */
void adapt_blocks_level(const struct search *search)
{
    int count = search->across * search->down;
    struct block most = adapt_blocks_most(search);
    for (int b = 0; b < count; b++) {
        search->blocks[b].half = most.half;
        search->blocks[b].exposures = most.exposures;
    }
}

static bool alike(const struct block *a, const struct block *b)
{
    return a->half == b->half && a->exposures == b->exposures;
}

/* The plan's regions: runs of like blocks in each row, but for those that are like most of the sample. */
int adapt_blocks_set_regions(const struct search *search, struct plan *plan,
                             struct nacre_error *error)
{
    int count = search->across * search->down;
    struct block most = adapt_blocks_most(search);
    free(plan->regions);
    plan->regions = NULL;
    plan->region_count = 0;
    plan->grid_spacing = 2 * most.half + 1;
    plan->exposure_count = most.exposures;
    plan->regions = calloc((size_t)(count > 1 ? count : 1), sizeof *plan->regions);
    if (!plan->regions) {
        return nacre_fail_memory(error, "the regions of a plan");
    }
    for (int b = 0; b < count; b++) {
        const struct block *block = &search->blocks[b];
        if (alike(block, &most)) {
            continue;
        }
        struct plan_region *last =
            plan->region_count ? &plan->regions[plan->region_count - 1] : NULL;
        if (last && b % search->across && alike(block, block - 1)) {
            last->width += block->width;
        } else {
            plan->regions[plan->region_count++] =
                (struct plan_region){.x = block->x,
                                     .y = block->y,
                                     .width = block->width,
                                     .height = block->height,
                                     .spacing = 2 * block->half + 1,
                                     .longest_turns = plan->exposure_turns[block->exposures - 1]};
        }
    }
    return NACRE_OK;
}

int adapt_blocks_make(struct search *search, struct nacre_error *error)
{
    const struct station_sample *sample = &search->station->sample;
    int side = search->wish->block > 0
                   ? search->wish->block
                   : (sample->width > sample->height ? sample->width : sample->height);
    search->side = side;
    search->across = (sample->width + side - 1) / side;
    search->down = (sample->height + side - 1) / side;
    size_t count = (size_t)search->across * (size_t)search->down;
    search->blocks = calloc(count, sizeof *search->blocks);
    if (!search->blocks) {
        return nacre_fail_memory(error, "the blocks of a sample");
    }
    for (size_t b = 0; b < count; b++) {
        int x = (int)b % search->across * side;
        int y = (int)b / search->across * side;
        search->blocks[b] =
            (struct block){.x = x,
                           .y = y,
                           .width = x + side < sample->width ? side : sample->width - x,
                           .height = y + side < sample->height ? side : sample->height - y};
    }
    return NACRE_OK;
}
