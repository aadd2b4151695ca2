/* Iterating one attempt: stepping, watching, and the criteria that end it. */
#include "factor/conductor.h"
#include "factor/terms_noise.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum {
    PATIENCE = 5, /* iterations that are looked at together */
    PROSPECT =
        10, /* times as many: how far the error's fall is carried on, to see what is hopeless */
    SETTLING = 6,        /* iterations before larger settings are thought of */
    CHOSEN_LIMIT = 200,  /* iterations where nothing else was said */
    SHAPED_LIMIT = 1000, /* with a kernel per term: progress ends it long before */
    ERROR_LIMIT = 1000,  /* iterations where an error is to be held */
    VERIFICATIONS = 5,
};

/* With a kernel per term what is left falls as 1 / iterations at worst: then as many again would bring no more than the
 * later half did, in which the objective must have fallen by less than so many times the tolerance. */
#define VALLEY 15

/* Growing pays when an iteration lowers the objective by less than this share. */
#define SLOW 0.03

/* Probes take at most a fiftieth of the time, and come once a second at most. */
#define PROBE_PAUSE    50
#define PROBE_INTERVAL 1.0

static bool is_free(const struct conductor *c)
{
    return c->search.terms == 0 || c->search.clusters == 0;
}

/* No error is asked for: all of the time is there to lower it. */
static bool fills_time(const struct conductor *c)
{
    return conductor_has_deadline(c) && !conductor_wants_error(c) && is_free(c);
}

static int iteration_limit(const struct conductor *c)
{
    return c->stage                                  ? c->stage->iterations
           : c->options->iterations                  ? c->options->iterations
           : conductor_has_deadline(c)               ? INT_MAX
           : conductor_wants_error(c)                ? ERROR_LIMIT
           : c->options->model == FACTOR_MODEL_TERMS ? SHAPED_LIMIT
                                                     : CHOSEN_LIMIT;
}

/* Whether the last PATIENCE iterations, on average, lowered the objective by no more than `share` each. */
static bool has_settled(const struct attempt *a, double share)
{
    int last = a->known - 1, first = last - PATIENCE;
    return first >= a->inherited &&
           (double)a->history.objective[last] >=
               (1 - PATIENCE * share) * (double)a->history.objective[first];
}

/* The share by which the later half of the iterations lowered the objective. */
static double later_half(const struct attempt *a)
{
    int last = a->known - 1, middle = a->inherited + (last - a->inherited) / 2;
    double before = (double)a->history.objective[middle];
    return before > 0 ? 1 - (double)a->history.objective[last] / before : 0;
}

/* Whether that is no more than `share`. */
static bool is_out_of_valleys(const struct attempt *a, double share)
{
    return later_half(a) <= share;
}

/* Whether what is still to be gained is no more than fitting noise would gain, taking it that what doubling the iterations
 * brings goes on falling by the ratio of the last two doublings. */
static bool is_left_to_noise(const struct attempt *a)
{
    int last = a->known - 1, count = last - a->inherited;
    const float *objective = a->history.objective + a->inherited;
    if (count < 4) {
        return false;
    }
    double before = (double)objective[count / 4] - (double)objective[count / 2];
    double later = (double)objective[count / 2] - (double)objective[count];
    return later < before && later * later / (before - later) <= a->noise;
}

static bool has_next(const struct conductor *c, enum ending ending, int *terms, int *clusters)
{
    struct search search;
    conductor_note(c, ending, &search);
    return search_next(&search, terms, clusters);
}

/* Whether the error would not fall to the goal even if it fell on as fast as now for long. */
static bool is_hopeless(const struct conductor *c)
{
    const struct attempt *a = &c->now;
    int last = a->history.count - 1, terms = 0, clusters = 0;
    if (attempt_iterations(a) < 2 * PATIENCE || !is_free(c)) {
        return false;
    }
    double fall = (double)(a->history.error[last - PATIENCE] - a->history.error[last]);
    return !(a->error - PROSPECT * fall <= a->goal) &&
           has_next(c, ENDING_HOPELESS, &terms, &clusters);
}

static bool should_grow(const struct conductor *c)
{
    int terms = 0, clusters = 0;
    return attempt_iterations(&c->now) >= SETTLING &&
           has_settled(&c->now, fmax(SLOW, c->options->tolerance)) &&
           has_next(c, ENDING_GROWTH, &terms, &clusters) &&
           conductor_has_time_for(c, terms, clusters);
}

/* An update may still be on its way when the time is read: half an iteration more. The first iteration may compile, so
 * what follows takes a fraction of its time. With a kernel per term one may hold twice as many steps as the last. */
static bool time_is_up(const struct conductor *c)
{
    const struct attempt *a = &c->now;
    double longest = c->options->model == FACTOR_MODEL_TERMS ? 2.5 : 1.5;
    double next = a->step_seconds * (attempt_iterations(a) == 1 ? 0.3 : longest);
    return conductor_has_deadline(c) &&
           conductor_seconds(c) + next + a->closing_seconds > c->options->seconds;
}

/* Slow valleys are waited for. */
static bool is_patient(const struct conductor *c)
{
    return c->options->model == FACTOR_MODEL_TERMS && !conductor_wants_error(c);
}

/* Whether the end hangs on what fitting noise would gain, which takes time to work out. */
static bool noise_decides(const struct conductor *c)
{
    const struct attempt *a = &c->now;
    return is_patient(c) && has_settled(a, c->options->tolerance) &&
           !is_out_of_valleys(a, VALLEY * c->options->tolerance);
}

static enum ending find_ending(const struct conductor *c)
{
    const struct attempt *a = &c->now;
    int done = attempt_iterations(a);
    /* While time is left and nothing else can be done with it, small gains count. */
    double tolerance = c->options->tolerance * (fills_time(c) ? 0.1 : 1);
    if (conductor_wants_error(c) && done > 0 && a->probed_at == a->history.count &&
        a->error <= a->goal && a->verified < VERIFICATIONS) {
        return ENDING_ERROR;
    }
    if (done >= iteration_limit(c)) {
        return ENDING_ITERATIONS;
    }
    if (c->stage) {
        return ENDING_NONE;
    }
    if (time_is_up(c)) {
        return ENDING_TIME;
    }
    if (has_settled(a, tolerance) &&
        (!is_patient(c) || is_out_of_valleys(a, VALLEY * tolerance) || is_left_to_noise(a))) {
        return ENDING_TOLERANCE;
    }
    if (conductor_wants_error(c)) {
        return is_hopeless(c) ? ENDING_HOPELESS : ENDING_NONE;
    }
    return fills_time(c) && should_grow(c) ? ENDING_GROWTH : ENDING_NONE;
}

/* How many iterations until the tolerance ends this, taking it that what one brings falls as 1 / iterations, and, with a kernel
 * per term, what the later half of all brings. */
static double iterations_to_tolerance(const struct conductor *c)
{
    const struct attempt *a = &c->now;
    int last = a->known - 1, first = last - PATIENCE;
    if (c->options->tolerance <= 0 || first < a->inherited) {
        return INFINITY;
    }
    double gain = 1 - (double)(a->history.objective[last] / a->history.objective[first]);
    double share = gain / PATIENCE / c->options->tolerance;
    share = is_patient(c) ? fmax(share, later_half(a) / (VALLEY * c->options->tolerance)) : share;
    return share > 1 ? attempt_iterations(a) * (share - 1) : 1;
}

static double seconds_left(const struct conductor *c)
{
    const struct attempt *a = &c->now;
    double left = c->options->seconds - conductor_seconds(c);
    if (fills_time(c)) {
        return left;
    }
    double iterations =
        fmin(iteration_limit(c) - attempt_iterations(a), iterations_to_tolerance(c));
    double others = iterations * a->step_seconds + a->closing_seconds;
    return conductor_has_deadline(c) ? fmin(left, others) : others;
}

/* Show how things stand, the most telling first as terminals are narrow, and notice Ctrl-C. */
static int show(struct conductor *c, struct nacre_error *error)
{
    const struct attempt *a = &c->now;
    char mean[32] = "", objective[48] = "", detail[128];
    double elapsed = conductor_seconds(c);
    if (a->probed_at >= 0) {
        (void)snprintf(mean, sizeof mean, "error %.2f %%, ", 100 * a->error);
    }
    if (a->known > a->inherited) {
        (void)snprintf(objective, sizeof objective, "objective %.4g, ", a->objective);
    }
    (void)snprintf(detail, sizeof detail, "%s%s%s", mean, objective,
                   conductor_size(c, a->problem.terms, a->problem.clusters).text);
    return progress_step(c->progress, elapsed, elapsed + seconds_left(c), detail, error);
}

int conductor_probe(struct conductor *c, struct nacre_error *error)
{
    struct attempt *a = &c->now;
    double begun = conductor_seconds(c);
    int status = factors_read(&a->factors, a->method, error);
    if (status == NACRE_OK) {
        a->error = probe_measure(&c->probe, &a->problem, &a->factors);
        a->probed_at = a->history.count;
        if (a->history.count > 0) {
            a->history.error[a->history.count - 1] = (float)a->error;
        }
    }
    c->probed_at = conductor_seconds(c);
    c->probe_seconds = c->probed_at - begun;
    return status;
}

static bool probe_is_due(const struct conductor *c)
{
    double pause = fmax(PROBE_INTERVAL, PROBE_PAUSE * c->probe_seconds);
    return conductor_wants_error(c) || conductor_seconds(c) - c->probed_at >= pause;
}

/* The first iterations compile and search; the third is typical. */
static void tell_pace(const struct conductor *c)
{
    const struct attempt *a = &c->now;
    int limit = iteration_limit(c);
    if (attempt_iterations(a) != 3) {
        return;
    }
    char all[64] = "";
    if (limit < INT_MAX) {
        (void)snprintf(all, sizeof all, "; %d would take %.3g s", limit, limit * a->step_seconds);
    }
    tell(&c->options->listener, "pace", "%.3g s an iteration with %s%s", a->step_seconds,
         conductor_size(c, a->problem.terms, a->problem.clusters).text, all);
    if (c->probe_seconds > 0) {
        tell(&c->options->listener, "pace", "%.2g s to look at the error of %zu points%s",
             c->probe_seconds, c->probe.count,
             conductor_wants_error(c) ? ", after each" : ", once a second at most");
    }
}

static int step(struct conductor *c, struct nacre_error *error)
{
    struct attempt *a = &c->now;
    double begun = conductor_seconds(c), objective = 0;
    int status = attempt_advance(a, true, &objective, error);
    if (status != NACRE_OK) {
        return status;
    }
    if (attempt_iterations(a) > 0) {
        a->objective = objective;
        a->history.objective[a->history.count - 1] = (float)objective;
        a->known = a->history.count;
    }
    status = attempt_extend_history(a, error);
    if (status == NACRE_OK && noise_decides(c)) {
        status = factors_read(&a->factors, a->method, error);
        a->noise = status == NACRE_OK ? terms_noise_gain(c->data, &a->factors) : 0;
    }
    if (status == NACRE_OK) {
        double now = conductor_seconds(c);
        a->step_seconds = now - begun;
        if (attempt_iterations(a) == 1) {
            a->first_seconds = a->step_seconds;
        }
        a->history.seconds[a->history.count - 1] =
            (float)(c->iterated_before + now - c->iterating_since);
        tell_pace(c);
    }
    if (status == NACRE_OK && probe_is_due(c)) {
        status = conductor_probe(c, error);
    }
    return status;
}

static int save_when_due(struct conductor *c, struct nacre_error *error)
{
    if (!c->options->checkpoint ||
        conductor_seconds(c) - c->checkpoint_at < c->options->checkpoint_seconds) {
        return NACRE_OK;
    }
    int status = conductor_save(c, error);
    c->checkpoint_at = conductor_seconds(c);
    return status;
}

/* Let the watcher look at what this iteration has left, if it is for it. */
static int look(struct conductor *c, enum ending *ending, struct nacre_error *error)
{
    const struct factor_watcher *watcher = c->options->watcher;
    struct attempt *a = &c->now;
    struct factor_look look = {
        .attempt = a, .iterations = attempt_iterations(a), .last = *ending != ENDING_NONE};
    double begun = conductor_seconds(c), objective = 0;
    bool stop = false;
    if (!watcher || c->stage || !(look.last || watcher->wants(watcher->data, look.iterations))) {
        return NACRE_OK;
    }
    look.seconds = begun - c->looking_seconds + c->shared_seconds;
    if (look.iterations > 1) {
        look.seconds -= fmax(0, a->first_seconds - 2 * a->step_seconds); /* compiling */
    }
    int status = attempt_advance(a, false, &objective, error);
    if (status == NACRE_OK) {
        status = factors_read(&a->factors, a->method, error);
    }
    if (status == NACRE_OK) {
        status = watcher->look(watcher->data, &look, &stop, error);
    }
    *ending = stop && !look.last ? ENDING_WATCHER : *ending;
    c->looking_seconds += conductor_seconds(c) - begun;
    return status;
}

int conductor_iterate(struct conductor *c, enum ending *ending, struct nacre_error *error)
{
    int status = NACRE_OK;
    *ending = find_ending(c);
    while (*ending == ENDING_NONE && status == NACRE_OK) {
        status = show(c, error);
        if (status == NACRE_OK) {
            status = save_when_due(c, error);
        }
        if (status == NACRE_OK) {
            status = step(c, error);
        }
        if (status == NACRE_OK) {
            *ending = find_ending(c);
            status = look(c, ending, error);
        }
    }
    if (status == NACRE_CANCELLED) {
        *ending = ENDING_REQUEST;
    }
    return status;
}
