/* Hard cases run by the methods. */
#include "run.h"

#include "bench.h"
#include "double_run.h"

#include "factor/attempt.h"
#include "factor/hals.h"
#include "factor/layout.h"
#include "factor/update.h"
#include "factor/weight.h"
#include "tests/files.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

/* A case on its way: responses, clusters and kernels, method. */
struct stage {
    struct responses responses;
    struct attempt attempt;
    struct bench bench; /* a view of the above */
};

/* Responses are at most 1 here: objectives below this are squares of what is nothing beside it. */
#define UNSEEN 1e-24

double hard_noise(void)
{
    /* An entry's residual is off by some 2^-24 of it, at most 1e-6 after T products; the squares of those are 1e-12 of
     * the energy, and what they do to a residual of the same size is of that order too. */
    return 1e-12;
}

static void open_stage(struct stage *s, const struct sample *sample, const struct hard_case *hard,
                       const struct opencl *opencl, bool half)
{
    struct factor_options options = factor_options_default();
    struct factor_prepared prepared = {0};
    struct nacre_error error = {0};
    int lanes = layout_lanes(opencl);
    options.epsilon = hard_epsilon(hard);
    s->responses = half ? sample_load_half(sample, lanes) : sample_load(sample, lanes);
    bench_succeed(features_new(&s->responses, &prepared.features, &error), &error);
    bench_succeed(attempt_begin(&s->attempt, &s->responses, &prepared, NULL, &options, hard->terms,
                                hard->clusters, &error),
                  &error);
    factor_prepared_finish(&prepared);
    size_t count = (size_t)hard->terms * (size_t)hard->width * (size_t)hard->height;
    s->bench = (struct bench){.responses = s->responses,
                              .problem = s->attempt.problem,
                              .ids = s->attempt.ids,
                              .kernels = s->attempt.kernels,
                              .count = count,
                              .f = malloc(count * sizeof(float)),
                              .h = malloc(count * sizeof(float))};
}

struct maker {
    const struct opencl *opencl;
    enum factor_method method;
};

static int make(void *data, const struct problem *problem, struct method **method,
                struct nacre_error *error)
{
    const struct maker *maker = data;
    return maker->method == FACTOR_METHOD_MU
               ? update_new(maker->opencl, problem, NULL, method, error)
               : hals_new(maker->opencl, problem, NULL, method, error);
}

static void make_method(struct stage *s, const struct opencl *opencl, struct hard_how how)
{
    struct nacre_error error = {0};
    struct maker maker = {opencl, how.method};
    struct method **made = &s->bench.method;
    bench_succeed(how.weight == FACTOR_WEIGHT_RESPONSE
                      ? weight_new(&s->attempt.problem, make, &maker, made, &error)
                      : make(&maker, &s->attempt.problem, made, &error),
                  &error);
}

/* The problem of the weight 1 / ||R_i|| put as one of the weight 1 / sqrt(g), as factor/weight.h has it, in double. */
static void weigh(struct reference *r)
{
    size_t area = (size_t)r->window * (size_t)r->window;
    size_t points = (size_t)r->width * (size_t)r->height;
    for (size_t i = 0; i < points; i++) {
        double *response = r->responses + i * area;
        const double *kernel = r->kernels + (size_t)r->ids[i] * area;
        double squares = 0;
        for (size_t j = 0; j < area; j++) {
            squares += isnan(response[j]) ? 0 : response[j] * response[j];
        }
        double share = squares > 0 ? 1 / sqrt(squares) : 0;
        for (size_t j = 0; j < area; j++) {
            response[j] *= share * kernel[j];
        }
        for (size_t t = 0; t < (size_t)r->terms; t++) {
            r->f[t * points + i] *= share;
        }
    }
}

static void square(double *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        values[i] *= values[i];
    }
}

/* The problem with the factors read last. */
static struct reference reference_of(const struct bench *b, int channel, struct hard_how how)
{
    struct reference reference = bench_reference(b, channel);
    if (how.weight == FACTOR_WEIGHT_RESPONSE) {
        weigh(&reference);
        square(reference.kernels,
               (size_t)b->problem.clusters * (size_t)reference.window * (size_t)reference.window);
    }
    return reference;
}

static void close_stage(struct stage *s)
{
    method_free(s->bench.method);
    free(s->bench.f);
    free(s->bench.h);
    attempt_finish(&s->attempt);
    responses_finish(&s->responses);
}

/* A run of so many steps asks for its objective every so often. */
static int every(int steps)
{
    return steps > 100 ? steps / 100 : 1;
}

static void watch(struct hard_figures *figures, const struct bench *b, int channel,
                  struct hard_how how, double *before, double energy)
{
    struct nacre_error error = {0};
    struct bench copy = *b;
    double told = 0;
    bench_read(&copy, channel);
    for (size_t i = 0; i < b->count; i++) {
        figures->finite = figures->finite && isfinite(b->f[i]) && isfinite(b->h[i]);
        figures->positive = figures->positive && b->f[i] >= 0 && b->h[i] >= 0;
    }
    bench_succeed(b->method->ops->measure(b->method, channel, &told, &error), &error);
    if (how.weight == FACTOR_WEIGHT_RESPONSE) {
        told = ldexp(told, b->responses.exponent[channel]); /* relative errors have no unit */
    }
    struct reference now = reference_of(b, channel, how);
    double objective = reference_objective(&now), noise = hard_noise() * energy;
    figures->finite = figures->finite && isfinite(told) && isfinite(objective);
    if (objective > *before + noise) {
        figures->rise = fmax(figures->rise, (objective - *before - noise) / *before);
    }
    if (told != objective) {
        double allowed = 1e-5 * objective + 100 * noise + UNSEEN;
        figures->device = fmax(figures->device, fabs(told - objective) / allowed);
    }
    *before = objective;
    bench_reference_finish(&now);
}

static double energy_of(struct reference reference, size_t count)
{
    double *zeros = calloc(count, sizeof *zeros);
    reference.f = reference.h = zeros;
    double energy = reference_objective(&reference);
    free(zeros);
    return energy;
}

static void run_channel(struct stage *s, const struct hard_case *hard, struct hard_how how,
                        int channel, struct hard_figures *figures)
{
    struct nacre_error error = {0};
    int steps = hard_steps(hard);
    bench_read(&s->bench, channel);
    struct reference exact = reference_of(&s->bench, channel, how);
    double energy = energy_of(exact, s->bench.count);
    double before = reference_objective(&exact);
    for (int i = 0; i < steps; i++) {
        double objective = 0;
        bench_succeed(s->bench.method->ops->step(s->bench.method, channel, &objective, &error),
                      &error);
        if (i % every(steps) == every(steps) - 1) {
            watch(figures, &s->bench, channel, how, &before, energy);
        }
    }
    if (how.method == FACTOR_METHOD_MU) {
        double_run_mu(&exact, steps);
    } else {
        figures->refusals += double_run_hals(&exact, steps);
    }
    figures->energy += energy;
    figures->objective += before;
    figures->reference += reference_objective(&exact);
    bench_reference_finish(&exact);
}

struct hard_figures hard_run(const struct hard_case *hard, const struct opencl *opencl,
                             struct hard_how how)
{
    struct hard_figures figures = {.finite = true, .positive = true};
    struct sample sample = hard_sample(hard);
    struct stage stage = {0};
    open_stage(&stage, &sample, hard, opencl, how.half);
    make_method(&stage, opencl, how);
    for (int c = 0; c < hard->channels; c++) {
        run_channel(&stage, hard, how, c, &figures);
    }
    close_stage(&stage);
    sample_finish(&sample);
    return figures;
}

/* Values that would be seen if anything read them, where an entry inside the sample was not measured. */
static size_t dirty_masked(struct responses *r)
{
    static const float garbage[] = {NAN, INFINITY, -INFINITY, 1e30F, -7, 1e-42F};
    size_t changed = 0;
    int half = r->window / 2, area = r->window * r->window;
    for (int i = 0; i < r->width * r->height * area; i++) {
        int x = i / area % r->width, y = i / area / r->width;
        int u = i % r->window, v = i / r->window % r->window;
        int xo = x + u - half, yo = y + v - half;
        size_t index = responses_index(r, x, y, u, v);
        if (xo >= 0 && xo < r->width && yo >= 0 && yo < r->height &&
            !responses_is_measured(r, 0, index)) {
            r->values[0][index] = garbage[changed++ % 6];
        }
    }
    return changed;
}

float *hard_factors(const struct sample *sample, const struct hard_case *hard,
                    const struct opencl *opencl, struct hard_how how, bool dirty, size_t *count,
                    size_t *changed)
{
    struct nacre_error error = {0};
    struct stage stage = {0};
    open_stage(&stage, sample, hard, opencl, false);
    *changed = dirty ? dirty_masked(&stage.responses) : 0;
    make_method(&stage, opencl, how);
    for (int i = 0; i < hard_steps(hard); i++) {
        double objective = 0;
        bench_succeed(stage.bench.method->ops->step(stage.bench.method, 0, &objective, &error),
                      &error);
    }
    float *factors = bench_factors(&stage.bench);
    *count = 2 * stage.bench.count;
    close_stage(&stage);
    return factors;
}

void hard_pass_through_file(struct nacre_material *material)
{
    struct nacre_error error = {0};
    char *folder = folder_make(), *path = path_join(folder, "material.exr");
    int status = nacre_material_write(path, material, &error);
    nacre_material_finish(material);
    if (status == NACRE_OK) {
        status = nacre_material_read(path, material, &error);
    }
    free(path);
    folder_remove(folder);
    bench_succeed(status, &error);
}

void hard_material(const struct sample *sample, const struct hard_case *hard,
                   const struct opencl *opencl, struct hard_how how, enum factor_store store,
                   struct nacre_material *material, struct factor_summary *summary)
{
    struct factor_options options = factor_options_default();
    struct responses responses = how.half ? sample_load_half(sample, layout_lanes(opencl))
                                          : sample_load(sample, layout_lanes(opencl));
    struct nacre_error error = {0};
    options.method = how.method;
    options.weight = how.weight;
    options.terms = hard->terms;
    options.clusters = hard->clusters;
    options.iterations = hard_steps(hard);
    options.tolerance = 0;
    options.store = store;
    options.epsilon = hard_epsilon(hard);
    int status =
        factorize_responses(&responses, 1, &options, opencl, NULL, material, summary, &error);
    responses_finish(&responses);
    bench_succeed(status, &error);
    hard_pass_through_file(material);
}
