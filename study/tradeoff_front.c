/* Which points nothing beats. */
#include "study/tradeoff_front.h"

#include <math.h>
#include <stdlib.h>

double tradeoff_cost_of(const struct tradeoff_point *point, enum tradeoff_cost cost)
{
    return cost == TRADEOFF_SECONDS ? point->seconds : point->bytes;
}

struct ranked {
    double cost, error;
    int index;
};

/* Cheapest first, of those the most exact, of those the first. */
static int compare(const void *a, const void *b)
{
    const struct ranked *x = a, *y = b;
    int by_cost = (x->cost > y->cost) - (x->cost < y->cost);
    int by_error = (x->error > y->error) - (x->error < y->error);
    return by_cost ? by_cost : by_error ? by_error : x->index - y->index;
}

int tradeoff_front(const struct tradeoff *t, enum tradeoff_cost cost, int indices[TRADEOFF_POINTS])
{
    static const struct ranked none;
    struct ranked ranked[TRADEOFF_POINTS];
    double least = INFINITY;
    int count = 0;
    ranked[0] = none;
    for (int i = 0; i < t->point_count; i++) {
        ranked[i] = (struct ranked){tradeoff_cost_of(&t->points[i], cost), t->points[i].error, i};
    }
    qsort(ranked, (size_t)t->point_count, sizeof *ranked, compare);
    for (int i = 0; i < t->point_count; i++) {
        if (ranked[i].error < (1 - TRADEOFF_GAIN) * least) {
            least = ranked[i].error;
            indices[count++] = ranked[i].index;
        }
    }
    return count;
}

void tradeoff_mark_fronts(struct tradeoff *t)
{
    int indices[TRADEOFF_POINTS];
    for (int i = 0; i < t->point_count; i++) {
        t->points[i].quickest = t->points[i].smallest = false;
    }
    for (int i = tradeoff_front(t, TRADEOFF_SECONDS, indices); i-- > 0;) {
        t->points[indices[i]].quickest = true;
    }
    for (int i = tradeoff_front(t, TRADEOFF_BYTES, indices); i-- > 0;) {
        t->points[indices[i]].smallest = true;
    }
}

double tradeoff_rival(const struct tradeoff *t, int run, enum tradeoff_cost cost, double limit)
{
    double least = INFINITY;
    for (int i = 0; i < t->point_count; i++) {
        const struct tradeoff_point *p = &t->points[i];
        if (p->run != run && tradeoff_cost_of(p, cost) <= limit) {
            least = fmin(least, p->error);
        }
    }
    return least;
}
