/* The conductor of a factorization. */
#include "factor/factorize.h"

#include "factor/assemble.h"
#include "factor/falloff.h"
#include "factor/fill.h"
#include "factor/hals.h"
#include "factor/kmeans.h"
#include "factor/layout.h"
#include "factor/random.h"
#include "factor/update.h"

#include "base/clock.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Streams of random numbers drawn from one seed. */
enum { STREAM_CLUSTERS = 1, STREAM_FACTORS = 2 };

struct factor_options factor_options_default(void)
{
    return (struct factor_options){.terms = 12,
                                   .clusters = 5,
                                   .iterations = 200,
                                   .tolerance = 3e-3,
                                   .kernel = KERNELS_AVERAGE,
                                   .epsilon = 1e-5,
                                   .store = FACTOR_STORE_AUTO};
}

void factor_summary_finish(struct factor_summary *summary)
{
    error_report_finish(&summary->error);
    *summary = (struct factor_summary){0};
}

static double seconds_now(void)
{
    struct clock clock = clock_monotonic();
    return (double)clock_now_ns(&clock) * 1e-9;
}

/* Everything between the responses and the material. */
struct run {
    const struct responses *responses;
    const struct factor_options *options;
    struct progress *progress;
    uint32_t *ids;
    float *kernels;
    struct problem problem;
    struct method *method;
};

/* Cluster the measured points and spread the clusters to the others. */
static int find_clusters(struct run *run, struct nacre_error *error)
{
    const struct responses *r = run->responses;
    struct features features = {0};
    uint32_t *labels = NULL;
    int status = features_new(r, &features, error);
    if (status != NACRE_OK) {
        return status;
    }
    labels = malloc(features.count * sizeof *labels);
    if (!labels) {
        status = nacre_fail_memory(error, "the clusters");
        goto out;
    }
    status = kmeans(features.values, features.count, features.length, run->options->clusters,
                    random_bits((uint64_t)run->options->seed, STREAM_CLUSTERS), labels, error);
    for (size_t i = 0; i < features.count && status == NACRE_OK; i++) {
        run->ids[features.points[i]] = labels[i];
    }
    if (status == NACRE_OK) {
        status = fill_labels(r->width, r->height, r->measured, run->ids, error);
    }
out:
    free(labels);
    features_finish(&features);
    return status;
}

static int prepare(struct run *run, const struct opencl *opencl, struct nacre_error *error)
{
    const struct responses *r = run->responses;
    const struct factor_options *o = run->options;
    size_t points = (size_t)r->width * (size_t)r->height;
    size_t area = (size_t)r->window * (size_t)r->window;
    int status = NACRE_FAILED;
    run->ids = malloc(points * sizeof *run->ids);
    run->kernels = malloc((size_t)o->clusters * (size_t)r->channels * area * sizeof *run->kernels);
    if (!run->ids || !run->kernels) {
        return nacre_fail_memory(error, "the clusters");
    }
    memset(run->ids, 0xff, points * sizeof *run->ids);
    status = find_clusters(run, error);
    if (status == NACRE_OK) {
        status =
            kernels_compute(r, run->ids, o->clusters, o->kernel, o->epsilon, run->kernels, error);
    }
    if (status == NACRE_OK) {
        run->problem = (struct problem){.responses = r,
                                        .ids = run->ids,
                                        .kernels = run->kernels,
                                        .clusters = o->clusters,
                                        .terms = o->terms,
                                        .seed = random_bits((uint64_t)o->seed, STREAM_FACTORS),
                                        .regularise = o->regularise};
        status = o->method == FACTOR_METHOD_MU
                     ? update_new(opencl, &run->problem, NULL, &run->method, error)
                     : hals_new(opencl, &run->problem, NULL, &run->method, error);
    }
    return status;
}

/* All channels' objective in the responses' own unit; `step` as well. */
static int advance(struct run *run, bool step, double *objective, struct nacre_error *error)
{
    const struct method_ops *ops = run->method->ops;
    int status = NACRE_OK;
    *objective = 0;
    for (int c = 0; c < run->responses->channels && status == NACRE_OK; c++) {
        double part = 0;
        status = step ? ops->step(run->method, c, &part, error)
                      : ops->measure(run->method, c, &part, error);
        *objective += ldexp(part, run->responses->exponent[c]);
    }
    return status;
}

/* Whether the last PATIENCE iterations brought little. */
static bool has_settled(const struct nacre_material *m, double tolerance, double objective)
{
    enum { PATIENCE = 5 };
    int known = m->iterations - 1; /* objectives in the history */
    return tolerance > 0 && known >= PATIENCE &&
           objective > (1 - PATIENCE * tolerance) * m->history_objective[known - PATIENCE];
}

/* Iterate, keeping the history. NACRE_CANCELLED leaves the factors as they are. */
static int iterate(struct run *run, struct nacre_material *m, struct factor_summary *summary,
                   struct nacre_error *error)
{
    int iterations = run->options->iterations, status = NACRE_OK, stopped = NACRE_OK;
    double started = seconds_now(), objective = 0;
    char detail[48] = "";
    m->iterations = 0;
    bool settled = false;
    while (m->iterations < iterations && status == NACRE_OK && !settled) {
        stopped =
            progress_step(run->progress, m->iterations, iterations, *detail ? detail : NULL, error);
        if (stopped != NACRE_OK) {
            break;
        }
        status = advance(run, true, &objective, error);
        if (m->iterations > 0) {
            m->history_objective[m->iterations - 1] = (float)objective;
            m->history_seconds[m->iterations - 1] = (float)(seconds_now() - started);
        }
        settled = has_settled(m, run->options->tolerance, objective);
        (void)snprintf(detail, sizeof detail, "objective %.4g", objective);
        m->iterations++;
    }
    if (status == NACRE_OK) {
        status = advance(run, false, &objective, error);
    }
    summary->objective = objective;
    summary->seconds_iterating = seconds_now() - started;
    m->history_count = (size_t)m->iterations;
    if (m->iterations > 0) {
        m->history_objective[m->iterations - 1] = (float)objective;
        m->history_seconds[m->iterations - 1] = (float)summary->seconds_iterating;
    }
    return status == NACRE_OK ? stopped : status;
}

static int allocate_material(const struct responses *r, double pitch_mm,
                             const struct factor_options *o, struct nacre_material *m,
                             struct nacre_error *error)
{
    *m = (struct nacre_material){.width = r->width,
                                 .height = r->height,
                                 .channels = r->channels,
                                 .factor_channels = r->channels,
                                 .window = r->window,
                                 .terms = o->terms,
                                 .clusters = o->clusters,
                                 .mixed = 1,
                                 .layout = NACRE_KERNEL_SINGLE,
                                 .pixel = NACRE_FLOAT,
                                 .pitch_mm = pitch_mm,
                                 .epsilon = o->epsilon,
                                 .seed = o->seed};
    if (nacre_material_allocate(m, true, false, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    m->history_objective = calloc((size_t)o->iterations, sizeof *m->history_objective);
    m->history_seconds = calloc((size_t)o->iterations, sizeof *m->history_seconds);
    return m->history_objective && m->history_seconds ? NACRE_OK
                                                      : nacre_fail_memory(error, "the history");
}

/* A response in its own unit, as error_source wants it. */
static int read_responses(const void *data, int x, int y, float *response,
                          struct nacre_error *error)
{
    (void)error;
    responses_read(data, x, y, response);
    return NACRE_OK;
}

/* Choose how F and H are stored, round them so, and measure the error of what will be in the file. A cancelled run still
 * gets here, so progress is not asked again whether to stop. */
static int round_and_measure(const struct responses *r, enum factor_store store,
                             struct nacre_material *m, struct factor_summary *summary,
                             struct nacre_error *error)
{
    struct error_source from = {r, read_responses};
    size_t count =
        (size_t)m->terms * (size_t)m->factor_channels * (size_t)m->width * (size_t)m->height;
    float *exact = NULL;
    struct error_report report = {0};
    int status = NACRE_OK;
    if (store == FACTOR_STORE_AUTO) {
        exact = malloc(2 * count * sizeof *exact);
        if (!exact) {
            return nacre_fail_memory(error, "the factors");
        }
        memcpy(exact, m->f, count * sizeof *exact);
        memcpy(exact + count, m->h, count * sizeof *exact);
        status = error_measure(&from, m, NULL, &report, error);
    }
    m->pixel = store == FACTOR_STORE_FLOAT ? NACRE_FLOAT : NACRE_HALF;
    nacre_material_round(m);
    if (status == NACRE_OK) {
        status = error_measure(&from, m, NULL, &summary->error, error);
    }
    if (status == NACRE_OK && exact && !(summary->error.whole.mean <= 1.01 * report.whole.mean)) {
        struct error_report rounded = summary->error;
        m->pixel = NACRE_FLOAT;
        memcpy(m->f, exact, count * sizeof *exact);
        memcpy(m->h, exact + count, count * sizeof *exact);
        summary->error = report;
        report = rounded;
    }
    m->error_min = summary->error.whole.minimum;
    m->error_mean = summary->error.whole.mean;
    m->error_max = summary->error.whole.maximum;
    error_report_finish(&report);
    free(exact);
    return status;
}

static int check(const struct responses *r, const struct factor_options *o,
                 struct nacre_error *error)
{
    if (o->terms < 1 || o->clusters < 1 || o->iterations < 1) {
        return nacre_fail(error, "terms, clusters and iterations must be at least 1 each");
    }
    if (o->regularise > 0 && o->method != FACTOR_METHOD_MU) {
        return nacre_fail(error, "--regularise belongs to the multiplicative updates: add "
                                 "--method mu");
    }
    if (r->measured_count == 0) {
        return nacre_fail(error, "no surface point was measured; there is nothing to factor");
    }
    if ((size_t)o->clusters > r->measured_count) {
        return nacre_fail(error,
                          "%d clusters were asked for, but only %zu surface points were measured; "
                          "ask for %zu or fewer with --clusters",
                          o->clusters, r->measured_count, r->measured_count);
    }
    return NACRE_OK;
}

int factorize_responses(const struct responses *r, double pitch_mm, const struct factor_options *o,
                        const struct opencl *opencl, struct progress *progress,
                        struct nacre_material *m, struct factor_summary *summary,
                        struct nacre_error *error)
{
    struct run run = {.responses = r, .options = o, .progress = progress};
    double started = seconds_now();
    int stopped = NACRE_OK;
    int status = check(r, o, error);
    *m = (struct nacre_material){0};
    if (status == NACRE_OK) {
        status = progress_step(progress, 0, o->iterations, "clustering", error);
    }
    if (status == NACRE_OK) {
        status = allocate_material(r, pitch_mm, o, m, error);
    }
    if (status == NACRE_OK) {
        status = prepare(&run, opencl, error);
    }
    summary->seconds_clustering = seconds_now() - started;
    if (status == NACRE_OK && run.method) {
        stopped = iterate(&run, m, summary, error);
        status = stopped == NACRE_CANCELLED && m->iterations > 0 ? NACRE_OK : stopped;
    }
    started = seconds_now();
    if (status == NACRE_OK && run.method) {
        (void)snprintf(m->method, sizeof m->method, "%s", run.method->ops->name);
        status = assemble_material(&run.problem, run.method, m, error);
    }
    if (status == NACRE_OK) {
        status = round_and_measure(r, o->store, m, summary, error);
    }
    summary->seconds_measuring = seconds_now() - started;
    method_free(run.method);
    free(run.ids);
    free(run.kernels);
    if (status != NACRE_OK) {
        nacre_material_finish(m);
        return status;
    }
    return stopped;
}

int factorize(const struct nacre_scan *scan, const struct factor_options *options,
              const struct opencl *opencl, struct progress *progress,
              struct nacre_material *material, struct factor_summary *summary,
              struct nacre_error *error)
{
    struct responses responses;
    double started = seconds_now(), reading = 0;
    *material = (struct nacre_material){0};
    *summary = (struct factor_summary){0};
    int status =
        responses_load(&responses, scan, layout_lanes(opencl), options->responses, progress, error);
    if (status != NACRE_OK) {
        return status;
    }
    reading = seconds_now() - started;
    status = factorize_responses(&responses, nacre_scan_info(scan)->pitch_mm, options, opencl,
                                 progress, material, summary, error);
    if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "%s", nacre_scan_path(scan));
    }
    summary->seconds_reading = reading;
    responses_finish(&responses);
    return status;
}
