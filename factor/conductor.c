/* The conductor: what is tried, what is kept, and when it is enough. */
#include "factor/conductor.h"

#include "factor/hals.h"
#include "factor/random.h"
#include "factor/terms.h"
#include "factor/update.h"
#include "factor/weight.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* Random numbers for terms that are added, drawn from the seed. */
enum { STREAM_GROWTH = 3 };

/* Iterations and closing are taken so much too long: machines have other work too, and the closing no second chance. */
#define CAUTION         1.25
#define CLOSING_CAUTION 2

double conductor_seconds(const struct conductor *c)
{
    return (double)(clock_now_ns(c->clock) - c->begun_ns) * 1e-9;
}

static bool is_searching(const struct conductor *c)
{
    return c->search.terms == 0 || c->search.clusters == 0;
}

static int make_method(void *data, const struct problem *problem, struct method **method,
                       struct nacre_error *error)
{
    const struct conductor *c = data;
    const struct factor_options *o = c->options;
    if (o->maker) {
        return o->maker->make(o->maker->data, problem, method, error);
    }
    if (o->model == FACTOR_MODEL_TERMS) {
        return terms_new(c->opencl, problem, method, error);
    }
    return o->method == FACTOR_METHOD_MU ? update_new(c->opencl, problem, NULL, method, error)
                                         : hals_new(c->opencl, problem, NULL, method, error);
}

int conductor_make_method(struct conductor *c, struct nacre_error *error)
{
    struct attempt *a = &c->now;
    if (c->options->model == FACTOR_MODEL_TERMS) {
        return make_method(c, &a->problem, &a->method, error);
    }
    return c->options->weight == FACTOR_WEIGHT_RESPONSE
               ? weight_new(&a->problem, make_method, c, &a->method, error)
               : make_method(c, &a->problem, &a->method, error);
}

/* An iteration's arithmetic, up to a factor: hals has T^2 / 2 products of few entries beside what grows with T. */
static double step_cost(const struct conductor *c, int terms, int clusters)
{
    double spread = clusters > 1 ? 1.3 : 1;
    if (c->options->model == FACTOR_MODEL_TERMS) {
        return terms * (1 + terms / 8.0);
    }
    return spread * (c->options->method == FACTOR_METHOD_MU ? terms : terms * (1 + terms / 60.0));
}

/* Measuring a material, up to a factor: reading and comparing cost as much as eight terms. */
static double closing_cost(int terms)
{
    return terms + 8;
}

/* Opening with so many terms, up to the end of the first iteration, by how long it took here. What the first iteration
 * took beyond two others was compiling, which grows faster than the terms. */
static double opening_of(const struct attempt *a, int terms)
{
    double ratio = fmax(1, (double)terms / a->problem.terms);
    double compiling = fmax(0, a->first_seconds - 2 * a->step_seconds);
    double rest = a->opening_seconds + a->first_seconds - compiling;
    return ratio * rest + ratio * sqrt(ratio) * compiling;
}

bool conductor_has_time_for(const struct conductor *c, int terms, int clusters)
{
    const struct attempt *a = c->now_is_open ? &c->now : &c->best;
    const struct problem *p = &a->problem;
    if (!conductor_has_deadline(c) || p->terms == 0) {
        return true;
    }
    double step =
        a->step_seconds * step_cost(c, terms, clusters) / step_cost(c, p->terms, p->clusters);
    double closing = a->closing_seconds * closing_cost(terms) / closing_cost(p->terms);
    double steps = CAUTION * CONDUCTOR_ITERATIONS * fmax(step, a->step_seconds);
    return conductor_seconds(c) + opening_of(a, terms) + steps + closing <= c->options->seconds;
}

/* Predict what comes after the iterations by doing a little of it. The slowest such rehearsal counts. */
static int predict_closing(struct conductor *c, struct nacre_error *error)
{
    struct attempt *a = &c->now;
    const struct problem *p = &a->problem;
    double begun = conductor_seconds(c), share = 1;
    if (!conductor_has_deadline(c)) {
        return NACRE_OK;
    }
    int status = closing_rehearse(c->options, a, &share, error);
    double whole = (conductor_seconds(c) - begun) / share;
    if (status == NACRE_OK) {
        begun = conductor_seconds(c);
        status = closing_rehearse_rounding(a, error);
        whole += conductor_seconds(c) - begun;
    }
    c->closing_pace = fmax(c->closing_pace, whole / closing_cost(p->terms));
    a->closing_seconds = CLOSING_CAUTION * c->closing_pace * closing_cost(p->terms) +
                         closing_write_seconds(search_bytes(&c->search, p->terms, p->clusters));
    tell(&c->options->listener, "closing",
         "%.2g s at most to measure the error of all points and to write, by a few rows of points",
         a->closing_seconds);
    return status;
}

/* Start from the best so far. */
static int warm_up(struct conductor *c, struct nacre_error *error)
{
    struct attempt *a = &c->now;
    uint64_t seed = random_bits((uint64_t)c->options->seed, STREAM_GROWTH);
    const struct factors *from = c->best.ids ? &c->best.factors : c->options->start;
    if (!from) {
        return NACRE_OK;
    }
    int status = factors_fit(from, seed, &a->factors, error);
    if (status == NACRE_OK) {
        status = factors_write(&a->factors, a->method, error);
    }
    return status == NACRE_OK && c->best.ids ? attempt_inherit(a, &c->best, error) : status;
}

static int open_attempt(struct conductor *c, int terms, int clusters, struct nacre_error *error)
{
    struct attempt *a = &c->now;
    double begun = conductor_seconds(c);
    bool first = c->search.count == 0;
    int status = attempt_begin(a, c->responses, c->prepared, conductor_data(c), c->options, terms,
                               clusters, error);
    c->now_is_open = true;
    if (status == NACRE_OK) {
        status = conductor_make_method(c, error);
    }
    if (status == NACRE_OK) {
        a->goal = c->options->error;
        status = warm_up(c, error);
    }
    c->shared_seconds += a->shared_seconds;
    a->opening_seconds = conductor_seconds(c) - begun;
    c->seconds_clustering += a->opening_seconds;
    if (status == NACRE_OK) {
        if (first && tell_is_heard(&c->options->listener)) {
            a->method->ops->explain(a->method, &c->options->listener);
        }
        status = predict_closing(c, error);
    }
    a->seconds = -begun;
    if (first) {
        c->iterating_since = conductor_seconds(c);
    }
    return status;
}

static void close_attempt(struct conductor *c)
{
    attempt_finish(&c->now);
    c->now_is_open = false;
}

static const char *ending_word(enum ending ending)
{
    static const char *const words[] = {"",       "iterations", "tolerance", "error",  "hopeless",
                                        "growth", "time",       "request",   "watcher"};
    return words[ending];
}

void conductor_note(const struct conductor *c, enum ending ending, struct search *search)
{
    const struct attempt *a = &c->now;
    const struct problem *p = &a->problem;
    struct search_try try = {.terms = p->terms,
                             .clusters = p->clusters,
                             .iterations = attempt_iterations(a),
                             .error = a->verified ? a->error_stored : a->error,
                             .bytes = search_bytes(&c->search, p->terms, p->clusters),
                             .seconds = a->seconds + conductor_seconds(c),
                             .verified = a->verified > 0,
                             .held = a->held};
    (void)snprintf(try.ended, sizeof try.ended, "%s", ending_word(ending));
    *search = c->search;
    search_note(search, &try);
}

/* Whether `now` is to be kept rather than `best`. */
static bool is_better(const struct conductor *c)
{
    const struct attempt *a = &c->now, *b = &c->best;
    if (!b->ids || !is_searching(c)) {
        return true;
    }
    if (a->held != b->held) {
        return a->held;
    }
    if (a->held) {
        return search_bytes(&c->search, a->problem.terms, a->problem.clusters) <
               search_bytes(&c->search, b->problem.terms, b->problem.clusters);
    }
    return a->error < b->error;
}

int conductor_make_material(const struct conductor *c, const struct attempt *a,
                            struct nacre_material *material, struct error_report *report,
                            struct nacre_error *error)
{
    struct factor_options options = *c->options;
    struct closing_rounding found;
    int status = NACRE_OK;
    if (options.bits == FACTOR_BITS_AUTO && conductor_has_deadline(c)) {
        options.bits = FACTOR_BITS_LEAST; /* what finer ones would bring takes time to find out */
    }
    if (a->problem.data && options.bits == FACTOR_BITS_AUTO) {
        status = closing_choose_bits(&c->probe, a, &options.bits, &found, error);
        if (status == NACRE_OK) {
            tell(&options.listener, "bits",
                 "%d (0: half floats): the error of a few points is %.3g %% as fitted, %.3g %% "
                 "with %d "
                 "bits and %.3g %% as stored",
                 options.bits, 100 * found.fitted, 100 * found.coarsest, FACTOR_BITS_LEAST,
                 100 * found.rounded);
        }
    }
    return status == NACRE_OK ? closing_make(&options, c->pitch_mm, a, material, report, error)
                              : status;
}

/* Make `now` a material, to see whether its error as stored is what was asked for. */
static int verify(struct conductor *c, struct nacre_error *error)
{
    struct attempt *a = &c->now;
    struct nacre_material material = {0};
    struct error_report report = {0};
    double begun = conductor_seconds(c);
    int status = conductor_make_material(c, a, &material, &report, error);
    c->seconds_measuring += conductor_seconds(c) - begun;
    if (status != NACRE_OK) {
        return status;
    }
    a->verified++;
    a->error_stored = report.whole.mean;
    a->held = report.whole.mean <= c->options->error;
    if (a->held && is_better(c)) {
        nacre_material_finish(&c->made);
        error_report_finish(&c->made_report);
        c->made = material;
        c->made_report = report;
        return NACRE_OK;
    }
    /* The few points or the exact factors looked better than the material: ask for more of them. */
    a->goal = a->error * fmin(c->options->error / report.whole.mean, 1) * 0.998;
    nacre_material_finish(&material);
    error_report_finish(&report);
    return NACRE_OK;
}

/* Complete what is known of `now` after its last iteration. */
static int take_stock(struct conductor *c, struct nacre_error *error)
{
    struct attempt *a = &c->now;
    int last = a->history.count - 1;
    int status = attempt_advance(a, false, &a->objective, error);
    if (status == NACRE_OK && a->known < a->history.count) {
        a->history.objective[last] = (float)a->objective;
        a->history.seconds[last] =
            (float)(c->iterated_before + conductor_seconds(c) - c->iterating_since);
        a->known = a->history.count;
    }
    if (status == NACRE_OK && a->probed_at != a->history.count) {
        status = conductor_probe(c, error);
    }
    return status;
}

static void tell_try(const struct conductor *c)
{
    const struct search_try *try = &c->search.tries[c->search.count - 1];
    tell(&c->options->listener, "tried",
         "%s, %d iterations: mean error %.3g %%%s, %.3g MiB, %.2g s; ended by %s",
         conductor_size(c, try->terms, try->clusters).text, try->iterations, 100 * try->error,
         try->verified ? " as stored" : "", try->bytes * 0x1p-20, try->seconds, try->ended);
}

/* End the attempt: note it, keep it if it is the best. */
static void conclude(struct conductor *c, enum ending ending)
{
    struct attempt *a = &c->now;
    struct search search;
    conductor_note(c, ending, &search);
    c->search = search;
    a->seconds = search.tries[search.count - 1].seconds;
    c->ending = ending;
    tell_try(c);
    if (is_better(c)) {
        method_free(a->method);
        a->method = NULL;
        attempt_finish(&c->best);
        c->best = *a;
        *a = (struct attempt){0};
    }
    close_attempt(c);
}

/* Not even one iteration: there was no time for it. */
static int refuse_time(const struct conductor *c, struct nacre_error *error)
{
    const struct problem *p = &c->now.problem;
    double spent = conductor_seconds(c), closing = c->now.closing_seconds;
    return nacre_fail(
        error,
        "%.3g s are too few: reading, clusters and kernels took %.3g s, and measuring "
        "and writing a material of %s takes about %.2g s; ask for %.2g s or more",
        c->options->seconds, spent, conductor_size(c, p->terms, p->clusters).text, closing,
        1.5 * (spent + closing));
}

/* Whether the material may hold the error although the few points do not: they are a tenth off at times. */
static bool is_worth_verifying(const struct conductor *c, enum ending ending)
{
    return ending == ENDING_ERROR ||
           (conductor_wants_error(c) && c->now.verified == 0 && ending != ENDING_TIME &&
            ending != ENDING_REQUEST && c->now.error <= 1.1 * c->options->error);
}

/* Iterate the open attempt to its end. */
static int run_attempt(struct conductor *c, struct nacre_error *error)
{
    struct attempt *a = &c->now;
    enum ending ending = ENDING_NONE;
    int stopped = NACRE_OK, status = NACRE_OK;
    do {
        stopped = conductor_iterate(c, &ending, error);
        if (stopped == NACRE_CANCELLED && c->options->checkpoint) {
            status = conductor_save(c, error);
        }
        if (status != NACRE_OK || stopped == NACRE_FAILED) {
            return NACRE_FAILED;
        }
        if (attempt_iterations(a) == 0) {
            c->ending = ending;
            status = ending == ENDING_TIME && !c->best.ids ? refuse_time(c, error) : NACRE_OK;
            close_attempt(c);
            return status == NACRE_OK ? stopped : status;
        }
        status = take_stock(c, error);
        if (status == NACRE_OK && is_worth_verifying(c, ending)) {
            status = verify(c, error);
        }
    } while (status == NACRE_OK && ending == ENDING_ERROR && !a->held);
    if (status != NACRE_OK) {
        return status;
    }
    conclude(c, a->held ? ENDING_ERROR : ending);
    return stopped;
}

/* What the user wants to start from: one factorization after the other, each from the one before. */
static int run_stages(struct conductor *c, struct nacre_error *error)
{
    const struct factor_options *o = c->options;
    int status = NACRE_OK;
    for (int i = 0; i < o->stage_count && status == NACRE_OK; i++) {
        c->stage = &o->stages[i];
        status = progress_step(c->progress, 0, 1, "clustering", error);
        if (status == NACRE_OK) {
            status = open_attempt(c, c->stage->terms, c->stage->clusters, error);
        }
        if (status == NACRE_OK) {
            status = run_attempt(c, error);
        }
        c->search.count = 0; /* a stage is not what was asked for */
    }
    c->stage = NULL;
    return status;
}

int conductor_run(struct conductor *c, struct nacre_error *error)
{
    int terms = 0, clusters = 0;
    c->iterating_since = c->checkpoint_at = c->probed_at = conductor_seconds(c);
    int status = run_stages(c, error);
    while (status == NACRE_OK && c->ending != ENDING_TIME) {
        if (!c->now_is_open) {
            if (!search_next(&c->search, &terms, &clusters)) {
                break;
            }
            /* Growth looked at the time already. */
            if (c->search.count > 0 && c->ending != ENDING_GROWTH &&
                !conductor_has_time_for(c, terms, clusters)) {
                c->ending = ENDING_TIME;
                break;
            }
            status = progress_step(c->progress, 0, 1, "clustering", error);
            if (status == NACRE_CANCELLED && c->options->checkpoint &&
                conductor_save(c, error) != NACRE_OK) {
                status = NACRE_FAILED;
            }
            if (status == NACRE_OK) {
                status = open_attempt(c, terms, clusters, error);
            }
        }
        if (status == NACRE_OK) {
            status = run_attempt(c, error);
        }
    }
    return status;
}

void conductor_finish(struct conductor *c)
{
    attempt_finish(&c->now);
    attempt_finish(&c->best);
    factor_prepared_finish(&c->own);
    probe_finish(&c->probe);
    nacre_material_finish(&c->made);
    error_report_finish(&c->made_report);
    free(c->identity);
    *c = (struct conductor){0};
}
