/* The plain program on a problem of the benchmarks, beside our updates. */
#include "peer_compare.h"

#include "peer.h"

#include <math.h>
#include <stdlib.h>

/* The kernels' own bound for one update. */
#define TOLERANCE 1e-4

/* Factors as planes, [terms][height][width], to [height][width][terms]. */
static void interleave(const float *planes, int terms, size_t points, float *to)
{
    for (size_t i = 0; i < points * (size_t)terms; i++) {
        to[i / points + i % points * (size_t)terms] = planes[i];
    }
}

/* The largest difference relative to the largest value. */
static double difference(const float *a, const float *b, size_t count)
{
    double largest = 0, worst = 0;
    for (size_t i = 0; i < count; i++) {
        largest = fmax(largest, fabs((double)a[i]));
        worst = fmax(worst, fabs((double)a[i] - (double)b[i]));
    }
    return worst / largest;
}

/* F and H one behind the other, [height][width][terms]. */
static float *factors_of(const struct case_problem *made, struct method *method)
{
    size_t points = (size_t)made->responses.width * (size_t)made->responses.height;
    size_t count = points * (size_t)made->attempt.problem.terms;
    float *planes = allocate(2 * count * sizeof *planes),
          *both = allocate(2 * count * sizeof *both);
    struct nacre_error error = {0};
    if (method->ops->read(method, 0, planes, planes + count, &error) != NACRE_OK) {
        fail(error.text);
    }
    interleave(planes, made->attempt.problem.terms, points, both);
    interleave(planes + count, made->attempt.problem.terms, points, both + count);
    free(planes);
    return both;
}

struct moment peer_compare(const struct case_problem *made, struct method *mu)
{
    const struct responses *r = &made->responses;
    size_t count = (size_t)r->width * (size_t)r->height * (size_t)made->attempt.problem.terms;
    struct nacre_error error = {0};
    float *windows = case_windows(made), *theirs = factors_of(made, mu);
    struct peer peer = {.width = r->width,
                        .height = r->height,
                        .window = r->window,
                        .terms = made->attempt.problem.terms,
                        .responses = windows,
                        .ids = made->attempt.ids,
                        .kernels = made->attempt.kernels,
                        .f = theirs,
                        .h = theirs + count};
    struct moment start = timing_now();
    peer_update(&peer, false);
    peer_update(&peer, true);
    struct moment taken = timing_since(start);
    if (mu->ops->step(mu, 0, NULL, &error) != NACRE_OK) {
        fail(error.text);
    }
    float *ours = factors_of(made, mu);
    if (!(difference(ours, theirs, count) <= TOLERANCE) ||
        !(difference(ours + count, theirs + count, count) <= TOLERANCE)) {
        fail("an update of the plain program differs from ours");
    }
    free(windows);
    free(theirs);
    free(ours);
    return taken;
}
