/* From a pilot to a plan that spends station time only where it is seen. */
#include "rig/develop/adapt.h"

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

/* All sets of the pilot's exposures are tried. */
enum { SETS_OF = 10 };

/* A block of the sample, and what its responses ask for. */
struct block {
    int x, y, width, height;
    int half; /* of the spacing */
    size_t exposures;
    bool known; /* a response of the pilot lies here */
};

/* What the search goes through. */
struct search {
    const struct pilot *pilot;
    const struct station *station;
    const struct adapt_wish *wish;
    struct pilot_tail tails[3];
    int channels;
    double gain; /* variance of an entry of reflectance 1's light over a pixel's variance */
    struct block *blocks;
    int across, down;
    double *noise; /* [responses][exposures]: over what is wished, by how many exposures of a set */
    double *
        bounds; /* [responses]: of it; more than wished where all of the pilot's exposures leave more */
};

/* Variance of a pixel's merged radiance, raw units a second, with the first `count` exposures of the set. */
static double pixel_variance(const struct station *station, const double *turns, size_t count,
                             double light)
{
    const struct station_camera *camera = &station->camera;
    double full = (double)((1U << (unsigned)camera->bits) - 2) - camera->pedestal;
    double weight = 0;
    for (size_t e = 0; e < count; e++) {
        double t = turns[e] / station->projector.wheel_hz;
        double raw = fmax(light, 0) * t;
        double shot = camera->electrons > 0 ? raw / camera->electrons : 0;
        double variance = camera->read_noise * camera->read_noise + 1.0 / 12 + shot;
        if (e == 0 || raw + 4 * sqrt(variance) < full) {
            weight += t * t / variance;
        }
    }
    return 1 / weight;
}

/* The pilot's black frames tell how a pixel's variance becomes an entry's: the fit over mixed pixels, and white. */
static double find_gain(const struct pilot *pilot, const struct station *station,
                        const struct plan *plan)
{
    double inverse = 0;
    for (int c = 0; c < pilot->channels; c++) {
        inverse += 1 / (pilot->white[c] * pilot->white[c]) / pilot->channels;
    }
    return pilot->noise * pilot->noise /
           (inverse * pixel_variance(station, plan->exposure_turns, plan->exposure_count, 0));
}

/* Of a response with the first `count` exposures: of all, and off its centre. */
struct noise {
    double whole, tails;
};

static struct noise response_noise(const struct search *search, size_t index,
                                   const struct plan *plan, size_t count)
{
    const struct pilot *pilot = search->pilot;
    const struct pilot_place *place = &pilot->places[index];
    int half = plan->window / 2;
    double sums[2] = {0}; /* centre, rings */
    for (int c = 0; c < pilot->channels; c++) {
        double white = pilot->white[c];
        for (int ring = 0; ring < pilot->rings && ring <= half; ring++) {
            int entries = ring ? 8 * ring : 1;
            double light = pilot_energy(pilot, index, c, ring) / entries * white;
            sums[ring > 0] += entries * search->gain / (white * white) *
                              pixel_variance(search->station, plan->exposure_turns, count, light);
        }
    }
    double power = fmax(place->power, 1e-30);
    return (struct noise){sqrt((sums[0] + sums[1]) / (power + fmax(place->centre, 0))),
                          sqrt(sums[1] / power)};
}

static void tabulate_noise(struct search *search, const struct plan *plan)
{
    for (size_t i = 0; i < search->pilot->responses; i++) {
        for (size_t e = 0; e < plan->exposure_count; e++) {
            struct noise noise = response_noise(search, i, plan, e + 1);
            search->noise[i * plan->exposure_count + e] =
                fmax(noise.whole / search->wish->noise, noise.tails / search->wish->tails);
        }
    }
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

static size_t needed_exposures(const struct search *search, size_t index, const struct plan *plan)
{
    for (size_t e = 1; e < plan->exposure_count; e++) {
        if (search->noise[index * plan->exposure_count + e - 1] <= search->bounds[index]) {
            return e;
        }
    }
    return plan->exposure_count;
}

/* What the responses within the block and half a block around it ask for. */
static void ask_responses(const struct search *search, const struct plan *plan, double scale,
                          struct block *block)
{
    const struct pilot *pilot = search->pilot;
    int limit = plan->window / 2;
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
        int half = needed_half(search, i, search->wish->overlap * scale, limit);
        size_t exposures = needed_exposures(search, i, plan);
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
static void ask_all(struct search *search, const struct plan *plan, double scale)
{
    int count = search->across * search->down;
    for (int b = 0; b < count; b++) {
        ask_responses(search, plan, scale, &search->blocks[b]);
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
static void level(struct search *search)
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
    double dark = pixel_variance(search->station, plan->exposure_turns, plan->exposure_count, 0);
    double power = 0;
    double sum = 0;
    for (size_t i = 0; i < pilot->responses; i++) {
        power += fmax(pilot->places[i].power, 0) / (double)pilot->responses;
    }
    for (int c = 0; c < pilot->channels; c++) {
        sum += (double)plan->window * plan->window * search->gain * dark /
               (pilot->white[c] * pilot->white[c]);
    }
    double bound = black_share * search->wish->tails * scale;
    double count = ceil(sum / (bound * bound * power));
    return (int)fmin(fmax(count, BLACK_MINIMUM), BLACK_MAXIMUM);
}

/* Bits of `set` are those of the pilot's exposures but its first, which is always there. */
static void take_set(const struct plan *pilot_plan, unsigned set, struct plan *plan)
{
    plan->exposure_count = 1;
    plan->exposure_turns[0] = pilot_plan->exposure_turns[0];
    for (size_t e = 1; e < pilot_plan->exposure_count; e++) {
        if (set & 1U << (e - 1)) {
            plan->exposure_turns[plan->exposure_count++] = pilot_plan->exposure_turns[e];
        }
    }
}

/* One set of exposures, with regions or all blocks alike. */
struct variant {
    unsigned set;
    bool level;
};

static int try_variant(struct search *search, const struct plan *pilot_plan, struct variant variant,
                       double scale, struct plan *plan, double *seconds, struct nacre_error *error)
{
    struct sequence_needs needs;
    take_set(pilot_plan, variant.set, plan);
    tabulate_noise(search, plan);
    ask_all(search, plan, scale);
    if (variant.level) {
        level(search);
    }
    int status = set_regions(search, plan, error);
    if (status != NACRE_OK) {
        return status;
    }
    plan->black_frames = count_black(search, plan, scale);
    const struct station_sample *sample = &search->station->sample;
    status = plan_lay(plan, "the plan", sample->width, sample->height, search->channels, error);
    if (status == NACRE_OK) {
        status = sequence_estimate(search->station, plan, NULL, &needs, error);
        *seconds = needs.seconds;
    }
    return status;
}

/* What noise each response may have; returns of how many it is more than wished, as the pilot has no longer exposures. */
static size_t set_bounds(struct search *search, const struct plan *pilot_plan, double scale)
{
    size_t count = 0;
    tabulate_noise(search, pilot_plan);
    for (size_t i = 0; i < search->pilot->responses; i++) {
        double least =
            search->noise[i * pilot_plan->exposure_count + pilot_plan->exposure_count - 1];
        count += least > scale;
        search->bounds[i] = fmax(scale, near_least * least);
    }
    return count;
}

static bool set_suffices(const struct search *search, const struct plan *plan)
{
    for (size_t i = 0; i < search->pilot->responses; i++) {
        if (search->noise[i * plan->exposure_count + plan->exposure_count - 1] >
            search->bounds[i]) {
            return false;
        }
    }
    return true;
}

/* The fastest at these bounds, left in `plan`. Every grid lights all of the sample, so narrow regions pay only where they need
 * longer exposures than wide ones: then few grids have these. */
static int choose_set(struct search *search, const struct plan *pilot_plan, double scale,
                      struct plan *plan, struct adapt_result *result, struct nacre_error *error)
{
    unsigned sets = 1U << (pilot_plan->exposure_count - 1);
    struct variant best = {sets - 1, true};
    double least = INFINITY;
    double seconds = 0;
    size_t noisy = set_bounds(search, pilot_plan, scale);
    for (unsigned set = 0; set < sets; set++) {
        take_set(pilot_plan, set, plan);
        tabulate_noise(search, plan);
        if (!set_suffices(search, plan)) {
            continue;
        }
        for (int regions = 0; regions < 2; regions++) {
            struct variant variant = {set, regions == 0};
            int status = try_variant(search, pilot_plan, variant, scale, plan, &seconds, error);
            if (status != NACRE_OK) {
                return status;
            }
            if (seconds < least) {
                least = seconds;
                best = variant;
            }
        }
    }
    result->widened = scale;
    result->noisy = noisy;
    return try_variant(search, pilot_plan, best, scale, plan, &result->seconds, error);
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
        struct noise noise = response_noise(search, i, plan, laid->exposures[grid]);
        add_noise(noise.whole, search->pilot->responses, &result->noise);
        add_noise(noise.tails, search->pilot->responses, &result->tails);
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

/* The pilot's exposures, apart from the plan that is changed. */
static int copy_exposures(const struct plan *plan, struct plan *copy, struct nacre_error *error)
{
    *copy = *plan;
    copy->exposure_turns = malloc(plan->exposure_count * sizeof *copy->exposure_turns);
    if (!copy->exposure_turns) {
        return nacre_fail_memory(error, "the pilot's exposures");
    }
    memcpy(copy->exposure_turns, plan->exposure_turns,
           plan->exposure_count * sizeof *copy->exposure_turns);
    return NACRE_OK;
}

/* Bounds as wished, or the narrowest at which the time is kept. */
static int choose_widening(struct search *search, const struct plan *pilot_plan, struct plan *plan,
                           struct adapt_result *result, struct nacre_error *error)
{
    double limit = search->wish->seconds;
    int status = choose_set(search, pilot_plan, 1, plan, result, error);
    if (status != NACRE_OK || limit <= 0 || result->seconds <= limit) {
        return status;
    }
    int below = 0;
    int kept = STEPS;
    status = choose_set(search, pilot_plan, pow(widening, STEPS), plan, result, error);
    if (status == NACRE_OK && result->seconds > limit) {
        return nacre_fail(error,
                          "no plan takes less than %.2g h of exposing, and %.2g h are allowed; "
                          "allow more, or scan a pilot with shorter exposures",
                          result->seconds / 3600, limit / 3600);
    }
    while (status == NACRE_OK && kept - below > 1) {
        int middle = (below + kept) / 2;
        status = choose_set(search, pilot_plan, pow(widening, middle), plan, result, error);
        *(result->seconds <= limit ? &kept : &below) = middle;
    }
    return status == NACRE_OK
               ? choose_set(search, pilot_plan, pow(widening, kept), plan, result, error)
               : status;
}

int adapt_plan(const struct pilot *pilot, const struct station *station,
               const struct adapt_wish *wish, struct plan *plan, struct adapt_result *result,
               struct nacre_error *error)
{
    struct search search = {.pilot = pilot,
                            .station = station,
                            .wish = wish,
                            .channels = pilot->channels,
                            .gain = find_gain(pilot, station, plan)};
    struct plan pilot_plan;
    *result = (struct adapt_result){.widened = 1};
    if (plan->exposure_count > SETS_OF) {
        return nacre_fail(error,
                          "the pilot has %zu exposures; scan one with %d or fewer to choose from",
                          plan->exposure_count, SETS_OF);
    }
    int status = copy_exposures(plan, &pilot_plan, error);
    if (status != NACRE_OK) {
        return status;
    }
    plan->grid_patterns = 0;
    search.noise = malloc(pilot->responses * plan->exposure_count * sizeof *search.noise);
    search.bounds = malloc(pilot->responses * sizeof *search.bounds);
    status = search.noise && search.bounds ? make_blocks(&search, error)
                                           : nacre_fail_memory(error, "the pilot's noise");
    for (int c = 0; c < pilot->channels; c++) {
        search.tails[c] = pilot_tail(pilot, c);
    }
    if (status == NACRE_OK) {
        status = choose_widening(&search, &pilot_plan, plan, result, error);
    }
    if (status == NACRE_OK) {
        fill_result(&search, plan, result);
        status = set_profile(pilot, plan, error);
    }
    free(pilot_plan.exposure_turns);
    free(search.noise);
    free(search.bounds);
    free(search.blocks);
    return status;
}
