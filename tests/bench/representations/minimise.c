/* Projected limited-memory BFGS (Byrd, Lu, Nocedal and Zhu 1995, simplified: the bounds are seen by the set of numbers
 * that would leave them). */
#include "minimise.h"

#include "../timing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PAIRS = 12, PATIENCE = 20, REFRESH = 25, HALVINGS = 20 };

struct state {
    const struct function *function;
    double *x, *gradient, *next, *next_gradient, *direction, *diagonal;
    double *steps[PAIRS], *changes[PAIRS]; /* newest at [(pairs - 1) % PAIRS] */
    int pairs;                             /* ever kept since the history was cleared */
};

/* Whether number i may move: it is not at its bound with the gradient pushing it through. */
static bool is_free(const struct state *s, size_t i)
{
    return s->function->signs || s->x[i] > 0 || s->gradient[i] < 0;
}

static double free_product(const struct state *s, const double *a, const double *b)
{
    double sum = 0;
    for (size_t i = 0; i < s->function->count; i++) {
        sum += is_free(s, i) ? a[i] * b[i] : 0;
    }
    return sum;
}

/* The direction of descent: the two loops over the pairs, on the free numbers. */
static void find_direction(struct state *s)
{
    size_t count = s->function->count;
    int have = s->pairs < PAIRS ? s->pairs : PAIRS;
    double alpha[PAIRS], curvature[PAIRS], *q = s->direction;
    for (size_t i = 0; i < count; i++) {
        q[i] = is_free(s, i) ? -s->gradient[i] : 0;
    }
    for (int k = 1; k <= have; k++) {
        int at = (s->pairs - k) % PAIRS;
        curvature[at] = free_product(s, s->steps[at], s->changes[at]);
        alpha[at] = curvature[at] > 0 ? free_product(s, s->steps[at], q) / curvature[at] : 0;
        for (size_t i = 0; i < count; i++) {
            q[i] -= is_free(s, i) ? alpha[at] * s->changes[at][i] : 0;
        }
    }
    for (size_t i = 0; i < count; i++) {
        q[i] /= s->diagonal[i];
    }
    for (int k = have; k >= 1; k--) {
        int at = (s->pairs - k) % PAIRS;
        double beta = curvature[at] > 0 ? free_product(s, s->changes[at], q) / curvature[at] : 0;
        for (size_t i = 0; i < count; i++) {
            q[i] += is_free(s, i) && curvature[at] > 0 ? (alpha[at] - beta) * s->steps[at][i] : 0;
        }
    }
}

/* Try ever shorter steps until one lowers the value enough; the new value, or the old one where none does. */
static double search_line(struct state *s, double value)
{
    size_t count = s->function->count;
    double length = 1;
    for (int i = 0; i < HALVINGS; i++) {
        double slope = 0;
        for (size_t k = 0; k < count; k++) {
            double moved = s->x[k] + length * s->direction[k];
            s->next[k] = s->function->signs || moved > 0 ? moved : 0;
            slope += s->gradient[k] * (s->next[k] - s->x[k]);
        }
        double found = s->function->evaluate(s->function->data, s->next, s->next_gradient, NULL);
        if (slope < 0 && found <= value + 1e-4 * slope) {
            return found;
        }
        /* the least of the parabola through both values and the slope */
        double least = slope < 0 ? -slope / (2 * (found - value - slope)) : 0.1;
        length *= isfinite(least) ? fmin(0.5, fmax(0.1, least)) : 0.1;
    }
    return value;
}

/* Keep the step and the gradient's change, and go on from there. */
static void take_step(struct state *s)
{
    int at = s->pairs % PAIRS;
    double product = 0, square = 0, *swap = s->gradient;
    for (size_t i = 0; i < s->function->count; i++) {
        double step = s->next[i] - s->x[i], change = s->next_gradient[i] - s->gradient[i];
        s->steps[at][i] = step;
        s->changes[at][i] = change;
        product += step * change;
        square += change * change / s->diagonal[i];
        s->x[i] = s->next[i];
    }
    s->pairs += product > 1e-10 * square;
    s->gradient = s->next_gradient;
    s->next_gradient = swap;
}

static void refresh(struct state *s)
{
    double mean = 0;
    (void)s->function->evaluate(s->function->data, s->x, s->gradient, s->diagonal);
    for (size_t i = 0; i < s->function->count; i++) {
        mean += s->diagonal[i] / (double)s->function->count;
    }
    for (size_t i = 0; i < s->function->count; i++) {
        s->diagonal[i] = fmax(s->diagonal[i], 1e-6 * mean);
    }
}

static double descend(struct state *s, const struct minimise_limits *limits, int *iterations)
{
    double value = s->function->evaluate(s->function->data, s->x, s->gradient, NULL);
    double before = value;
    for (*iterations = 0; *iterations < limits->iterations; ++*iterations) {
        if (*iterations % PATIENCE == PATIENCE - 1) {
            if (before - value <= limits->progress * before) {
                break;
            }
            before = value;
        }
        if (*iterations % REFRESH == 0 || *iterations == 5) {
            refresh(s);
        }
        find_direction(s);
        double found = search_line(s, value);
        if (!(found < value) && s->pairs > 0) {
            s->pairs = 0; /* once more, without what the pairs say */
            refresh(s);
            find_direction(s);
            found = search_line(s, value);
        }
        if (!(found < value)) {
            break;
        }
        value = found;
        take_step(s);
    }
    return value;
}

double minimise(const struct function *function, const struct minimise_limits *limits, double *x,
                int *iterations)
{
    size_t bytes = function->count * sizeof(double);
    struct state s = {.function = function,
                      .gradient = allocate(bytes),
                      .next = allocate(bytes),
                      .next_gradient = allocate(bytes),
                      .direction = allocate(bytes),
                      .diagonal = allocate(bytes)};
    s.x = x;
    for (int i = 0; i < PAIRS; i++) {
        s.steps[i] = allocate(bytes);
        s.changes[i] = allocate(bytes);
    }
    double value = descend(&s, limits, iterations);
    for (int i = 0; i < PAIRS; i++) {
        free(s.steps[i]);
        free(s.changes[i]);
    }
    free(s.gradient);
    free(s.next);
    free(s.next_gradient);
    free(s.direction);
    free(s.diagonal);
    return value;
}
