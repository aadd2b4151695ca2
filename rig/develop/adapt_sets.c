/* The sets of exposures among which an adapted plan chooses, and the noise that each leaves. */
#include "rig/develop/adapt_search.h"

#include <math.h>
#include <stdlib.h>

/* What all of the pilot's exposures cannot reach need not be reached but to this factor. */
static const double near_least = 1.05;

/* Exposures are chosen from a ladder of whole turns, each half as long again as the one before. */
enum { LADDER_MAXIMUM = 40 };
static const double ladder_step = 1.5;

/* The noise of all sets, once for all bounds. */
int adapt_sets_tabulate(struct search *search, struct nacre_error *error)
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

/* What noise each response may have; returns of how many it is more than wished, as no set does better. */
size_t adapt_sets_bound(const struct search *search, double scale)
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
void adapt_sets_relax(const struct search *search)
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

bool adapt_set_suffices(const struct search *search, const struct exposure_set *set)
{
    for (size_t i = 0; i < search->pilot->responses; i++) {
        if (noise_of(set, i) > search->bounds[i]) {
            return false;
        }
    }
    return true;
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
int adapt_sets_make(struct search *search, const struct plan *pilot_plan, struct nacre_error *error)
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
