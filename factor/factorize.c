/* The factorization of a scan from end to end. */
#include "factor/factorize.h"

#include "factor/conductor.h"
#include "factor/layout.h"
#include "factor/random.h"
#include "factor/shape.h"
#include "factor/terms.h"
#include "factor/terms_material.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The number of points that are watched, drawn from the seed. */
enum { PROBE_POINTS = 256, STREAM_PROBE = 4 };

enum { SHAPED_TERMS = 8, SHAPED_MOST = 32 };

enum {
    DEFAULT_TERMS = 12,
    DEFAULT_CLUSTERS = 5,
    DEFAULT_ITERATIONS = 200,
    SHAPED_ITERATIONS = 1000
};

/* What a search may try: no more terms and clusters than these, and no material above this share of its responses. */
enum { MOST_TERMS = 64, MOST_CLUSTERS = 100 };
#define MOST_SHARE 0.25

struct factor_options factor_options_default(void)
{
    return (struct factor_options){.terms = DEFAULT_TERMS,
                                   .clusters = DEFAULT_CLUSTERS,
                                   .iterations = DEFAULT_ITERATIONS,
                                   .tolerance = 3e-3,
                                   .error = 1,
                                   .kernel = KERNELS_AVERAGE,
                                   .epsilon = 1e-5,
                                   .store = FACTOR_STORE_AUTO,
                                   .bits = 8,
                                   .weight = FACTOR_WEIGHT_AUTO,
                                   .checkpoint_seconds = 60};
}

void factor_summary_finish(struct factor_summary *summary)
{
    error_report_finish(&summary->error);
    *summary = (struct factor_summary){0};
}

/* Stages lead up to settings that are known. */
static int check_stages(const struct responses *r, const struct factor_options *o,
                        struct nacre_error *error)
{
    if (o->checkpoint) {
        return nacre_fail(error,
                          "--checkpoint cannot tell where a run --from fewer terms is; leave out "
                          "one of them");
    }
    if (o->error < 1 || o->seconds > 0 || o->checkpoint || o->terms == 0 ||
        (o->model == FACTOR_MODEL_CLUSTERS && o->clusters == 0)) {
        return nacre_fail(error,
                          "--from needs --terms and --clusters, and goes with none of --error, "
                          "--within and --checkpoint");
    }
    for (int i = 0; i < o->stage_count; i++) {
        const struct factor_stage *stage = &o->stages[i];
        int next = i + 1 < o->stage_count ? o->stages[i + 1].terms : o->terms;
        bool has_clusters = o->model == FACTOR_MODEL_CLUSTERS || stage->clusters == 1;
        if (stage->terms < 1 || stage->terms >= next || stage->clusters < 1 ||
            (size_t)stage->clusters > r->measured_count || !has_clusters || stage->iterations < 1) {
            return nacre_fail(
                error,
                "--from %d/%d/%d: terms must grow from stage to stage, clusters be at "
                "most the measured points (1 with --model terms) and iterations 1 or "
                "more",
                stage->terms, stage->clusters, stage->iterations);
        }
    }
    return NACRE_OK;
}

static int check(const struct responses *r, const struct factor_options *o,
                 struct nacre_error *error)
{
    if (o->terms < 0 || o->clusters < 0 || o->iterations < 0) {
        return nacre_fail(error, "terms, clusters and iterations must be at least 1 each");
    }
    if (o->model == FACTOR_MODEL_TERMS && o->clusters > 0) {
        return nacre_fail(error,
                          "--clusters belongs to --model clusters; a kernel per term has none");
    }
    if (o->model == FACTOR_MODEL_TERMS && o->method == FACTOR_METHOD_MU) {
        return nacre_fail(error, "--method mu belongs to --model clusters; leave it out");
    }
    if (o->model == FACTOR_MODEL_TERMS && o->terms > TERMS_MOST) {
        return nacre_fail(error,
                          "%d terms are too many for a kernel each, of which there can be %d; use "
                          "--model clusters",
                          o->terms, TERMS_MOST);
    }
    if (o->regularise > 0 && o->method != FACTOR_METHOD_MU) {
        return nacre_fail(error, "--regularise belongs to the multiplicative updates: add "
                                 "--method mu");
    }
    if (o->stage_count > 0 && check_stages(r, o, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (r->measured_count == 0) {
        return nacre_fail(error, "no surface point was measured; there is nothing to factor");
    }
    if (o->clusters > 0 && (size_t)o->clusters > r->measured_count) {
        return nacre_fail(error,
                          "%d clusters were asked for, but only %zu surface points were measured; "
                          "ask for %zu or fewer with --clusters",
                          o->clusters, r->measured_count, r->measured_count);
    }
    return NACRE_OK;
}

/* With a kernel per term there are terms alone to choose. */
static void begin_shaped(struct conductor *c)
{
    const struct terms_data *d = c->data;
    struct search *s = &c->search;
    double sets = terms_data_sets(d) * d->copy_count, points = (double)s->points;
    int told = c->options->bits == FACTOR_BITS_AUTO ? FACTOR_BITS_LEAST : c->options->bits;
    double bits = told > 0 ? told : 16;
    s->shaped = true;
    s->clusters = 1;
    s->plane_bytes = sets * points * bits / 8;
    s->kernel_bytes = 4.0 * d->grid.count * (double)s->channels;
    s->other_bytes = points * ((double)s->channels * fmax(bits, 8) + (d->gain ? bits : 0)) /
                     8; /* centre, gain */
    s->most_terms = SHAPED_MOST;
}

/* What there is to try: all sizes within reason where an error or a time is given, else the defaults. */
static void begin_search(struct conductor *c)
{
    const struct responses *r = c->responses;
    const struct factor_options *o = c->options;
    bool chooses = conductor_wants_error(c) || conductor_has_deadline(c);
    size_t points = (size_t)r->width * (size_t)r->height;
    struct search *s = &c->search;
    *s = (struct search){.terms = o->terms,
                         .clusters = o->clusters,
                         .most_terms = MOST_TERMS,
                         .most_clusters = MOST_CLUSTERS,
                         .cheapest = conductor_wants_error(c),
                         .points = points,
                         .channels = (size_t)r->channels,
                         .window = (size_t)r->window,
                         .value_bytes = o->store == FACTOR_STORE_FLOAT ? 4 : 2};
    if (o->model == FACTOR_MODEL_TERMS) {
        begin_shaped(c);
    }
    s->most_bytes = MOST_SHARE * (double)points * r->channels * r->window * r->window * 4;
    if (r->measured_count < MOST_CLUSTERS) {
        s->most_clusters = (int)r->measured_count;
    }
    if (!chooses) {
        s->terms = s->terms ? s->terms : s->shaped ? c->shaped_terms : DEFAULT_TERMS;
        s->clusters = s->clusters                           ? s->clusters
                      : s->most_clusters < DEFAULT_CLUSTERS ? s->most_clusters
                                                            : DEFAULT_CLUSTERS;
    }
}

static void explain_stops(const struct conductor *c)
{
    const struct factor_options *o = c->options;
    const struct listener *to = &o->listener;
    if (conductor_wants_error(c)) {
        tell(to, "stops", "when the mean error of the material as stored is at most %.4g %%",
             100 * o->error);
    }
    if (conductor_has_deadline(c)) {
        tell(to, "stops", "so that all is written %.4g s after the command began", o->seconds);
    }
    if (o->tolerance > 0) {
        tell(to, "stops", "when five iterations lower the objective by less than %.3g %%%s",
             500 * o->tolerance,
             o->model == FACTOR_MODEL_TERMS && !conductor_wants_error(c)
                 ? ", and the later half of all by less than three times that or what is left is "
                   "noise"
                 : "");
    }
    if (o->iterations > 0) {
        tell(to, "stops", "after %d iterations", o->iterations);
    } else if (!conductor_wants_error(c) && !conductor_has_deadline(c)) {
        tell(to, "stops", "after %d iterations (default)",
             o->model == FACTOR_MODEL_TERMS ? SHAPED_ITERATIONS : DEFAULT_ITERATIONS);
    }
}

static void explain_count(const struct listener *to, const char *key, int given, int used, int most)
{
    if (given) {
        tell(to, key, "%d, as asked for", given);
    } else if (used) {
        tell(to, key, "%d (default)", used);
    } else {
        tell(to, key, "to be chosen, at most %d", most);
    }
}

static void explain(const struct conductor *c)
{
    const struct factor_options *o = c->options;
    const struct listener *to = &o->listener;
    const struct responses *r = c->responses;
    double value_bytes = r->half ? 2 : 4;
    double mask_bytes = r->mask_needed ? 2.0 / r->lanes : 0;
    double bytes = (double)r->channels * (double)r->size * (value_bytes + mask_bytes);
    tell(to, "device", "%s, %u compute units", c->opencl->name, c->opencl->compute_units);
    tell(to, "responses",
         "%zu of %d x %d points measured, windows of %d x %d, %d channels: %.1f MiB as %s%s",
         r->measured_count, r->width, r->height, r->window, r->window, r->channels, bytes * 0x1p-20,
         r->half ? "half floats" : "floats",
         r->mask_needed ? ", with entries that were not measured" : "");
    explain_count(to, "terms", o->terms, c->search.terms, c->search.most_terms);
    if (!c->search.shaped) {
        explain_count(to, "clusters", o->clusters, c->search.clusters, c->search.most_clusters);
    }
    explain_stops(c);
    tell(to, "error while iterating", "of %zu points", c->probe.count);
    if (c->prepared->quality.pairs > 0) {
        tell(to, "noise",
             "about %.2g %% of a response, by %zu reciprocal pairs; beyond it these differ by %.2g "
             "%%",
             100 * c->prepared->quality.floor, c->prepared->quality.pairs,
             100 * c->prepared->quality.reciprocity);
    }
    if (c->continued) {
        tell(to, "continues", "from %s, after %d earlier tries and %d iterations", o->checkpoint,
             c->search.count, c->now_is_open ? attempt_iterations(&c->now) : 0);
    }
}

static bool is_same_data(const struct terms_options *a, const struct terms_options *b)
{
    return a->reciprocity == b->reciprocity && a->weight == b->weight && a->full == b->full &&
           a->separate == b->separate;
}

/* The responses as a kernel per term wants them: taken over from another run, or made. */
static int begin_data(struct conductor *c, struct nacre_error *error)
{
    const struct factor_options *o = c->options;
    const struct terms_options options = {
        .reciprocity = o->reciprocity,
        .weight = o->weight == FACTOR_WEIGHT_KERNEL ? TERMS_WEIGHT_KERNEL : TERMS_WEIGHT_RESPONSE,
        .full = o->kernels == FACTOR_KERNELS_FULL,
        .separate = o->planes == FACTOR_PLANES_SEPARATE && c->responses->channels > 1};
    struct prepared_data *slot = NULL;
    double begun = conductor_seconds(c);
    bool same = false;
    for (int i = 0; i < PREPARED_DATA && !same; i++) {
        struct prepared_data *d = &c->prepared->data[i];
        same = d->ready && is_same_data(&d->options, &options) && d->epsilon == o->epsilon;
        slot = same || !slot || !d->ready ? d : slot;
    }
    c->data = &slot->data;
    if (same) {
        c->shared_seconds += slot->seconds;
        return NACRE_OK;
    }
    terms_data_finish(&slot->data);
    *slot = (struct prepared_data){.options = options, .epsilon = o->epsilon};
    int status = terms_data_begin(&slot->data, c->responses, &options, o->epsilon, error);
    slot->ready = status == NACRE_OK;
    slot->seconds = conductor_seconds(c) - begun;
    return status;
}

/* What does not depend on the settings: taken over from another run, or measured. */
static int prepare(struct conductor *c, struct nacre_error *error)
{
    struct factor_prepared *p = c->prepared;
    double begun = conductor_seconds(c);
    if (p->ready) {
        c->shared_seconds += p->seconds;
        return NACRE_OK;
    }
    int status = features_new(c->responses, &p->features, error);
    if (status == NACRE_OK) {
        status = quality_measure(c->responses, &p->quality, error);
    }
    p->ready = status == NACRE_OK;
    p->seconds = conductor_seconds(c) - begun;
    return status;
}

/* Replace what is auto of kernels and planes. */
static int choose_shape(struct conductor *c, struct factor_options *o, struct nacre_error *error)
{
    int terms = o->terms > 0 ? o->terms : SHAPED_TERMS;
    struct shape shape = {.terms = terms};
    bool wanted = o->kernels == FACTOR_KERNELS_AUTO || o->planes == FACTOR_PLANES_AUTO;
    int status = NACRE_OK;
    if (o->model == FACTOR_MODEL_TERMS && wanted && !conductor_has_deadline(c)) {
        status = shape_choose(c->responses, &c->prepared->features, o, c->opencl, terms,
                              c->progress, &shape, error);
    } else if (o->model == FACTOR_MODEL_TERMS && wanted) {
        tell(&o->listener, "kernels and planes",
             "radial and shared where they are not given, as time is limited");
        shape.full = o->kernels == FACTOR_KERNELS_FULL;
        shape.separate = o->planes == FACTOR_PLANES_SEPARATE;
    }
    if (wanted) {
        o->kernels = shape.full ? FACTOR_KERNELS_FULL : FACTOR_KERNELS_RADIAL;
        o->planes = shape.separate ? FACTOR_PLANES_SEPARATE : FACTOR_PLANES_SHARED;
    }
    c->shaped_terms = shape.terms;
    return status;
}

static int begin(struct conductor *c, struct factor_options *o, struct nacre_error *error)
{
    int status = progress_step(c->progress, 0, 1, "clustering", error);
    if (status != NACRE_OK) {
        return status;
    }
    double begun = conductor_seconds(c);
    if (conductor_has_deadline(c) && begun > o->seconds) {
        return nacre_fail(error,
                          "%.3g s are too few: reading the scan alone took until %.3g s; ask for "
                          "twice that or more",
                          o->seconds, begun);
    }
    c->prepared = o->prepared ? o->prepared : &c->own;
    status = prepare(c, error);
    if (status == NACRE_OK) {
        status = choose_shape(c, o, error);
    }
    if (status == NACRE_OK && o->model == FACTOR_MODEL_TERMS) {
        status = begin_data(c, error);
    }
    if (status == NACRE_OK) {
        begin_search(c);
        status = probe_begin(&c->probe, c->responses, PROBE_POINTS,
                             random_bits((uint64_t)o->seed, STREAM_PROBE), error);
    }
    if (status == NACRE_OK) {
        status = conductor_resume(c, error);
    }
    c->seconds_clustering += conductor_seconds(c) - begun;
    if (status == NACRE_OK && tell_is_heard(&o->listener)) {
        explain(c);
    }
    return status;
}

/* Say what rounding does to the planes, which nothing else uses afterwards. */
static int warn_of_rounding(struct conductor *c, struct nacre_material *m,
                            struct nacre_error *error)
{
    struct attempt *a = &c->best;
    if (!a->problem.data || m->bits == 0 ||
        (c->options->bits == FACTOR_BITS_AUTO && !conductor_has_deadline(c))) {
        return NACRE_OK;
    }
    double fitted = probe_measure(&c->probe, &a->problem, &a->factors);
    if (terms_material_round(&a->problem, m->bits, &a->factors, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    return quality_warn_planes(m->bits, fitted, probe_measure(&c->probe, &a->problem, &a->factors),
                               m, error);
}

/* The best attempt as a material, with its history. */
static int complete(struct conductor *c, struct nacre_material *m, struct factor_summary *summary,
                    struct nacre_error *error)
{
    struct attempt *a = &c->best;
    double begun = conductor_seconds(c);
    int status = NACRE_OK;
    if (a->held) {
        *m = c->made;
        summary->error = c->made_report;
        c->made = (struct nacre_material){0};
        c->made_report = (struct error_report){0};
    }
    if (!m->f) {
        status = conductor_make_material(c, a, m, &summary->error, error);
        c->seconds_measuring += conductor_seconds(c) - begun;
    }
    if (status == NACRE_OK) {
        status = quality_warn(&c->prepared->quality, c->options->error, m, error);
    }
    if (status == NACRE_OK) {
        status = warn_of_rounding(c, m, error);
    }
    if (status != NACRE_OK) {
        return status;
    }
    (void)snprintf(m->method, sizeof m->method, "%s%s",
                   c->options->model == FACTOR_MODEL_TERMS  ? "terms"
                   : c->options->method == FACTOR_METHOD_MU ? "mu"
                                                            : "hals",
                   c->options->model == FACTOR_MODEL_TERMS
                       ? (c->options->weight == FACTOR_WEIGHT_KERNEL ? ", weight kernel" : "")
                   : c->options->weight == FACTOR_WEIGHT_RESPONSE ? ", weight response"
                                                                  : "");
    m->iterations = a->history.count;
    m->history_count = (size_t)a->history.count;
    m->history_objective = a->history.objective;
    m->history_seconds = a->history.seconds;
    m->history_error = a->history.error;
    a->history = (struct history){0};
    summary->objective = a->objective;
    summary->seconds_step = a->step_seconds;
    return NACRE_OK;
}

static const char *stop_word(const struct conductor *c, int stopped)
{
    static const char *const words[] = {
        [ENDING_ITERATIONS] = "iterations", [ENDING_TOLERANCE] = "tolerance",
        [ENDING_ERROR] = "error",           [ENDING_TIME] = "time",
        [ENDING_REQUEST] = "request",
    };
    if (stopped == NACRE_CANCELLED) {
        return "request";
    }
    if (c->best.held) {
        return "error";
    }
    return c->ending < sizeof words / sizeof *words && words[c->ending] ? words[c->ending]
                                                                        : "end of search";
}

static void summarise(const struct conductor *c, int stopped, struct factor_summary *s)
{
    (void)snprintf(s->stopped_by, sizeof s->stopped_by, "%s", stop_word(c, stopped));
    s->error_held = !conductor_wants_error(c) || s->error.whole.mean <= c->options->error;
    s->continued = c->continued;
    s->search = c->search;
    s->seconds_clustering = c->seconds_clustering;
    s->seconds_measuring = c->seconds_measuring;
    for (int i = 0; i < s->search.count; i++) {
        struct search_try *try = &s->search.tries[i];
        if (try->terms == c->best.problem.terms && try->clusters == c->best.problem.clusters) {
            try->error = s->error.whole.mean;
            try->verified = true;
        }
    }
}

int factorize_responses(const struct responses *r, double pitch_mm, const struct factor_options *o,
                        const struct opencl *opencl, struct progress *progress,
                        struct nacre_material *m, struct factor_summary *summary,
                        struct nacre_error *error)
{
    struct clock system = clock_monotonic();
    struct factor_options chosen = *o;
    struct conductor c = {.responses = r,
                          .pitch_mm = pitch_mm,
                          .options = &chosen,
                          .opencl = opencl,
                          .progress = progress,
                          .clock = o->clock ? o->clock : &system};
    int stopped = NACRE_OK;
    c.begun_ns = o->begun_ns ? o->begun_ns : clock_now_ns(c.clock);
    *m = (struct nacre_material){0};
    *summary = (struct factor_summary){.half_responses = r->half};
    int status = check(r, o, error);
    if (status == NACRE_OK) {
        status = begin(&c, &chosen, error);
    }
    if (status == NACRE_OK) {
        double begun = conductor_seconds(&c) - c.seconds_clustering - c.seconds_measuring;
        stopped = conductor_run(&c, error);
        summary->seconds_iterating =
            conductor_seconds(&c) - c.seconds_clustering - c.seconds_measuring - begun;
        status = stopped == NACRE_CANCELLED && c.best.ids ? NACRE_OK : stopped;
    }
    if (status == NACRE_OK && !o->watcher) {
        status = complete(&c, m, summary, error);
    }
    if (status == NACRE_OK) {
        summarise(&c, stopped, summary);
    }
    conductor_finish(&c);
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
    struct clock system = clock_monotonic();
    struct factor_options timed = *options;
    struct responses responses;
    timed.clock = options->clock ? options->clock : &system;
    int64_t begun_ns = clock_now_ns(timed.clock);
    timed.begun_ns = options->begun_ns ? options->begun_ns : begun_ns;
    *material = (struct nacre_material){0};
    *summary = (struct factor_summary){0};
    int status = responses_load(&responses, scan, options->window, layout_lanes(opencl),
                                options->responses, progress, error);
    if (status != NACRE_OK) {
        return status;
    }
    double reading = (double)(clock_now_ns(timed.clock) - begun_ns) * 1e-9;
    status = factorize_responses(&responses, nacre_scan_info(scan)->pitch_mm, &timed, opencl,
                                 progress, material, summary, error);
    if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "%s", nacre_scan_path(scan));
    }
    summary->seconds_reading = reading;
    responses_finish(&responses);
    return status;
}
