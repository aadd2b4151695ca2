/* Running the factorizations of a study within its budget. */
#include "study/tradeoff.h"

#include "factor/attempt.h"
#include "factor/closing.h"
#include "factor/factors.h"
#include "study/tradeoff_front.h"
#include "study/tradeoff_plan.h"
#include "study/tradeoff_window.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What is left of the budget for writing the results. */
#define RESERVE 0.02

/* The study while it runs. */
struct runner {
    const struct responses *responses; /* of the scan's window */
    double pitch_mm;
    const struct tradeoff_request *request;
    const struct opencl *opencl;
    struct progress *progress;
    struct clock *clock;
    int64_t begun_ns;
    double deadline; /* seconds since begun_ns */
    struct dataset {
        struct responses responses; /* with a smaller window */
        bool ready;
        struct factor_prepared prepared;
    } datasets[TRADEOFF_WINDOWS]; /* as tradeoff->windows; the first has no responses of its own */
    struct tradeoff *tradeoff;
    struct factor_watcher watcher; /* that looks at the runs */
    struct factor_options options; /* of the run */
    double closing_seconds;        /* the longest look so far */
    bool out_of_time;
};

static double seconds_of(const struct runner *r)
{
    return (double)(clock_now_ns(r->clock) - r->begun_ns) * 1e-9;
}

int tradeoff_begin(struct tradeoff *t, struct nacre_error *error)
{
    *t = (struct tradeoff){0};
    t->points = calloc(TRADEOFF_POINTS, sizeof *t->points);
    return t->points ? NACRE_OK : nacre_fail_memory(error, "the points of the study");
}

static void drop_factors(struct tradeoff_run *run)
{
    if (run->kept) {
        factors_finish(run->kept);
        free(run->kept);
        run->kept = NULL;
    }
}

void tradeoff_finish(struct tradeoff *t)
{
    for (int i = 0; i < t->run_count; i++) {
        drop_factors(&t->runs[i]);
    }
    free(t->points);
    *t = (struct tradeoff){0};
}

/* Seconds of the stages that a run starts from, as points count them, but for what any run does again. */
static double stage_seconds(const struct tradeoff *t, const struct tradeoff_run *run)
{
    return run->setting.parent < 0 ? 0 : t->runs[run->setting.parent].kept_seconds;
}

/* Store the factors in one way and measure what becomes of them. */
static int add_point(struct runner *r, const struct factor_look *look, enum factor_store store,
                     int bits, struct nacre_error *error)
{
    struct tradeoff *t = r->tradeoff;
    struct tradeoff_run *run = &t->runs[t->run_count - 1];
    struct factor_options options = r->options;
    struct nacre_material material = {0};
    struct error_report report = {0};
    double begun = seconds_of(r);
    options.store = store;
    options.bits = bits;
    int status = closing_make(&options, r->pitch_mm, look->attempt, &material, &report, error);
    if (status == NACRE_OK && report.whole.points == 0) {
        status = nacre_fail(error, "every response was measured as exactly 0, and has no relative "
                                   "error; look at what was scanned");
    }
    if (status == NACRE_OK && t->point_count < TRADEOFF_POINTS) {
        double took = seconds_of(r) - begun;
        t->points[t->point_count++] = (struct tradeoff_point){
            .run = t->run_count - 1,
            .iterations = look->iterations,
            .store = store,
            .bits = bits,
            .error = report.whole.mean,
            .error_minimum = report.whole.minimum,
            .error_maximum = report.whole.maximum,
            .error_without_centre = report.without_centre.mean,
            .bytes = (double)nacre_material_size(&material),
            .seconds = t->seconds_reading + stage_seconds(t, run) + look->seconds + took};
        run->best_error = fmin(run->best_error, report.whole.mean);
        r->closing_seconds = fmax(r->closing_seconds, took);
    }
    error_report_finish(&report);
    nacre_material_finish(&material);
    return status;
}

/* What other runs may start from. */
static int keep_factors(struct tradeoff_run *run, const struct factor_look *look,
                        struct nacre_error *error)
{
    const struct attempt *a = look->attempt;
    run->kept = run->kept ? run->kept : calloc(1, sizeof *run->kept);
    if (!run->kept) {
        return nacre_fail_memory(error, "factors to start from");
    }
    factors_finish(run->kept);
    int status = factors_allocate(run->kept, &a->problem, error);
    if (status == NACRE_OK) {
        factors_copy(run->kept, &a->factors);
        run->kept_iterations = look->iterations;
    }
    return status;
}

static bool wants(void *data, int iterations)
{
    struct runner *r = data;
    r->out_of_time = seconds_of(r) + 3 * r->closing_seconds > r->deadline;
    return r->out_of_time || tradeoff_looks_at(iterations);
}

/* Widths of planes beside the default's, 8. */
static const int other_bits[] = {6, 10};

/* The way to store that takes fewest bytes is measured at each look, others after the last iteration. */
static int look_at(void *data, const struct factor_look *look, bool *stop,
                   struct nacre_error *error)
{
    struct runner *r = data;
    struct tradeoff *t = r->tradeoff;
    struct tradeoff_run *run = &t->runs[t->run_count - 1];
    bool shaped = run->setting.model == FACTOR_MODEL_TERMS;
    int status = add_point(r, look, FACTOR_STORE_HALF, shaped ? r->options.bits : 0, error);
    if (status == NACRE_OK && look->iterations <= TRADEOFF_KEPT) {
        status = keep_factors(run, look, error);
        run->kept_seconds = stage_seconds(t, run) + look->seconds;
    }
    if (status != NACRE_OK) {
        return status;
    }
    bool dominated = !look->last && tradeoff_is_dominated(t, t->run_count - 1);
    *stop = r->out_of_time || dominated;
    if (*stop) {
        (void)snprintf(run->ended, sizeof run->ended, "%s",
                       r->out_of_time ? "budget" : "dominated");
        return NACRE_OK;
    }
    if (look->last && !shaped) {
        return add_point(r, look, FACTOR_STORE_FLOAT, 0, error);
    }
    for (size_t i = 0; look->last && i < sizeof other_bits / sizeof *other_bits; i++) {
        status = status == NACRE_OK ? add_point(r, look, FACTOR_STORE_HALF, other_bits[i], error)
                                    : status;
    }
    return status;
}

int tradeoff_stages(const struct tradeoff *t, int run, struct factor_stage stages[FACTOR_STAGES])
{
    int count = 0, chain[FACTOR_STAGES];
    for (int i = t->runs[run].setting.parent; i >= 0 && count < FACTOR_STAGES;
         i = t->runs[i].setting.parent) {
        chain[count++] = i;
    }
    for (int i = 0; i < count; i++) {
        const struct tradeoff_run *from = &t->runs[chain[count - 1 - i]];
        stages[i] =
            (struct factor_stage){.terms = from->setting.terms,
                                  .clusters = from->setting.clusters ? from->setting.clusters : 1,
                                  .iterations = from->kept_iterations};
    }
    return count;
}

static struct factor_options options_of(const struct runner *r,
                                        const struct tradeoff_setting *setting)
{
    struct factor_options o = factor_options_default();
    o.model = setting->model;
    o.method = setting->method;
    o.weight = setting->weight;
    o.terms = setting->terms;
    o.clusters = setting->clusters;
    o.epsilon = setting->epsilon;
    o.iterations = TRADEOFF_ITERATIONS;
    o.seed = r->request->seed;
    o.clock = r->clock;
    o.maker = r->request->maker;
    o.start = setting->parent < 0 ? NULL : r->tradeoff->runs[setting->parent].kept;
    return o;
}

/* The responses in a setting's window and what runs share about them. */
static int open_dataset(struct runner *r, int window, const struct responses **responses,
                        struct factor_prepared **prepared, struct nacre_error *error)
{
    int i = 0;
    while (i < r->tradeoff->window_count - 1 && r->tradeoff->windows[i].window != window) {
        i++;
    }
    struct dataset *d = &r->datasets[i];
    *responses = i == 0 ? r->responses : &d->responses;
    *prepared = &d->prepared;
    if (i == 0 || d->ready) {
        return NACRE_OK;
    }
    int status = responses_shrink(&d->responses, r->responses, window, error);
    d->ready = status == NACRE_OK;
    return status;
}

/* A run that failed is no reason to end the study: what it found stays, and why it failed is noted. */
static void note_failure(struct tradeoff_run *run, const struct nacre_error *why)
{
    run->failed = true;
    run->why = *why;
    (void)snprintf(run->ended, sizeof run->ended, "failed");
    drop_factors(run);
}

/* One factorization, looked at as it goes. */
static int run_one(struct runner *r, const struct tradeoff_setting *setting, double predicted,
                   struct nacre_error *error)
{
    struct tradeoff *t = r->tradeoff;
    struct nacre_material material = {0};
    struct factor_summary summary = {0};
    double begun = seconds_of(r);
    struct tradeoff_run *run = &t->runs[t->run_count++];
    *run = (struct tradeoff_run){.setting = *setting,
                                 .predicted = predicted,
                                 .best_error = INFINITY,
                                 .depth =
                                     setting->parent < 0 ? 0 : t->runs[setting->parent].depth + 1};
    r->options = options_of(r, setting);
    const struct responses *responses = NULL;
    struct nacre_error why = {""};
    r->options.watcher = &r->watcher;
    r->out_of_time = false;
    int points = t->point_count;
    int status = open_dataset(r, setting->window, &responses, &r->options.prepared, &why);
    if (status == NACRE_OK) {
        status = factorize_responses(responses, r->pitch_mm, &r->options, r->opencl, r->progress,
                                     &material, &summary, &why);
    }
    if (status == NACRE_OK && !run->ended[0]) {
        (void)snprintf(run->ended, sizeof run->ended, "%.15s", summary.stopped_by);
    }
    run->seconds = seconds_of(r) - begun;
    if (status == NACRE_FAILED) {
        note_failure(run, &why);
        status = NACRE_OK;
    } else if (status != NACRE_OK && error) {
        *error = why;
    }
    if (t->point_count == points && !run->failed) {
        drop_factors(run);
        t->run_count--;
    }
    factor_summary_finish(&summary);
    nacre_material_finish(&material);
    tradeoff_mark_fronts(t);
    return status;
}

int tradeoff_run(const struct responses *responses, double pitch_mm,
                 const struct tradeoff_request *request, const struct opencl *opencl,
                 struct progress *progress, struct tradeoff *t, struct nacre_error *error)
{
    struct clock system = clock_monotonic();
    struct runner r = {.responses = responses,
                       .pitch_mm = pitch_mm,
                       .request = request,
                       .opencl = opencl,
                       .progress = progress,
                       .clock = request->clock ? request->clock : &system,
                       .tradeoff = t};
    struct tradeoff_setting next;
    double predicted = 0;
    int status = NACRE_OK;
    r.watcher = (struct factor_watcher){.wants = wants, .look = look_at, .data = &r};
    r.begun_ns = clock_now_ns(r.clock);
    r.deadline = request->budget * (1 - RESERVE) - request->seconds_reading;
    t->width = responses->width;
    t->height = responses->height;
    t->channels = responses->channels;
    t->window = responses->window;
    t->measured_points = responses->measured_count;
    t->measured_bytes = 4.0 * responses->width * responses->height * responses->channels *
                        responses->window * responses->window;
    t->seconds_reading = request->seconds_reading;
    status = tradeoff_list_windows(responses, t, error);
    while (status == NACRE_OK && tradeoff_next(t, r.deadline - seconds_of(&r), &next, &predicted)) {
        int runs = t->run_count;
        status = run_one(&r, &next, predicted, error);
        if (t->run_count == runs) {
            break; /* no time for a single iteration, or stopped */
        }
    }
    for (int i = 0; i < TRADEOFF_WINDOWS; i++) {
        factor_prepared_finish(&r.datasets[i].prepared);
        responses_finish(&r.datasets[i].responses);
    }
    if (status == NACRE_OK && t->point_count == 0 && t->run_count > 0) {
        status = nacre_fail(error, "no factorization succeeded: %s", t->runs[0].why.text);
    }
    if (status == NACRE_OK && t->point_count == 0) {
        status =
            nacre_fail(error,
                       "a budget of %.3g s is too short for a single factorization, as reading "
                       "the scan alone took %.3g s; give more with --budget",
                       request->budget, request->seconds_reading);
    }
    return status;
}
