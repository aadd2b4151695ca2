/* Which terms and clusters to try next. */
#include "factor/search.h"

/* What is tried while climbing. */
static const struct rung {
    int terms, clusters;
} rungs[] = {{1, 1}, {2, 2}, {4, 5}, {8, 12}, {16, 32}, {32, 100}, {64, 100}};

/* Where climbing begins when no error tells that little is enough. */
enum { FIRST_RUNG = 2 };

/* What is tried between the rungs. */
static const int some_terms[] = {1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64};
static const int some_clusters[] = {1, 2, 3, 5, 8, 12, 20, 32, 50, 100};

enum {
    RUNGS = sizeof rungs / sizeof *rungs,
    SOME_TERMS = sizeof some_terms / sizeof *some_terms,
    SOME_CLUSTERS = sizeof some_clusters / sizeof *some_clusters,
    MOST_BETWEEN = 12, /* tries after the first that held */
};

/* A material that is not smaller by this much is not worth a try. */
#define WORTHWHILE 0.97

double search_bytes(const struct search *s, int terms, int clusters)
{
    if (s->shaped) {
        return terms * (s->plane_bytes + s->kernel_bytes) + s->other_bytes;
    }
    double points = (double)s->points, channels = (double)s->channels, window = (double)s->window;
    double factors = 2.0 * terms * channels * points * (double)s->value_bytes;
    double kernels = clusters * channels * window * window * 4;
    return factors + kernels + points * (clusters <= 256 ? 1 : 4);
}

void search_note(struct search *s, const struct search_try *try)
{
    if (s->count < SEARCH_TRIES) {
        s->tries[s->count++] = *try;
    }
}

static bool was_tried(const struct search *s, int terms, int clusters)
{
    for (int i = 0; i < s->count; i++) {
        if (s->tries[i].terms == terms && s->tries[i].clusters == clusters) {
            return true;
        }
    }
    return false;
}

static int at_most(int value, int limit)
{
    return value < limit ? value : limit;
}

static bool climb(const struct search *s, int *terms, int *clusters)
{
    for (int i = s->cheapest ? 0 : FIRST_RUNG; i < RUNGS; i++) {
        *terms = s->terms ? s->terms : at_most(rungs[i].terms, s->most_terms);
        *clusters = s->clusters ? s->clusters : at_most(rungs[i].clusters, s->most_clusters);
        bool fits = search_bytes(s, *terms, *clusters) <= s->most_bytes;
        /* The first is tried at any size: something must be. */
        if (!was_tried(s, *terms, *clusters) && (fits || s->count == 0)) {
            return true;
        }
    }
    return false;
}

/* Whether a try that failed had as many terms and clusters, or more; clusters hardly make up for terms, so fewer terms
 * are given up with up to twice its clusters. */
static bool is_hopeless(const struct search *s, int terms, int clusters)
{
    for (int i = 0; i < s->count; i++) {
        const struct search_try *t = &s->tries[i];
        int enough = terms < t->terms ? 2 * t->clusters : t->clusters;
        if (!t->held && terms <= t->terms && clusters <= enough) {
            return true;
        }
    }
    return false;
}

/* The clusters worth a try with so many terms, in rising order. */
static int list_clusters(const struct search *s, int terms, double bytes, int *list)
{
    int count = 0;
    for (int i = 0; i < SOME_CLUSTERS; i++) {
        int clusters = s->clusters ? s->clusters : some_clusters[i];
        bool allowed = clusters <= s->most_clusters && (i == 0 || !s->clusters);
        if (allowed && search_bytes(s, terms, clusters) < WORTHWHILE * bytes &&
            !was_tried(s, terms, clusters) && !is_hopeless(s, terms, clusters)) {
            list[count++] = clusters;
        }
    }
    return count;
}

static bool look_between(const struct search *s, const struct search_try *best, int *terms,
                         int *clusters)
{
    int open_terms[SOME_TERMS + 1], lists[SOME_TERMS + 1][SOME_CLUSTERS], counts[SOME_TERMS + 1];
    int open = 0;
    for (int i = 0; i < SOME_TERMS && !s->terms; i++) {
        if (some_terms[i] >= best->terms) {
            break;
        }
        counts[open] = list_clusters(s, some_terms[i], best->bytes, lists[open]);
        open_terms[open] = some_terms[i];
        open += counts[open] > 0;
    }
    if (open > 0) {
        int middle = 2 * open / 3;
        *terms = open_terms[middle];
        *clusters = lists[middle][counts[middle] - 1];
        return true;
    }
    counts[0] = list_clusters(s, best->terms, best->bytes, lists[0]);
    *terms = best->terms;
    *clusters = counts[0] ? lists[0][counts[0] / 2] : 0;
    return counts[0] > 0;
}

bool search_next(const struct search *s, int *terms, int *clusters)
{
    const struct search_try *best = 0;
    int since = 0; /* the first that held */
    for (int i = 0; i < s->count; i++) {
        since += best != 0;
        if (s->tries[i].held && (!best || s->tries[i].bytes < best->bytes)) {
            best = &s->tries[i];
        }
    }
    if (s->count == SEARCH_TRIES) {
        return false;
    }
    if (!best) {
        return climb(s, terms, clusters);
    }
    return since < MOST_BETWEEN && look_between(s, best, terms, clusters);
}
