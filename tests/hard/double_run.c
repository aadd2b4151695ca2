/* Both methods in double precision. */
#include "double_run.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { SWEEPS = 10, PLAIN = 3 };

void double_run_mu(struct reference *reference, int steps)
{
    for (int i = 0; i < steps; i++) {
        reference_update(reference, false);
        reference_update(reference, true);
    }
}

/* F and H one behind the other. */
struct run {
    struct reference *reference;
    size_t count; /* of one factor */
    double *good, *next, *last, *fresh;
    double share, limit, objective;
    int accepted, refused, refusals;
    bool settled;
};

static void load(struct run *run, const double *f, const double *h)
{
    memcpy(run->reference->f, f, run->count * sizeof *f);
    memcpy(run->reference->h, h, run->count * sizeof *h);
}

static double objective_of(struct run *run, const double *factors)
{
    load(run, factors, factors + run->count);
    return reference_objective(run->reference);
}

static void descend_h(struct run *run, const double *from)
{
    load(run, from, from + run->count);
    reference_descend(run->reference, true, SWEEPS);
    memcpy(run->fresh + run->count, run->reference->h, run->count * sizeof(double));
}

static void extrapolate(struct run *run, size_t first, double share)
{
    for (size_t i = first; i < first + run->count; i++) {
        run->next[i] = fmax(0, run->fresh[i] + share * (run->fresh[i] - run->last[i]));
    }
}

static void finish_step(struct run *run, double share)
{
    extrapolate(run, run->count, share);
    load(run, run->good, run->next + run->count);
    reference_descend(run->reference, false, SWEEPS);
    memcpy(run->fresh, run->reference->f, run->count * sizeof(double));
    extrapolate(run, 0, share);
    memcpy(run->last, run->fresh, 2 * run->count * sizeof(double));
}

static void accept(struct run *run, double objective)
{
    memcpy(run->good, run->next, 2 * run->count * sizeof(double));
    run->objective = objective;
    if (run->accepted == PLAIN) {
        run->share = 0.5;
    } else if (run->refused == 0) {
        run->share = fmin(run->limit, 1.05 * run->share);
        run->limit = fmin(1, 1.01 * run->limit);
    }
    run->accepted++;
    run->refused = 0;
    finish_step(run, run->share);
}

/* Once more from the good factors, without extrapolation. */
static void refuse(struct run *run)
{
    run->refusals++;
    run->settled = run->refused > 0 || run->share == 0;
    if (!run->settled) {
        run->refused++;
        run->limit = run->share;
        run->share /= 1.5;
        descend_h(run, run->good);
        finish_step(run, 0);
    }
}

static void step(struct run *run)
{
    int before = run->accepted;
    while (run->accepted == before && !run->settled) {
        double objective = objective_of(run, run->next);
        if (objective <= run->objective) {
            descend_h(run, run->next);
            accept(run, objective);
        } else {
            refuse(run);
        }
    }
}

int double_run_hals(struct reference *r, int steps)
{
    size_t count = (size_t)r->terms * (size_t)r->height * (size_t)r->width;
    size_t bytes = 2 * count * sizeof(double);
    struct run run = {.reference = r,
                      .count = count,
                      .good = malloc(bytes),
                      .next = malloc(bytes),
                      .last = malloc(bytes),
                      .fresh = malloc(bytes),
                      .limit = 1,
                      .objective = INFINITY};
    memcpy(run.next, r->f, bytes / 2);
    memcpy(run.next + count, r->h, bytes / 2);
    memcpy(run.last, run.next, bytes);
    memcpy(run.good, run.next, bytes);
    for (int i = 0; i < steps; i++) {
        step(&run);
    }
    bool next_is_better = objective_of(&run, run.next) <= run.objective;
    const double *best = next_is_better ? run.next : run.good;
    load(&run, best, best + count);
    free(run.good);
    free(run.next);
    free(run.last);
    free(run.fresh);
    return run.refusals;
}
