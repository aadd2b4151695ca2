/* What a search for an adapted plan goes through: exposures that may be taken, and blocks of the sample. */
#ifndef RIG_DEVELOP_ADAPT_SEARCH_H
#define RIG_DEVELOP_ADAPT_SEARCH_H

#include "rig/develop/adapt.h"
#include "rig/develop/foretold.h"

/* More than four exposures bring little. */
enum { SET_MAXIMUM = 4 };

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
    int side; /* of a block that the sample's border does not cut */
    int across, down;
    struct exposure_set *sets;
    size_t set_count;
    double
        *noise;  /* [responses][SET_MAXIMUM]: over what is wished, by how many exposures of a set */
    int *halves; /* [responses]: of the spacing that each asks for */
    double *bounds; /* [responses]: of it; more than wished where no set reaches that */
};

/* All sets of the first exposure and up to three others of a ladder between the pilot's first and longest; and their
 * noise, once for all bounds. Both are freed by the caller. */
int adapt_sets_make(struct search *search, const struct plan *pilot_plan,
                    struct nacre_error *error);
int adapt_sets_tabulate(struct search *search, struct nacre_error *error);

/* Set the bounds of all responses at this scale of what is wished; returns of how many it is more, as no set does better. */
size_t adapt_sets_bound(const struct search *search, double scale);

/* Widen the bounds, where no set keeps all of them, to what the set has that is least above. */
void adapt_sets_relax(const struct search *search);
bool adapt_set_suffices(const struct search *search, const struct exposure_set *set);

/* The sample's blocks, and what each asks for with a set at the search's bounds; or all as the most demanding. */
int adapt_blocks_make(struct search *search, struct nacre_error *error);
void adapt_blocks_ask(const struct search *search, const struct exposure_set *set);
void adapt_blocks_level(const struct search *search);

/* The widest spacing and the most exposures of any block. */
struct block adapt_blocks_most(const struct search *search);

/* The plan's spacing, exposures and regions: runs of like blocks in each row, but for those that are like most of the sample. */
int adapt_blocks_set_regions(const struct search *search, struct plan *plan,
                             struct nacre_error *error);

#endif
