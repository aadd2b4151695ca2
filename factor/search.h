/* Which terms and clusters to try next, decided by nothing but what was tried before. */
#ifndef FACTOR_SEARCH_H
#define FACTOR_SEARCH_H

#include <stdbool.h>
#include <stddef.h>

enum { SEARCH_TRIES = 48 };

/* One factorization of a search. */
struct search_try {
    int terms, clusters, iterations;
    double
        error; /* mean relative; as stored and of all points where `verified`, else of a few points */
    double bytes;   /* of the material, as the paper's Table 1 counts them */
    double seconds; /* all of it */
    bool verified;
    bool held;      /* the error that was asked for, verified */
    char ended[24]; /* by what */
};

struct search {
    int terms, clusters; /* as the user fixed them, or 0 */
    int most_terms, most_clusters;
    double most_bytes;
    bool
        cheapest; /* an error is to be held: from the smallest material up, then between; else from the middle */
    size_t points, channels, window, value_bytes; /* what materials are made of */
    bool shaped;                      /* with a kernel per term, and no clusters but one: */
    double plane_bytes, kernel_bytes; /* of one term, ... */
    double other_bytes;               /* and of all but terms */
    int count;
    struct search_try tries[SEARCH_TRIES];
};

/* What to try next; false when nothing is left.
 *
 * Until an error is held it climbs, terms and clusters growing together. Then it looks for a smaller material between
 * what failed and what held, taking it that more terms with as many clusters or more never do worse: first with two
 * thirds of the terms that are in question and as many clusters as still make the material smaller, then with fewer
 * clusters. */
bool search_next(const struct search *search, int *terms, int *clusters);

/* Write down a try. The search ends by itself before there is no room for more. */
void search_note(struct search *search, const struct search_try *try);

/* Bytes of a material of so many terms and clusters. */
double search_bytes(const struct search *search, int terms, int clusters);

#endif
