/* The gather: choosing how far light is summed up, and checking what that changes. */
#include "render/gather.h"

#include "base/clock.h"
#include "render/gather_cost.h"
#include "render/gather_pass.h"
#include "render/gather_probe.h"
#include "render/sources.h"

#include <math.h>
#include <stdlib.h>

enum { TRIES = 3 };

/* Where the light was off by too much, the next estimate of it is to be this share of what might do. */
static const double caution = 0.6;

struct run {
    const struct gather *gather;
    struct progress *progress;
    struct gather_device device;
    struct receivers receivers;
    struct reach_bundles bundles;
    struct source_set samples;
    float (*light)[3], (*exact)[3];
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

static int pass(struct run *run, const struct levels *levels, const struct reach_bundles *bundles,
                float (*light)[3], struct nacre_error *error)
{
    const struct gather_pass pass = {run->gather, &run->device,  &run->receivers,
                                     bundles,     &run->samples, levels};
    return gather_pass_run(&pass, run->progress, light, run->counts, error);
}

static int gather_plainly(struct run *run, const struct reach_bundles *bundles, float (*light)[3],
                          struct nacre_error *error)
{
    struct levels levels;
    int status = levels_make(&levels, run->gather->appearance, 0, error);
    if (status == NACRE_OK) {
        status = pass(run, &levels, bundles, light, error);
    }
    levels_finish(&levels);
    return status;
}

/* What summing up has changed. */
static int measure(struct run *run, struct nacre_error *error)
{
    struct gather_probe probe;
    int status = gather_probe_make(&probe, &run->receivers, &run->bundles, run->light, error);
    if (status == NACRE_OK) {
        status = gather_plainly(run, &probe.bundles, run->exact, error);
    }
    if (status == NACRE_OK) {
        run->counts->error =
            gather_probe_error(&probe, &run->receivers, &run->bundles, run->light, run->exact);
    }
    gather_probe_finish(&probe);
    return status;
}

static bool pays(const struct run *run, const struct levels *levels)
{
    if (run->gather->way == GATHER_SUMMED) {
        return levels->merges;
    }
    struct gather_cost cost =
        gather_cost_of(run->gather, &run->receivers, &run->bundles, &run->samples, levels);
    return cost.summed < cost.plain;
}

/* Sum up so that the estimate is at most `aim`; *tried is false where that does not pay. */
static int try(struct run *run, double aim, bool *tried, struct nacre_error *error)
{
    struct levels levels;
    int status = levels_make(&levels, run->gather->appearance, aim, error);
    *tried = status == NACRE_OK && pays(run, &levels);
    if (*tried) {
        status = pass(run, &levels, &run->bundles, run->light, error);
    }
    if (*tried && status == NACRE_OK) {
        status = measure(run, error);
    }
    levels_finish(&levels);
    return status;
}

static int gather_light(struct run *run, struct nacre_error *error)
{
    double tolerance = run->gather->tolerance, aim = tolerance;
    struct gather_counts *counts = run->counts;
    for (int i = 0; tolerance > 0 && i < TRIES; i++) {
        bool tried;
        int status = try(run, aim, &tried, error);
        if (status != NACRE_OK || (tried && counts->error <= tolerance)) {
            return status;
        }
        if (!tried) {
            break;
        }
        aim *= fmin(caution * tolerance / counts->error, 0.5);
    }
    counts->error = 0;
    counts->squares = counts->posts = 0;
    return gather_plainly(run, &run->bundles, run->light, error);
}

static int prepare(struct run *run, const struct opencl *opencl, struct nacre_error *error)
{
    const struct gather *gather = run->gather;
    size_t size = gather->mesh->vertex_count + 1;
    if (sources_take(&run->samples, gather->samples, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (run->samples.count == 0 || !gather->appearance->gathers) {
        return NACRE_OK;
    }
    if (receivers_make(&run->receivers, gather->mesh, gather->mapping, gather->appearance, error) !=
            NACRE_OK ||
        reach_bundle(&run->bundles, run->receivers.list, run->receivers.count, error) != NACRE_OK ||
        gather_device_make(&run->device, opencl, gather, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    run->light = calloc(size, sizeof *run->light);
    run->exact = calloc(size, sizeof *run->exact);
    return run->light && run->exact ? NACRE_OK : nacre_fail_memory(error, "the gathered light");
}

static void run_finish(struct run *run)
{
    gather_device_finish(&run->device);
    reach_bundles_finish(&run->bundles);
    receivers_finish(&run->receivers);
    source_set_finish(&run->samples);
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
    counts->receivers = run.receivers.count;
    counts->samples = run.samples.count;
    if (status == NACRE_OK && run.receivers.count > 0) {
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
