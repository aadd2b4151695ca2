/* The gather: choosing how far light is summed up, and checking what that changes. */
#include "render/gather.h"

#include "base/clock.h"
#include "render/gather_convolved.h"
#include "render/gather_cost.h"
#include "render/gather_pass.h"
#include "render/gather_probe.h"

#include <math.h>
#include <stdlib.h>

enum { TRIES = 4 };

/* The error is aimed at this share of the tolerance, and is good where it is above the other. */
static const double aimed = 0.85, good = 0.65;

struct run {
    const struct gather *gather;
    struct progress *progress;
    struct gather_device device;
    struct gather_stock stock;
    struct gather_probe probe;
    float (*light)[3], (*exact)[3];
    struct gather_convolved convolved;
    struct gather_counts *counts;
};

static double seconds_since(int64_t start_ns)
{
    struct clock clock = clock_monotonic();
    return (double)(clock_now_ns(&clock) - start_ns) * 1e-9;
}

static int64_t now_ns(void)
{
    struct clock clock = clock_monotonic();
    return clock_now_ns(&clock);
}

/* NULL: all vertices. */
static int pass(struct run *run, const struct levels *levels, const struct reach_bundles *vertices,
                float (*light)[3], struct nacre_error *error)
{
    const struct gather_pass pass = {&run->device, &run->stock, levels, vertices};
    return gather_pass_run(&pass, run->progress, light, run->counts, error);
}

static int gather_plainly(struct run *run, const struct reach_bundles *vertices, float (*light)[3],
                          struct nacre_error *error)
{
    struct levels levels;
    int status = levels_make(&levels, run->gather->appearance, 0, error);
    if (status == NACRE_OK) {
        status = pass(run, &levels, vertices, light, error);
    }
    levels_finish(&levels);
    return status;
}

static bool pays(const struct run *run, const struct levels *levels)
{
    if (!levels->merges || run->gather->way == GATHER_SUMMED) {
        return levels->merges;
    }
    struct gather_cost cost = gather_cost_of(&run->stock, levels);
    double rest = 1 - (double)run->convolved.served.count / (double)run->stock.receivers.count;
    return cost.summed < rest * cost.plain;
}

/* Vertices drawn, and what leaves them. */
static int make_probe(struct run *run, struct nacre_error *error)
{
    int status = NACRE_OK;
    if (!run->probe.groups) {
        status = gather_probe_make(&run->probe, &run->stock, error);
        if (status == NACRE_OK) {
            status = gather_plainly(run, &run->probe.bundles, run->exact, error);
        }
    }
    return status;
}

/* What these levels change, on the vertices drawn. */
static int measure(struct run *run, const struct levels *levels, double *off,
                   struct nacre_error *error)
{
    int status = make_probe(run, error);
    if (status == NACRE_OK) {
        status = pass(run, levels, &run->probe.bundles, run->light, error);
        gather_convolved_put(&run->convolved, run->light);
    }
    *off = status == NACRE_OK ? gather_probe_error(&run->probe, run->light, run->exact) : 0;
    return status;
}

/* The levels of least cost whose error is within the tolerance, as far as a few tries find them; without merging where
 * light is to be taken sample by sample. */
static int choose(struct run *run, struct levels *chosen, struct nacre_error *error)
{
    double tolerance = run->gather->tolerance, aim = tolerance;
    int status = levels_make(chosen, run->gather->appearance, 0, error);
    for (int i = 0; status == NACRE_OK && tolerance > 0 && i < TRIES; i++) {
        struct levels levels = {0};
        double off = HUGE_VAL;
        status = levels_make(&levels, run->gather->appearance, aim, error);
        bool known = chosen->merges && levels_equal(&levels, chosen);
        bool paid = status == NACRE_OK && !known && pays(run, &levels);
        if (paid) {
            status = measure(run, &levels, &off, error);
        }
        if (off <= tolerance) {
            struct levels other = *chosen;
            *chosen = levels;
            levels = other;
            run->counts->error = off;
        }
        bool found = chosen->merges && (off > tolerance || off > good * tolerance);
        levels_finish(&levels);
        if (!paid || found) {
            break;
        }
        aim *= fmin(fmax(aimed * tolerance / off, 0.1), 4);
    }
    return status;
}

static int prepare(struct run *run, const struct opencl *opencl, struct nacre_error *error)
{
    size_t size = run->gather->mesh->vertex_count + 1;
    if (gather_stock_make(&run->stock, run->gather, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (run->stock.receivers.count == 0) {
        return NACRE_OK;
    }
    if (gather_device_make(&run->device, opencl, run->gather, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    run->light = calloc(size, sizeof *run->light);
    run->exact = calloc(size, sizeof *run->exact);
    return run->light && run->exact ? NACRE_OK : nacre_fail_memory(error, "the gathered light");
}

/* Convolve where that is sooner, and as far as it is within the tolerance. */
static int convolve(struct run *run, struct nacre_error *error)
{
    double tolerance = run->gather->tolerance, off = 0;
    struct levels levels;
    if (run->gather->appearance->layout != NACRE_KERNEL_PER_TERM || !(tolerance > 0)) {
        return NACRE_OK;
    }
    int status = levels_make(&levels, run->gather->appearance, tolerance, error);
    if (status == NACRE_OK) {
        struct gather_cost cost = gather_cost_of(&run->stock, &levels);
        status = gather_convolved_make(&run->convolved, &run->stock, cost, run->progress, error);
    }
    levels_finish(&levels);
    if (status == NACRE_OK && run->convolved.served.count > 0) {
        status = make_probe(run, error);
    }
    if (status == NACRE_OK && run->convolved.served.count > 0) {
        status = gather_convolved_check(&run->convolved, &run->probe, run->progress, run->exact,
                                        run->light, &off, error);
    }
    run->counts->error = off;
    run->counts->convolved = run->convolved.served.count;
    return status;
}

static int gather_light(struct run *run, struct nacre_error *error)
{
    struct levels levels = {0};
    int64_t start = now_ns();
    int status = convolve(run, error);
    bool all = run->convolved.served.count == run->stock.receivers.count;
    if (status == NACRE_OK && !all) {
        status = choose(run, &levels, error);
    }
    run->counts->choose_seconds = seconds_since(start);
    run->counts->squares = run->counts->posts = 0;
    if (status == NACRE_OK && !all) {
        status = pass(run, &levels, run->convolved.served.count > 0 ? &run->convolved.rest : NULL,
                      run->light, error);
    }
    if (status == NACRE_OK) {
        gather_convolved_put(&run->convolved, run->light);
    }
    levels_finish(&levels);
    return status;
}

static void run_finish(struct run *run)
{
    gather_device_finish(&run->device);
    gather_convolved_finish(&run->convolved);
    gather_probe_finish(&run->probe);
    gather_stock_finish(&run->stock);
    free(run->light);
    free(run->exact);
}

int gather_run(const struct gather *gather, const struct opencl *opencl, struct progress *progress,
               float (*radiosity)[3], struct gather_counts *counts, struct nacre_error *error)
{
    struct run run = {.gather = gather, .progress = progress, .counts = counts};
    int64_t start = now_ns();
    *counts = (struct gather_counts){0};
    int status = prepare(&run, opencl, error);
    counts->prepare_seconds = seconds_since(start);
    start = now_ns();
    counts->receivers = run.stock.receivers.count;
    counts->samples = run.stock.samples.count;
    if (status == NACRE_OK && run.stock.receivers.count > 0) {
        status = gather_light(&run, error);
        for (size_t i = 0; status == NACRE_OK && i < gather->mesh->vertex_count; i++) {
            for (int c = 0; c < 3; c++) {
                radiosity[i][c] += run.light[i][c];
            }
        }
    }
    counts->launch_seconds = seconds_since(start);
    run_finish(&run);
    return status;
}
