/* Seconds to the objective that 1000 of the paper's updates reach, on the paper's sizes: `hals` beside sgemm, a plain
 * program, our updates, and a baseline that does not depend on how good those are. */
#include "race.h"

#include "factor/layout.h"
#include "factor/update.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RACES = 6 };

/* Times sooner than the pinned baseline that are asked for: 60 with few clusters, with many 30, or 20 with many terms. */
static int asked_ratio(const struct bench_case *c)
{
    if (c->clusters <= 5) {
        return 60;
    }
    return c->terms <= 12 ? 30 : 20;
}

/* A hundredth of what a Numba program takes for CASE_UPDATES updates with 100 clusters, measured elsewhere once. */
static double numba_goal(const struct bench_case *c)
{
    return c->kind == FIELD_CANDLE ? 2.6 : 6.6;
}

static bool agrees(double value, double expected)
{
    return fabs(value - expected) <= CASE_TOLERANCE * expected;
}

/* The updates to their end, against the goal that is kept. */
static bool verify(const struct bench_case *c, const struct opencl *opencl)
{
    struct nacre_error error = {0};
    struct case_problem made;
    struct method *mu = NULL;
    case_make(c, layout_lanes(opencl), false, &made);
    int status = update_new(opencl, &made.attempt.problem, NULL, &mu, &error);
    for (int i = 0; i < CASE_UPDATES && status == NACRE_OK; i++) {
        status = mu->ops->step(mu, 0, NULL, &error);
    }
    if (status != NACRE_OK) {
        fail(error.text);
    }
    double reached = case_objective(&made, mu);
    bool same = agrees(reached, c->goal);
    printf("goal of %s: kept %.6g, reached %.6g: %s\n", c->name, c->goal, reached,
           same ? "the same" : "DIFFERENT, run bench_goals");
    method_free(mu);
    case_finish(&made);
    return same;
}

/* Whether the goal is this problem's, and was reached. */
static bool is_sound(const struct race *r)
{
    return r->of->goal <= 0 || (r->steps > 0 && agrees(r->prefix, r->of->prefix));
}

/* What one race gave beside the table. */
static void print_details(const struct race *r)
{
    struct moment rate = race_sgemm(r), pinned = race_pinned(r);
    double total = 0;
    printf("%s, k %d: sgemm %.0f GF/s (%.0f a processor second); pinned baseline %.1f s, %.1f "
           "processor s\n",
           r->of->name, r->of->clusters, rate.wall * 1e-9, rate.processor * 1e-9, pinned.wall,
           pinned.processor);
    if (r->of->goal <= 0) {
        printf("  no goal is known: hals is not timed\n");
        return;
    }
    printf("  hals: %d steps to objective %.6g, goal %.6g; %.2f s, %.2f processor s;", r->steps,
           r->reached, r->of->goal, r->descent.wall, r->descent.processor);
    for (int i = 0; i < r->profile.count; i++) {
        total += r->profile.kernels[i].seconds;
    }
    for (int i = 0; i < r->profile.count; i++) {
        const struct profile_kernel *k = &r->profile.kernels[i];
        printf(" %s %d x %.3f s (%.0f %%)", k->name, k->launches, k->seconds / k->launches,
               100 * k->seconds / total);
    }
    printf("\n");
    if (!agrees(r->prefix, r->of->prefix)) {
        printf("  the objective after %d updates is %.6g and not %.6g: the goal is not this "
               "problem's, run bench_goals\n",
               CASE_PREFIX, r->prefix, r->of->prefix);
    }
    (void)fflush(stdout);
}

static void print_head(void)
{
    printf("\nSeconds: wall / processor time over the compute units, which they would take on an "
           "idle machine. Ratios: wall / processor time. Share of sgemm: by processor time. Goal: "
           "the objective of %d updates.\n\n",
           CASE_UPDATES);
    printf("| size | K | T | clusters | method | s/iteration | share of sgemm | s to the goal | "
           "times sooner than our mu | than plain OpenMP C | than the pinned baseline | asked | "
           "Numba's time / 100 |\n");
    printf("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
}

/* Decimals that leave three digits. */
static int decimals(double value)
{
    return value < 1 ? 3 : value < 10 ? 2 : value < 100 ? 1 : 0;
}

static void print_seconds(struct moment time, unsigned units)
{
    double idle = time.processor / units;
    printf(" %.*f / %.*f |", decimals(time.wall), time.wall, decimals(idle), idle);
}

static void print_ratio(struct moment slow, struct moment fast)
{
    printf(" %.1f / %.1f |", slow.wall / fast.wall, slow.processor / fast.processor);
}

static void print_start(const struct race *r, const char *method)
{
    const struct bench_case *c = r->of;
    printf("| %s, %d x %d | %d | %d | %d | %s |", c->name, c->width, c->height, c->window, c->terms,
           c->clusters, method);
}

static struct moment times(struct moment a, double factor)
{
    return (struct moment){a.wall * factor, a.processor * factor};
}

static void print_rows(const struct race *r, unsigned units)
{
    struct moment mu = times(r->update, CASE_UPDATES), peer = times(r->peer, CASE_UPDATES);
    double share = r->flops / r->update.processor / race_sgemm(r).processor;
    print_start(r, "mu");
    print_seconds(r->update, units);
    printf(" %.0f %% |", 100 * share);
    print_seconds(mu, units);
    printf(" |");
    print_ratio(peer, mu);
    print_ratio(race_pinned(r), mu);
    printf(" | |\n");
    if (r->of->goal <= 0) {
        return;
    }
    print_start(r, "hals");
    if (r->steps == 0) {
        printf(" | | not reached | | | | %d | %.1f s |\n", asked_ratio(r->of), numba_goal(r->of));
        return;
    }
    print_seconds(times(r->descent, 1.0 / r->steps), units);
    printf(" |");
    print_seconds(r->descent, units);
    print_ratio(mu, r->descent);
    print_ratio(peer, r->descent);
    print_ratio(race_pinned(r), r->descent);
    printf(" %d | %.1f s |\n", asked_ratio(r->of), numba_goal(r->of));
}

/* Arguments: --half for responses as half floats; numbers of the cases, from 0; none for all but the smallest. Cases of
 * three channels are left out. */
int main(int argc, char **argv)
{
    struct nacre_error error = {0};
    struct opencl opencl;
    struct race races[RACES];
    int count = 0;
    bool good = true, half = argc > 1 && strcmp(argv[1], "--half") == 0;
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        (void)fprintf(stderr, "SKIP: %s\n", error.text);
        return 77;
    }
    printf("%s, %u compute units, responses as %s\n", opencl.name, opencl.compute_units,
           half ? "half floats" : "floats");
    good = verify(&cases[0], &opencl);
    for (int i = 0; cases[i].name && count < RACES; i++) {
        bool wanted = argc == 1 + half && i > 0;
        for (int a = 1 + half; a < argc; a++) {
            wanted |= strtol(argv[a], NULL, 10) == i;
        }
        if (wanted && cases[i].channels == 1) {
            races[count] = race_run(&cases[i], half, &opencl);
            print_details(&races[count]);
            good &= is_sound(&races[count]);
            count++;
        }
    }
    print_head();
    for (int i = 0; i < count; i++) {
        print_rows(&races[i], opencl.compute_units);
    }
    opencl_close(&opencl);
    return good ? EXIT_SUCCESS : EXIT_FAILURE;
}
