/* A method and the paper's updates on one problem, in turns with sgemm, until the method reaches the goal. */
#include "race.h"

#include "peer_compare.h"

#include "factor/hals.h"
#include "factor/layout.h"
#include "factor/update.h"

#include <math.h>

#define PINNED_SHARE 0.45

enum { STEPS = 400, TURN = 4 /* updates */, TURNS = CASE_PREFIX / TURN };

static struct method *make(const struct opencl *opencl, const struct case_problem *made, bool mu)
{
    struct nacre_error error = {0};
    struct method *method = NULL;
    int status = mu ? update_new(opencl, &made->attempt.problem, NULL, &method, &error)
                    : hals_new(opencl, &made->attempt.problem, NULL, &method, &error);
    if (status != NACRE_OK) {
        fail(error.text);
    }
    return method;
}

/* One step; returns the objective before it, which both methods find on the way, in the responses' own unit. */
static double advance(struct method *method, const struct case_problem *made)
{
    struct nacre_error error = {0};
    double objective = 0;
    if (method->ops->step(method, 0, &objective, &error) != NACRE_OK) {
        fail(error.text);
    }
    return ldexp(objective, made->responses.exponent[0]);
}

static struct moment time_updates(struct method *mu, const struct case_problem *made, int count)
{
    struct nacre_error error = {0};
    struct moment start = timing_now();
    for (int i = 0; i < count; i++) {
        (void)advance(mu, made);
    }
    if (update_wait(mu, &error) != NACRE_OK) {
        fail(error.text);
    }
    struct moment taken = timing_since(start);
    return (struct moment){taken.wall / count, taken.processor / count};
}

static struct moment median(const struct moment *times, int count)
{
    double wall[STEPS], processor[STEPS];
    for (int i = 0; i < count; i++) {
        wall[i] = times[i].wall;
        processor[i] = times[i].processor;
    }
    return (struct moment){timing_median(wall, count), timing_median(processor, count)};
}

/* One step towards the goal; whether it was reached before. */
static bool descend(struct race *race, const struct case_problem *made, struct method *hals)
{
    profile_count(true);
    struct moment start = timing_now();
    race->reached = advance(hals, made);
    struct moment taken = timing_since(start);
    profile_count(false);
    race->descent.wall += taken.wall;
    race->descent.processor += taken.processor;
    return race->reached <= race->of->goal;
}

/* sgemm, updates and steps in turns, so that all meet the same load. */
static void take_turns(struct race *race, const struct case_problem *made, struct method *mu,
                       struct method *hals)
{
    struct sgemm sgemm = sgemm_new();
    struct moment products[STEPS], updates[TURNS];
    int turn = 0;
    bool done = race->of->goal <= 0;
    profile_clear();
    (void)sgemm_run(&sgemm);
    for (; turn < STEPS && (turn < TURNS || !done); turn++) {
        products[turn] = sgemm_run(&sgemm);
        if (turn < TURNS) {
            updates[turn] = time_updates(mu, made, TURN);
        }
        if (done) {
            continue;
        }
        done = descend(race, made, hals);
        race->profile = profile_read();
        race->steps++;
    }
    race->steps = done ? race->steps : 0;
    race->product = median(products, turn);
    race->update = median(updates, TURNS);
    race->prefix = case_objective(made, mu);
    sgemm_finish(&sgemm);
}

/* Have all kernels compiled, for just these sizes. */
static void warm_up(const struct opencl *opencl, const struct case_problem *made)
{
    for (int mu = 0; mu < 2; mu++) {
        struct method *method = make(opencl, made, mu);
        (void)advance(method, made);
        (void)case_objective(made, method);
        method_free(method);
    }
}

struct race race_run(const struct bench_case *c, bool half, const struct opencl *opencl)
{
    struct race race = {.of = c,
                        .flops = 12.0 * c->terms * entries_inside(c->width, c->height, c->window)};
    struct case_problem made;
    case_make(c, layout_lanes(opencl), half, &made);
    warm_up(opencl, &made);
    struct method *mu = make(opencl, &made, true), *hals = make(opencl, &made, false);
    take_turns(&race, &made, mu, hals);
    method_free(hals);
    race.peer = peer_compare(&made, mu);
    method_free(mu);
    case_finish(&made);
    return race;
}

struct moment race_sgemm(const struct race *race)
{
    double flops = 2 * pow(SGEMM_SIZE, 3);
    return (struct moment){flops / race->product.wall, flops / race->product.processor};
}

struct moment race_pinned(const struct race *race)
{
    struct moment rate = race_sgemm(race);
    double flops = CASE_UPDATES * race->flops / PINNED_SHARE;
    return (struct moment){flops / rate.wall, flops / rate.processor};
}
