/* Non-negative least squares for the kernels' numbers. */
#include "factor/terms_kernels.h"

#include <math.h>
#include <stdlib.h>

/* Far above what is needed where terms are not all but the same. */
enum { SWEEPS = 5000 };

/* Coordinate descent ends when a sweep changes the objective by less than this share of what the numbers weigh. */
#define ENOUGH 1e-13

/* What the terms' numbers at place k have to do with each other and with those at place k + 1: blocks of
 * [terms][terms], and the right side. */
struct system {
    int terms, count;
    double *same, *next, *side, *values;
    bool *held; /* [count] */
};

static double of_pair(const float *equations, int t, int s)
{
    int high = t > s ? t : s, low = t > s ? s : t;
    return (double)equations[high * (high + 1) / 2 + low];
}

static void add_entry(struct system *y, const float *equations, int first, double share)
{
    size_t terms = (size_t)y->terms, pairs = terms * (terms + 1) / 2;
    for (size_t t = 0; t < terms; t++) {
        double side = (double)equations[pairs + t];
        y->side[(size_t)first * terms + t] += (1 - share) * side;
        if (share > 0) {
            y->side[((size_t)first + 1) * terms + t] += share * side;
        }
        for (size_t s = 0; s < terms; s++) {
            double a = of_pair(equations, (int)t, (int)s);
            size_t at = ((size_t)first * terms + t) * terms + s;
            y->same[at] += (1 - share) * (1 - share) * a;
            if (share > 0) {
                y->next[at] += (1 - share) * share * a;
                y->same[at + terms * terms] += share * share * a;
            }
        }
    }
}

/* The gradient of one number. */
static double slope_of(const struct system *y, size_t k, size_t t)
{
    size_t terms = (size_t)y->terms;
    double sum = -y->side[k * terms + t];
    const double *same = y->same + (k * terms + t) * terms, *own = y->values + k * terms;
    for (size_t s = 0; s < terms; s++) {
        sum += same[s] * own[s];
    }
    if (k + 1 < (size_t)y->count) {
        const double *next = y->next + (k * terms + t) * terms;
        for (size_t s = 0; s < terms; s++) {
            sum += next[s] * own[terms + s];
        }
    }
    if (k > 0) {
        const double *before = y->next + ((k - 1) * terms + t) * terms;
        for (size_t s = 0; s < terms; s++) {
            sum += before[s] * y->values[(k - 1) * terms + s];
        }
    }
    return sum;
}

static void descend(struct system *y)
{
    size_t terms = (size_t)y->terms;
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        double change = 0, weight = 0;
        for (size_t i = 0; i < (size_t)y->count * terms; i++) {
            size_t k = i / terms, t = i % terms;
            double curvature = y->same[(k * terms + t) * terms + t];
            if (curvature > 0 && !y->held[k]) {
                double best = fmax(0, y->values[i] - slope_of(y, k, t) / curvature);
                change += curvature * (best - y->values[i]) * (best - y->values[i]);
                weight += curvature * best * best;
                y->values[i] = best;
            }
        }
        if (change <= ENOUGH * weight) {
            break;
        }
    }
}

/* Full kernels are even where light goes the same way forth and back. */
static void mirror(const struct terms_grid *g, int terms, float *numbers)
{
    int area = g->window * g->window;
    for (int t = 0; t < terms; t++) {
        for (int i = 0; i < area / 2; i++) {
            numbers[t * area + i] = numbers[t * area + area - 1 - i];
        }
    }
}

/* Every entry that is looked at, if it is near enough; what others depend on is held. */
static void add_entries(struct system *y, const struct terms_grid *g, bool both_ways, int most,
                        const float *equations)
{
    size_t terms = (size_t)y->terms, row = terms * (terms + 1) / 2 + terms;
    int area = g->window * g->window, half = g->window / 2;
    for (int i = both_ways ? area / 2 + 1 : 0; i < area; i++) {
        if (abs(i % g->window - half) > most || abs(i / g->window - half) > most) {
            y->held[g->first[i]] = true;
            y->held[g->first[i] + (g->share[i] > 0)] = true;
        } else if (i != area / 2) {
            add_entry(y, equations + (size_t)i * row, g->first[i], g->share[i]);
        }
    }
}

int terms_kernels_solve(const struct terms_grid *g, int terms, bool both_ways, int most,
                        const float *equations, float *numbers, struct nacre_error *error)
{
    size_t count = (size_t)g->count, m = (size_t)terms;
    struct system y = {.terms = terms,
                       .count = g->count,
                       .same = calloc(count * m * m, sizeof(double)),
                       .next = calloc(count * m * m, sizeof(double)),
                       .side = calloc(count * m, sizeof(double)),
                       .values = calloc(count * m, sizeof(double)),
                       .held = calloc(count, sizeof(bool))};
    int status = NACRE_OK;
    if (!y.same || !y.next || !y.side || !y.values || !y.held) {
        status = nacre_fail_memory(error, "the kernels");
        goto out;
    }
    add_entries(&y, g, both_ways, most, equations);
    for (size_t i = 0; i < count * m; i++) {
        y.values[i] = (double)numbers[i % m * count + i / m];
    }
    descend(&y);
    for (size_t i = 0; i < count * m; i++) {
        numbers[i % m * count + i / m] = (float)y.values[i];
    }
    if (both_ways && !g->radius) {
        mirror(g, terms, numbers);
    }
out:
    free(y.same);
    free(y.next);
    free(y.side);
    free(y.values);
    free(y.held);
    return status;
}
