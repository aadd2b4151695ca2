/* Seconds per iteration of the multiplicative updates against OpenBLAS's sgemm, and their precision, at the paper's
 * sizes; for trying register tiles. */
#include "cases.h"
#include "exact.h"
#include "timing.h"

#include "factor/layout.h"
#include "factor/update.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ROUNDS = 7 };

static struct moment time_iteration(struct method *method, bool with_objective)
{
    struct nacre_error error = {0};
    double objective = 0;
    struct moment start = timing_now();
    if (method->ops->step(method, 0, with_objective ? &objective : NULL, &error) != NACRE_OK ||
        update_wait(method, &error) != NACRE_OK) {
        fail(error.text);
    }
    return timing_since(start);
}

/* F and H one behind the other, [terms][height][width] each. */
static float *factors_of(const struct case_problem *made, struct method *method)
{
    size_t points = (size_t)made->responses.width * (size_t)made->responses.height;
    size_t count = points * (size_t)made->attempt.problem.terms;
    float *planes = allocate(2 * count * sizeof *planes);
    struct nacre_error error = {0};
    if (method->ops->read(method, 0, planes, planes + count, &error) != NACRE_OK) {
        fail(error.text);
    }
    return planes;
}

/* One iteration of the method, and the same in double precision: the largest difference of an entry of F or H relative to
 * that entry. */
static double precision(const struct case_problem *made, struct method *method)
{
    size_t terms = (size_t)made->attempt.problem.terms;
    size_t points = (size_t)made->responses.width * (size_t)made->responses.height;
    size_t count = points * terms;
    double *exact = allocate(2 * count * sizeof *exact), worst = 0;
    float *planes = factors_of(made, method);
    for (size_t i = 0; i < 2 * count; i++) {
        size_t plane = i % count;
        exact[i / count * count + plane % points * terms + plane / points] = planes[i];
    }
    free(planes);
    float *windows = case_windows(made);
    exact_update(made, windows, false, exact, exact + count);
    exact_update(made, windows, true, exact, exact + count);
    free(windows);
    (void)time_iteration(method, false);
    planes = factors_of(made, method);
    for (size_t i = 0; i < 2 * count; i++) {
        size_t plane = i % count;
        double expected = exact[i / count * count + plane % points * terms + plane / points];
        worst = fmax(worst, fabs((double)planes[i] - expected) / fmax(expected, 1e-12));
    }
    free(planes);
    free(exact);
    return worst;
}

/* Rounds of sgemm and one iteration in turns, so that both meet the same load. */
static void compare(const struct bench_case *c, struct method *method, double worst)
{
    struct sgemm sgemm = sgemm_new();
    double wall[ROUNDS], share_wall[ROUNDS], share_processor[ROUNDS], sgemm_rate[ROUNDS],
        extra[ROUNDS];
    double useful = 12.0 * c->terms * entries_inside(c->width, c->height, c->window),
           sgemm_flops = 2 * pow(SGEMM_SIZE, 3);
    (void)time_iteration(method, true); /* compiles on first use */
    (void)sgemm_run(&sgemm);
    for (int i = 0; i < ROUNDS; i++) {
        struct moment product = sgemm_run(&sgemm), step = time_iteration(method, false);
        double with_objective = time_iteration(method, true).processor;
        wall[i] = step.wall;
        extra[i] = with_objective / step.processor - 1;
        sgemm_rate[i] = sgemm_flops / product.wall * 1e-9;
        share_wall[i] = useful / step.wall / (sgemm_flops / product.wall);
        share_processor[i] = useful / step.processor / (sgemm_flops / product.processor);
    }
    double seconds = timing_median(wall, ROUNDS);
    printf("%-10s %4d x %-4d K %2d T %2d k %3d  %8.4f s/iteration  %6.1f GF/s  sgemm %6.1f GF/s  "
           "%5.1f %% wall  %5.1f %% processor  objective %+.1f %%  from float64 %.1g\n",
           c->name, c->width, c->height, c->window, c->terms, c->clusters, seconds,
           useful / seconds * 1e-9, timing_median(sgemm_rate, ROUNDS),
           100 * timing_median(share_wall, ROUNDS), 100 * timing_median(share_processor, ROUNDS),
           100 * timing_median(extra, ROUNDS), worst);
    (void)fflush(stdout);
    sgemm_finish(&sgemm);
}

/* Whether the kernels are as precise as asked for. */
static bool run(const struct bench_case *c, const struct opencl *opencl, bool half,
                const struct update_tile *tile)
{
    struct nacre_error error = {0};
    struct case_problem made;
    struct method *method = NULL;
    case_make(c, layout_lanes(opencl), half, &made);
    if (update_new(opencl, &made.attempt.problem, tile, &method, &error) != NACRE_OK) {
        fail(error.text);
    }
    double worst = precision(&made, method);
    compare(c, method, worst);
    method_free(method);
    case_finish(&made);
    return worst <= 1e-4;
}

static int number(const char *text)
{
    return (int)strtol(text, NULL, 10);
}

/* Arguments: --half for responses as half floats; --tile ROWS STEPS GROUP to try one; numbers of the cases, from 0,
 * none for all of one channel. */
int main(int argc, char **argv)
{
    struct update_tile tile = {0};
    struct opencl opencl;
    struct nacre_error error = {0};
    bool wanted[64] = {false}, any = false, half = false, good = true;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--tile") == 0 && i + 3 < argc) {
            tile =
                (struct update_tile){number(argv[i + 1]), number(argv[i + 2]), number(argv[i + 3])};
            i += 3;
        } else if (strcmp(argv[i], "--half") == 0) {
            half = true;
        } else if (number(argv[i]) >= 0 && number(argv[i]) < 64) {
            wanted[number(argv[i])] = any = true;
        } else {
            fail("usage: bench_update [--half] [--tile ROWS STEPS GROUP] [NUMBER OF A CASE ...]");
        }
    }
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        (void)fprintf(stderr, "SKIP: %s\n", error.text);
        return 77;
    }
    printf("%s, %u compute units; useful flops: 12 T for each entry inside the sample\n",
           opencl.name, opencl.compute_units);
    for (int i = 0; cases[i].name; i++) {
        if (any ? wanted[i] : cases[i].channels == 1) {
            good &= run(&cases[i], &opencl, half, tile.rows ? &tile : NULL);
        }
    }
    opencl_close(&opencl);
    return good ? EXIT_SUCCESS : EXIT_FAILURE;
}
