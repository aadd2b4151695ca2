/* From a pilot to a plan that spends station time only where it is seen. */
#include "rig/develop/adapt.h"

#include "rig/develop/foretold.h"
#include "rig/sequence.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Black frames of which dead and hot pixels are told, at least. */
enum { BLACK_MINIMUM = 16, BLACK_MAXIMUM = 1000 };

/* The black level's own error is in all responses alike, so it gets a quarter of what noise may do. */
static const double black_share = 0.25;

/* What all of the pilot's exposures cannot reach need not be reached but to this factor. */
static const double near_least = 1.05;

/* Bounds are widened by so much a step. */
static const double widening = 1.1;
enum { STEPS = 72 }; /* to a thousand times */

/* Exposures are chosen from a ladder of whole turns with steps of about a half; more than four bring little. */
enum { SET_MAXIMUM = 4, LADDER_MAXIMUM = 40 };
static const double ladder_step = 1.5;

/* So many of the cheapest sets are laid out. */
enum { TRIED = 4 };

/* A block of the sample, and what its responses ask for. */
struct block {
    int x, y, width, height;
    int half; /* of the spacing */
    size_t exposures;
    bool known; /* a response of the pilot lies here */
};

/* Exposures that may be taken. */
struct exposure_set {
    double turns[SET_MAXIMUM];
    size_t count;
    const double
        *noise; /* [responses][SET_MAXIMUM]: over what is wished, with the first 1, 2 ... of them */
    double
        price; /* turns of all grids, one for each exposure to be read out among them; infinite where they leave too much noise */
};

/* What the search goes through. */
struct search {
    const struct pilot *pilot;
    const struct station *station;
    const struct adapt_wish *wish;
    struct pilot_tail tails[3];
    int channels;
    struct foretold foretold;
    struct block *blocks;
    int across, down;
    struct exposure_set *sets;
    size_t set_count;
    double
        *noise;  /* [responses][SET_MAXIMUM]: over what is wished, by how many exposures of a set */
    int *halves; /* [responses]: of the spacing that each asks for */
    double *bounds; /* [responses]: of it; more than wished where no set reaches that */
};

/* The noise of all sets, once for all bounds. */
static int tabulate_noise(struct search *search, struct nacre_error *error)
{
    const struct adapt_wish *wish = search->wish;
    size_t responses = search->pilot->responses;
    search->noise = malloc(search->set_count * responses * SET_MAXIMUM * sizeof *search->noise);
    if (!search->noise) {
        return nacre_fail_memory(error, "the pilot's noise");
    }
    double *noise = search->noise;
    for (size_t s = 0; s < search->set_count; s++) {
        struct exposure_set *set = &search->sets[s];
        set->noise = noise;
        for (size_t i = 0; i < responses; i++, noise += SET_MAXIMUM) {
            struct noise foretold[SET_MAXIMUM];
            foretold_noise(&search->foretold, i, set->turns, set->count, foretold);
            for (size_t e = 0; e < set->count; e++) {
                noise[e] = fmax(foretold[e].whole / wish->noise, foretold[e].tails / wish->tails);
            }
        }
    }
    return NACRE_OK;
}

/* With all exposures of the set. */
static double noise_of(const struct exposure_set *set, size_t index)
{
    return set->noise[index * SET_MAXIMUM + set->count - 1];
}

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

/* What the responses within the block and half a block around it ask for. */
static void ask_responses(const struct search *search, const struct exposure_set *set,
                          struct block *block)
{
    const struct pilot *pilot = search->pilot;
    int margin = search->wish->block / 2;
    block->half = 1;
    block->exposures = 1;
    block->known = false;
    for (size_t i = 0; i < pilot->responses; i++) {
        const struct pilot_place *place = &pilot->places[i];
        if (place->x < block->x - margin || place->x >= block->x + block->width + margin ||
            place->y < block->y - margin || place->y >= block->y + block->height + margin) {
            continue;
        }
        int half = search->halves[i];
        size_t exposures = needed_exposures(search, i, set);
        block->half = half > block->half ? half : block->half;
        block->exposures = exposures > block->exposures ? exposures : block->exposures;
        block->known = true;
    }
}

/* The widest spacing and the most exposures of any block. */
static struct block most_of(const struct search *search)
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
static void ask_all(const struct search *search, const struct exposure_set *set)
{
    int count = search->across * search->down;
    for (int b = 0; b < count; b++) {
        ask_responses(search, set, &search->blocks[b]);
    }
    struct block most = most_of(search);
    for (int b = 0; b < count; b++) {
        struct block *block = &search->blocks[b];
        if (!block->known) {
            block->half = most.half;
            block->exposures = most.exposures;
        }
    }
}

/* All blocks as the most demanding of them. */
static void level(const struct search *search)
{
    int count = search->across * search->down;
    struct block most = most_of(search);
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
static int set_regions(const struct search *search, struct plan *plan, struct nacre_error *error)
{
    int count = search->across * search->down;
    struct block most = most_of(search);
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
    ask_all(search, set);
    if (!regions) {
        level(search);
    }
    int status = set_regions(search, plan, error);
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

/* What noise each response may have; returns of how many it is more than wished, as no set does better. */
static size_t set_bounds(const struct search *search, double scale)
{
    size_t responses = search->pilot->responses;
    size_t count = 0;
    for (size_t i = 0; i < responses; i++) {
        search->bounds[i] = INFINITY;
    }
    for (size_t s = 0; s < search->set_count; s++) {
        for (size_t i = 0; i < responses; i++) {
            search->bounds[i] = fmin(search->bounds[i], noise_of(&search->sets[s], i));
        }
    }
    for (size_t i = 0; i < responses; i++) {
        count += search->bounds[i] > scale;
        search->bounds[i] = fmax(scale, near_least * search->bounds[i]);
    }
    return count;
}

/* How much more noise than its bound a response has with a set, at worst. */
static double excess_of(const struct search *search, const struct exposure_set *set)
{
    double worst = 0;
    for (size_t i = 0; i < search->pilot->responses; i++) {
        worst = fmax(worst, noise_of(set, i) / search->bounds[i]);
    }
    return worst;
}

/* Responses whose best sets differ may leave none that suffices: then all are allowed what the set has that is least above. */
static void relax_bounds(const struct search *search)
{
    const struct exposure_set *best = NULL;
    double least = INFINITY;
    for (size_t s = 0; s < search->set_count; s++) {
        double excess = excess_of(search, &search->sets[s]);
        if (excess < least) {
            least = excess;
            best = &search->sets[s];
        }
    }
    for (size_t i = 0; best && least > 1 && i < search->pilot->responses; i++) {
        search->bounds[i] = fmax(search->bounds[i], noise_of(best, i));
    }
}

static bool set_suffices(const struct search *search, const struct exposure_set *set)
{
    for (size_t i = 0; i < search->pilot->responses; i++) {
        if (noise_of(set, i) > search->bounds[i]) {
            return false;
        }
    }
    return true;
}

/* A set's price with regions: each exposure is taken in as many grids as the widest spacing that asks for it needs. */
static double price_of(const struct search *search, const struct exposure_set *set)
{
    double price = 0;
    ask_all(search, set);
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
    size_t noisy = set_bounds(search, scale);
    relax_bounds(search);
    for (size_t s = 0; s < search->set_count; s++) {
        struct exposure_set *set = &search->sets[s];
        set->price = set_suffices(search, set) ? price_of(search, set) : INFINITY;
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

/* From the pilot's shortest exposure, which white needs, to its longest. */
static size_t make_ladder(const struct plan *pilot_plan, double ladder[LADDER_MAXIMUM])
{
    double longest = pilot_plan->exposure_turns[pilot_plan->exposure_count - 1];
    size_t count = 0;
    double turns = pilot_plan->exposure_turns[0];
    while (turns < longest && count < LADDER_MAXIMUM - 1) {
        double whole = count ? round(turns) : turns;
        if (count == 0 || whole > ladder[count - 1]) {
            ladder[count++] = whole;
        }
        turns *= ladder_step;
    }
    if (count == 0 || longest > ladder[count - 1]) {
        ladder[count++] = longest;
    }
    return count;
}

/* The first exposure, and up to SET_MAXIMUM - 1 of the others. */
static int make_sets(struct search *search, const struct plan *pilot_plan,
                     struct nacre_error *error)
{
    double ladder[LADDER_MAXIMUM];
    size_t rungs = make_ladder(pilot_plan, ladder);
    search->sets = malloc((rungs * rungs * rungs + 1) * sizeof *search->sets);
    if (!search->sets) {
        return nacre_fail_memory(error, "the sets of exposures");
    }
    /* Rung 0 in the place of b or c stands for none. */
    for (size_t a = 0; a < rungs; a++) {
        for (size_t b = 0; b <= (a ? a - 1 : 0); b++) {
            for (size_t c = 0; c <= (b ? b - 1 : 0); c++) {
                struct exposure_set *set = &search->sets[search->set_count++];
                const size_t picked[] = {c, b, a};
                *set = (struct exposure_set){.turns = {ladder[0]}, .count = 1};
                for (int k = 0; k < 3; k++) {
                    if (picked[k]) {
                        set->turns[set->count++] = ladder[picked[k]];
                    }
                }
            }
        }
    }
    return NACRE_OK;
}

static int make_blocks(struct search *search, struct nacre_error *error)
{
    const struct station_sample *sample = &search->station->sample;
    int side = search->wish->block > 0
                   ? search->wish->block
                   : (sample->width > sample->height ? sample->width : sample->height);
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
    status = make_blocks(&search, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = make_sets(&search, plan, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = tabulate_noise(&search, error);
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
