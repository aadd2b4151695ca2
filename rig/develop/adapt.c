/* From a pilot to a plan that spends station time only where it is seen. */
#include "rig/develop/adapt.h"

#include "rig/develop/adapt_search.h"
#include "rig/sequence.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Black frames of which dead and hot pixels are told, at least. */
enum { BLACK_MINIMUM = 16, BLACK_MAXIMUM = 1000 };

/* The black level's own error is in all responses alike, so it gets a quarter of what noise may do. */
static const double black_share = 0.25;

/* Bounds are widened by so much a step. */
static const double widening = 1.1;
enum { STEPS = 72 }; /* to a thousand times */

/* So many of the cheapest sets are laid out. */
enum { TRIED = 4 };

/* The smallest half spacing at which a response leaks no more than the bound. */
static int needed_half(const struct search *search, size_t index, double bound, int limit)
{
    for (int half = 1; half < limit; half++) {
        double worst = 0;
        for (int c = 0; c < search->channels; c++) {
            worst =
                fmax(worst, pilot_response_leak(search->pilot, search->tails[c], index, c, half));
        }
        if (worst <= bound) {
            return half;
        }
    }
    return limit;
}

/* So many that the mean's error, which is in all responses alike, is within its share of the noise of the middle one. */
static int count_black(const struct search *search, const struct plan *plan, double scale)
{
    const struct pilot *pilot = search->pilot;
    double sum = foretold_dark(&search->foretold, plan->exposure_turns, plan->exposure_count);
    double power = 0;
    for (size_t i = 0; i < pilot->responses; i++) {
        power += fmax(pilot->places[i].power, 0) / (double)pilot->responses;
    }
    double bound = black_share * search->wish->tails * scale;
    double count = ceil(sum / (bound * bound * power));
    return (int)fmin(fmax(count, BLACK_MINIMUM), BLACK_MAXIMUM);
}

/* A set of exposures, with regions or all blocks alike. */
static int try_set(struct search *search, const struct exposure_set *set, bool regions,
                   double scale, struct plan *plan, double *seconds, struct nacre_error *error)
{
    struct sequence_needs needs;
    const struct station_sample *sample = &search->station->sample;
    memcpy(plan->exposure_turns, set->turns, set->count * sizeof *set->turns);
    plan->exposure_count = set->count;
    adapt_blocks_ask(search, set);
    if (!regions) {
        adapt_blocks_level(search);
    }
    int status = adapt_blocks_set_regions(search, plan, error);
    if (status != NACRE_OK) {
        return status;
    }
    plan->black_frames = count_black(search, plan, scale);
    status = plan_lay(plan, "the plan", sample->width, sample->height, search->channels, error);
    if (status == NACRE_OK) {
        status = sequence_estimate(search->station, plan, NULL, &needs, error);
        *seconds = needs.seconds;
    }
    return status;
}

/* A set's price with regions: each exposure is taken in as many grids as the widest spacing that asks for it needs. */
static double price_of(const struct search *search, const struct exposure_set *set)
{
    double price = 0;
    adapt_blocks_ask(search, set);
    for (size_t e = 0; e < set->count; e++) {
        int widest = 0;
        for (int b = 0; b < search->across * search->down; b++) {
            const struct block *block = &search->blocks[b];
            widest = block->exposures > e && block->half > widest ? block->half : widest;
        }
        price += (set->turns[e] + 1) * (2.0 * widest + 1) * (2.0 * widest + 1);
    }
    return price;
}

static int by_price(const void *a, const void *b)
{
    const struct exposure_set *p = a;
    const struct exposure_set *q = b;
    return p->price != q->price ? (p->price < q->price ? -1 : 1)
                                : (p->count > q->count) - (p->count < q->count);
}

/* Bounds and prices at a scale; the sets that suffice come first, the cheapest at the head. */
static size_t sort_sets(struct search *search, const struct plan *plan, double scale)
{
    for (size_t i = 0; i < search->pilot->responses; i++) {
        search->halves[i] = needed_half(search, i, search->wish->overlap * scale, plan->window / 2);
    }
    size_t noisy = adapt_sets_bound(search, scale);
    adapt_sets_relax(search);
    for (size_t s = 0; s < search->set_count; s++) {
        struct exposure_set *set = &search->sets[s];
        set->price = adapt_set_suffices(search, set) ? price_of(search, set) : INFINITY;
    }
    qsort(search->sets, search->set_count, sizeof *search->sets, by_price);
    return noisy;
}

/* The fastest at these bounds, left in `plan`. Every grid lights all of the sample, so narrow regions pay only where they need
 * longer exposures than wide ones: then few grids have these. */
static int choose_set(struct search *search, double scale, struct plan *plan,
                      struct adapt_result *result, struct nacre_error *error)
{
    size_t best = 0;
    bool best_regions = false;
    double least = INFINITY;
    double seconds = 0;
    result->widened = scale;
    result->noisy = sort_sets(search, plan, scale);
    for (size_t s = 0; s < TRIED && s < search->set_count && isfinite(search->sets[s].price); s++) {
        for (int regions = 0; regions < 2; regions++) {
            int status = try_set(search, &search->sets[s], regions, scale, plan, &seconds, error);
            if (status != NACRE_OK) {
                return status;
            }
            if (seconds < least) {
                least = seconds;
                best = s;
                best_regions = regions;
            }
        }
    }
    return try_set(search, &search->sets[best], best_regions, scale, plan, &result->seconds, error);
}

static void add_noise(double noise, size_t responses, struct adapt_noise *sum)
{
    sum->mean += noise / (double)responses;
    sum->worst = fmax(sum->worst, noise);
}

static void fill_result(const struct search *search, const struct plan *plan,
                        struct adapt_result *result)
{
    const struct plan_grids *laid = plan->grids;
    result->grids = laid->count;
    result->narrowest = result->widest = laid->spacings[0];
    for (size_t i = 0; i < (size_t)laid->width * (size_t)laid->height; i++) {
        int spacing = laid->spacings[i];
        result->narrowest = spacing < result->narrowest ? spacing : result->narrowest;
        result->widest = spacing > result->widest ? spacing : result->widest;
    }
    for (size_t i = 0; i < search->pilot->responses; i++) {
        const struct pilot_place *place = &search->pilot->places[i];
        uint32_t grid = laid->grid_of[place->y * laid->width + place->x];
        size_t exposures = laid->exposures[grid];
        struct noise noise[SET_MAXIMUM];
        foretold_noise(&search->foretold, i, plan->exposure_turns, exposures, noise);
        add_noise(noise[exposures - 1].whole, search->pilot->responses, &result->noise);
        add_noise(noise[exposures - 1].tails, search->pilot->responses, &result->tails);
    }
}

/* Spacings below the window leave windows that overlap. */
static int set_profile(const struct pilot *pilot, struct plan *plan, struct nacre_error *error)
{
    bool overlap = plan->window > plan->grid_spacing;
    for (size_t i = 0; i < plan->region_count; i++) {
        overlap = overlap || plan->window > plan->regions[i].spacing;
    }
    free(plan->profile);
    plan->profile = NULL;
    plan->profile_count = 0;
    return overlap ? pilot_profile(pilot, &plan->profile, &plan->profile_count, error) : NACRE_OK;
}

static int make_room(struct plan *plan, struct nacre_error *error)
{
    double *turns = realloc(plan->exposure_turns, SET_MAXIMUM * sizeof *turns);
    if (!turns) {
        return nacre_fail_memory(error, "the plan's exposures");
    }
    plan->exposure_turns = turns;
    plan->grid_patterns = 0;
    return NACRE_OK;
}

/* Bounds as wished, or the narrowest at which the time is kept. */
static int choose_widening(struct search *search, struct plan *plan, struct adapt_result *result,
                           struct nacre_error *error)
{
    double limit = search->wish->seconds;
    int status = choose_set(search, 1, plan, result, error);
    if (status != NACRE_OK || limit <= 0 || result->seconds <= limit) {
        return status;
    }
    int below = 0;
    int kept = STEPS;
    status = choose_set(search, pow(widening, STEPS), plan, result, error);
    if (status == NACRE_OK && result->seconds > limit) {
        return nacre_fail(error,
                          "no plan takes less than %.2g h of exposing, and %.2g h are allowed; "
                          "allow more, or scan a pilot with shorter exposures",
                          result->seconds / 3600, limit / 3600);
    }
    while (status == NACRE_OK && kept - below > 1) {
        int middle = (below + kept) / 2;
        status = choose_set(search, pow(widening, middle), plan, result, error);
        *(result->seconds <= limit ? &kept : &below) = middle;
    }
    return status == NACRE_OK ? choose_set(search, pow(widening, kept), plan, result, error)
                              : status;
}

int adapt_plan(const struct pilot *pilot, const struct station *station,
               const struct adapt_wish *wish, struct plan *plan, struct adapt_result *result,
               struct nacre_error *error)
{
    struct search search = {
        .pilot = pilot, .station = station, .wish = wish, .channels = pilot->channels};
    *result = (struct adapt_result){.widened = 1};
    if (pilot->responses == 0) {
        return nacre_fail(error, "no response of the pilot was measured in all of its window; scan "
                                 "a pilot with more grids");
    }
    for (int c = 0; c < pilot->channels; c++) {
        if (!(pilot->channel_noise[c] > 0 && pilot->white[c] > 0)) {
            return nacre_fail(error,
                              "the pilot's black and white frames do not tell how much noise "
                              "a response has; scan a pilot with both, and with two black "
                              "frames or more");
        }
    }
    foretold_init(&search.foretold, pilot, station, plan);
    for (int c = 0; c < pilot->channels; c++) {
        search.tails[c] = pilot_tail(pilot, c);
    }
    int status = NACRE_OK;
    search.bounds = malloc(pilot->responses * sizeof *search.bounds);
    search.halves = malloc(pilot->responses * sizeof *search.halves);
    if (!search.bounds || !search.halves) {
        status = nacre_fail_memory(error, "the pilot's needs");
        goto out;
    }
    status = adapt_blocks_make(&search, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = adapt_sets_make(&search, plan, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = adapt_sets_tabulate(&search, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = make_room(plan, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = choose_widening(&search, plan, result, error);
    if (status == NACRE_OK) {
        fill_result(&search, plan, result);
        status = set_profile(pilot, plan, error);
    }
out:
    free(search.sets);
    free(search.noise);
    free(search.bounds);
    free(search.halves);
    free(search.blocks);
    return status;
}
