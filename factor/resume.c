/* The state of a run as a checkpoint keeps it. */
#include "factor/checkpoint.h"
#include "factor/conductor.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The whole of an attempt that is no array. */
struct attempt_head {
    int terms, clusters, history_count, inherited, known, probed_at, verified, held;
    double objective, error, goal, error_stored, seconds, opening_seconds, first_seconds,
        step_seconds, closing_seconds;
};

struct run_head {
    int now_is_open, has_best;
    double iterated, seconds_clustering, seconds_measuring;
};

static size_t points_of(const struct conductor *c)
{
    return (size_t)c->responses->width * (size_t)c->responses->height;
}

static size_t kernel_bytes(const struct conductor *c, int clusters)
{
    size_t window = (size_t)c->responses->window;
    return (size_t)clusters * (size_t)c->responses->channels * window * window * sizeof(float);
}

/* All that was measured, however it lies in memory. Returns whether there was memory for it. */
static bool sum_responses(const struct responses *r, unsigned long long *total)
{
    size_t area = (size_t)r->window * (size_t)r->window, width = (size_t)r->width;
    bool summed = false;
    unsigned long long *rows = calloc((size_t)r->height, sizeof *rows);
    float *windows = malloc((size_t)r->height * area * sizeof *windows);
    if (rows && windows) {
#pragma omp parallel for
        for (int y = 0; y < r->height; y++) {
            float *window = windows + (size_t)y * area;
            for (size_t i = 0; i < width * (size_t)r->channels; i++) {
                responses_get(r, (int)(i / width), (int)(i % width), y, window);
                rows[y] = checkpoint_sum(rows[y], window, area * sizeof *window);
            }
        }
        *total = checkpoint_sum(checkpoint_sum(0, r->exponent, sizeof r->exponent), rows,
                                (size_t)r->height * sizeof *rows);
        summed = true;
    }
    free(rows);
    free(windows);
    return summed;
}

static void describe_count(char *text, size_t size, int count)
{
    (void)snprintf(text, size, count ? "%d" : "chosen", count);
}

/* What must be the same for a run to go on; time limits and the device are part of it. */
static char *identify(const struct conductor *c)
{
    static const char *const methods[] = {"hals", "mu"}, *const kernels[] = {"average", "max"},
                             *const stores[] = {"auto", "float", "half"},
                             *const weights[] = {"kernel", "response", "auto"};
    const struct factor_options *o = c->options;
    const struct responses *r = c->responses;
    char *text = NULL, terms[16], clusters[16], iterations[16];
    unsigned long long contents = 0;
    char model[96];
    (void)snprintf(model, sizeof model,
                   "terms, %s kernels, %s planes of %d bits, reciprocity %d, states of form 2",
                   o->kernels == FACTOR_KERNELS_FULL ? "full" : "radial",
                   o->planes == FACTOR_PLANES_SEPARATE ? "separate" : "shared", o->bits,
                   (int)o->reciprocity);
    if (!sum_responses(r, &contents)) {
        return NULL;
    }
    describe_count(terms, sizeof terms, c->search.terms);
    describe_count(clusters, sizeof clusters, c->search.clusters);
    describe_count(iterations, sizeof iterations, o->iterations);
    int written = asprintf(
        &text,
        "scan: %d x %d points, window %d, %d channels, pitch %.9g mm, contents %016llx\n"
        "device: %s, %d lanes, responses as %s\n"
        "model: %s\nmethod: %s\nweight: %s\nterms: %s\nclusters: %s\niterations: %s\ntolerance: "
        "%.9g\nerror: "
        "%.9g\n"
        "within: %.9g s\nkernel: %s\nepsilon: %.9g\nregularise: %.9g\nstore: %s\nseed: %d\n",
        r->width, r->height, r->window, r->channels, c->pitch_mm, contents, c->opencl->name,
        r->lanes, r->half ? "half floats" : "floats",
        o->model == FACTOR_MODEL_TERMS ? model : "clusters", methods[o->method], weights[o->weight],
        terms, clusters, iterations, o->tolerance, o->error, o->seconds, kernels[o->kernel],
        o->epsilon, o->regularise, stores[o->store], o->seed);
    return written < 0 ? NULL : text;
}

static int ensure_identity(struct conductor *c, struct nacre_error *error)
{
    c->identity = c->identity ? c->identity : identify(c);
    return c->identity ? NACRE_OK : nacre_fail_memory(error, "the checkpoint");
}

static void put_attempt(const struct conductor *c, const struct attempt *a, double seconds,
                        struct blob *blob)
{
    const struct attempt_head head = {.terms = a->problem.terms,
                                      .clusters = a->problem.clusters,
                                      .history_count = a->history.count,
                                      .inherited = a->inherited,
                                      .known = a->known,
                                      .probed_at = a->probed_at,
                                      .verified = a->verified,
                                      .held = a->held,
                                      .objective = a->objective,
                                      .error = a->error,
                                      .goal = a->goal,
                                      .error_stored = a->error_stored,
                                      .seconds = seconds,
                                      .opening_seconds = a->opening_seconds,
                                      .first_seconds = a->first_seconds,
                                      .step_seconds = a->step_seconds,
                                      .closing_seconds = a->closing_seconds};
    size_t history = (size_t)a->history.count * sizeof(float);
    blob_put(blob, &head, sizeof head);
    blob_put(blob, a->ids, points_of(c) * sizeof *a->ids);
    blob_put(blob, a->kernels, kernel_bytes(c, a->problem.clusters));
    blob_put(blob, a->history.objective, history);
    blob_put(blob, a->history.seconds, history);
    blob_put(blob, a->history.error, history);
}

/* Counts that are about to size memory. */
static bool is_plausible(const struct conductor *c, const struct attempt_head *h,
                         const struct blob *blob)
{
    return h->terms >= 1 && h->terms <= 1000 && h->clusters >= 1 &&
           (size_t)h->clusters <= c->responses->measured_count && h->history_count >= 0 &&
           h->inherited >= 0 && h->inherited <= h->history_count && h->known >= h->inherited &&
           h->known <= h->history_count && h->probed_at <= h->history_count &&
           (size_t)h->history_count <= blob_left(blob) / sizeof(float);
}

static int fail_contents(struct nacre_error *error)
{
    return nacre_fail(error, "its contents contradict themselves; remove it to begin anew");
}

static int get_attempt(const struct conductor *c, struct attempt *a, struct blob *blob,
                       struct nacre_error *error)
{
    struct attempt_head head = {0};
    blob_get(blob, &head, sizeof head);
    if (blob->failed || !is_plausible(c, &head, blob)) {
        return fail_contents(error);
    }
    int status = attempt_begin(a, c->responses, NULL, conductor_data(c), c->options, head.terms,
                               head.clusters, error);
    for (int i = 0; i < head.history_count && status == NACRE_OK; i++) {
        status = attempt_extend_history(a, error);
    }
    if (status != NACRE_OK) {
        return status;
    }
    size_t history = (size_t)head.history_count * sizeof(float);
    blob_get(blob, a->ids, points_of(c) * sizeof *a->ids);
    blob_get(blob, a->kernels, kernel_bytes(c, head.clusters));
    blob_get(blob, a->history.objective, history);
    blob_get(blob, a->history.seconds, history);
    blob_get(blob, a->history.error, history);
    for (size_t i = 0; i < points_of(c) && !blob->failed; i++) {
        blob->failed = a->ids[i] >= (uint32_t)head.clusters;
    }
    a->inherited = head.inherited;
    a->known = head.known;
    a->probed_at = head.probed_at;
    a->verified = head.verified;
    a->held = head.held;
    a->objective = head.objective;
    a->error = head.error;
    a->goal = head.goal;
    a->error_stored = head.error_stored;
    a->seconds = head.seconds;
    a->opening_seconds = head.opening_seconds;
    a->first_seconds = head.first_seconds;
    a->step_seconds = head.step_seconds;
    a->closing_seconds = head.closing_seconds;
    return blob->failed ? fail_contents(error) : NACRE_OK;
}

/* The planes and kernels of factors that there are, one after the other: put, or got. */
static void move_factors(const struct factors *f, struct blob *blob,
                         void (*move)(struct blob *blob, float *values, size_t bytes))
{
    size_t planes = (size_t)f->terms * (size_t)f->width * (size_t)f->height * sizeof(float);
    size_t kernels = (size_t)f->terms * (size_t)f->numbers * sizeof(float);
    for (int c = 0; c < f->channels; c++) {
        move(blob, f->f[c], f->f[c] ? planes : 0);
        move(blob, f->h[c], f->h[c] ? planes : 0);
        move(blob, f->kernels[c], f->kernels[c] ? kernels : 0);
    }
}

static void put_values(struct blob *blob, float *values, size_t bytes)
{
    if (bytes > 0) {
        blob_put(blob, values, bytes);
    }
}

static void get_values(struct blob *blob, float *values, size_t bytes)
{
    if (bytes > 0) {
        blob_get(blob, values, bytes);
    }
}

/* The open attempt's method. */
static int put_states(struct conductor *c, struct blob *blob, struct nacre_error *error)
{
    struct method *method = c->now.method;
    size_t first = method->ops->state_size(method, 0);
    int status = NACRE_OK;
    blob_put(blob, &first, sizeof first);
    for (int i = 0; i < c->responses->channels && status == NACRE_OK; i++) {
        size_t size = method->ops->state_size(method, i);
        void *state = malloc(size); /* aligned, as places in the blob need not be */
        status = state ? method->ops->save(method, i, state, error)
                       : nacre_fail_memory(error, "the checkpoint");
        blob_put(blob, state, status == NACRE_OK ? size : 0);
        free(state);
    }
    return status;
}

static int get_states(struct conductor *c, struct blob *blob, struct nacre_error *error)
{
    struct method *method = c->now.method;
    size_t first = 0;
    int status = NACRE_OK;
    blob_get(blob, &first, sizeof first);
    if (blob->failed || first != method->ops->state_size(method, 0)) {
        return fail_contents(error);
    }
    for (int i = 0; i < c->responses->channels && status == NACRE_OK; i++) {
        size_t size = method->ops->state_size(method, i);
        void *state = malloc(size);
        if (!state) {
            return nacre_fail_memory(error, "the checkpoint");
        }
        blob_get(blob, state, size);
        status = blob->failed ? fail_contents(error) : method->ops->load(method, i, state, error);
        free(state);
    }
    return status;
}

int conductor_save(struct conductor *c, struct nacre_error *error)
{
    struct blob blob = {0};
    double now = conductor_seconds(c);
    const struct run_head head = {.now_is_open = c->now_is_open,
                                  .has_best = c->best.ids != NULL,
                                  .iterated = c->iterated_before + now - c->iterating_since,
                                  .seconds_clustering = c->seconds_clustering,
                                  .seconds_measuring = c->seconds_measuring};
    int status = ensure_identity(c, error);
    blob_put(&blob, &head, sizeof head);
    blob_put(&blob, &c->search, sizeof c->search);
    if (status == NACRE_OK && head.has_best) {
        put_attempt(c, &c->best, c->best.seconds, &blob);
        move_factors(&c->best.factors, &blob, put_values);
    }
    if (status == NACRE_OK && head.now_is_open) {
        put_attempt(c, &c->now, c->now.seconds + now, &blob);
        status = put_states(c, &blob, error);
    }
    if (status == NACRE_OK) {
        status = checkpoint_write(c->options->checkpoint, c->identity, &blob, error);
    }
    blob_finish(&blob);
    return status;
}

static int get_best(struct conductor *c, struct blob *blob, struct nacre_error *error)
{
    int status = get_attempt(c, &c->best, blob, error);
    if (status == NACRE_OK) {
        move_factors(&c->best.factors, blob, get_values);
    }
    return status;
}

/* The limits of the search follow from scan and options, which are the same. */
static int get_search(struct conductor *c, struct blob *blob, struct nacre_error *error)
{
    struct search search = {0};
    blob_get(blob, &search, sizeof search);
    if (blob->failed || search.count < 0 || search.count > SEARCH_TRIES) {
        return fail_contents(error);
    }
    c->search.count = search.count;
    memcpy(c->search.tries, search.tries, sizeof search.tries);
    return NACRE_OK;
}

static int get_run(struct conductor *c, struct blob *blob, struct nacre_error *error)
{
    struct run_head head = {0};
    blob_get(blob, &head, sizeof head);
    int status = get_search(c, blob, error);
    if (status == NACRE_OK && head.has_best) {
        status = get_best(c, blob, error);
    }
    if (status == NACRE_OK && head.now_is_open) {
        status = get_attempt(c, &c->now, blob, error);
        if (status == NACRE_OK) {
            status = conductor_make_method(c, error);
        }
        if (status == NACRE_OK) {
            status = get_states(c, blob, error);
        }
        if (status == NACRE_OK && tell_is_heard(&c->options->listener)) {
            c->now.method->ops->explain(c->now.method, &c->options->listener);
        }
        c->now.seconds -= conductor_seconds(c);
        c->now_is_open = true;
    }
    if (status == NACRE_OK && (blob->failed || blob_left(blob) > 0)) {
        status = fail_contents(error);
    }
    c->iterated_before = head.iterated;
    c->seconds_clustering = head.seconds_clustering;
    c->seconds_measuring = head.seconds_measuring;
    c->continued = true;
    return status;
}

int conductor_resume(struct conductor *c, struct nacre_error *error)
{
    struct blob blob = {0};
    if (!c->options->checkpoint) {
        return NACRE_OK;
    }
    int status = ensure_identity(c, error);
    if (status == NACRE_OK) {
        status = checkpoint_read(c->options->checkpoint, c->identity, &blob, error);
    }
    if (status == NACRE_OK && blob.size > 0) {
        status = get_run(c, &blob, error);
        if (status == NACRE_FAILED) {
            (void)nacre_fail_within(error, "checkpoint %s", c->options->checkpoint);
        }
    }
    blob_finish(&blob);
    return status;
}
