/* Hard cases run with a kernel per term. */
#include "terms_run.h"

#include "bench.h"
#include "double_terms.h"
#include "run.h"

#include "factor/attempt.h"
#include "factor/layout.h"
#include "factor/terms.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

/* A case on its way. */
struct stage {
    struct responses responses;
    struct terms_data data;
    struct attempt attempt;
    struct method *method;
    size_t plane, count; /* floats of a plane and of all */
    float *f, *h, *numbers[RESPONSES_CHANNELS];
};

static void open_stage(struct stage *s, const struct hard_case *hard, const struct opencl *opencl,
                       enum hard_start start, int terms)
{
    struct factor_options options = factor_options_default();
    const struct terms_options how = {.reciprocity =
                                          start >= HARD_RECIPROCAL ? TERMS_RECIPROCAL : TERMS_AUTO};
    struct factor_prepared prepared = {0};
    struct nacre_error error = {0};
    struct sample sample = hard_sample(hard);
    *s = (struct stage){.responses = sample_load(&sample, layout_lanes(opencl))};
    sample_finish(&sample);
    options.epsilon = hard_epsilon(hard);
    bench_succeed(terms_data_begin(&s->data, &s->responses, &how, options.epsilon, &error), &error);
    s->data.reach = start == HARD_WHOLE ? hard->window / 2 : s->data.reach;
    bench_succeed(features_new(&s->responses, &prepared.features, &error), &error);
    bench_succeed(
        attempt_begin(&s->attempt, &s->responses, &prepared, &s->data, &options, terms, 1, &error),
        &error);
    factor_prepared_finish(&prepared);
    bench_succeed(terms_new(opencl, &s->attempt.problem, &s->method, &error), &error);
    s->plane = (size_t)hard->width * (size_t)hard->height;
    s->count = s->plane * (size_t)terms;
    s->f = calloc(s->count + 1, sizeof *s->f);
    s->h = calloc(s->count + 1, sizeof *s->h);
    for (int c = 0; c < hard->channels; c++) {
        s->numbers[c] =
            calloc((size_t)s->data.grid.count * (size_t)terms + 1, sizeof *s->numbers[c]);
        TEST_ASSERT_NOT_NULL(s->numbers[c]);
    }
    TEST_ASSERT_TRUE(s->f && s->h);
}

static void close_stage(struct stage *s)
{
    method_free(s->method);
    attempt_finish(&s->attempt);
    terms_data_finish(&s->data);
    responses_finish(&s->responses);
    for (int c = 0; c < RESPONSES_CHANNELS; c++) {
        free(s->numbers[c]);
    }
    free(s->f);
    free(s->h);
}

static void read_all(struct stage *s)
{
    struct nacre_error error = {0};
    const struct method_ops *ops = s->method->ops;
    bench_succeed(ops->read(s->method, 0, s->f, s->h, &error), &error);
    for (int c = 0; c < s->responses.channels; c++) {
        bench_succeed(ops->read_kernels(s->method, c, s->numbers[c], &error), &error);
    }
}

static void start_as(struct stage *s, enum hard_start start)
{
    struct nacre_error error = {0};
    float *planes[] = {s->f, s->h};
    if (start != HARD_DEAD && start != HARD_IDENTICAL) {
        return;
    }
    read_all(s);
    for (int side = 0; side < s->data.copy_count; side++) {
        float *last = planes[side] + s->count - s->plane;
        memset(last, 0, s->plane * sizeof *last);
        if (start == HARD_IDENTICAL) {
            memcpy(last, planes[side], s->plane * sizeof *last);
        }
    }
    bench_succeed(s->method->ops->write(s->method, 0, s->f, s->h, &error), &error);
}

static bool all(const float *values, size_t count, bool *positive)
{
    bool finite = true;
    for (size_t i = 0; i < count; i++) {
        finite = finite && isfinite(values[i]);
        *positive = *positive && values[i] >= 0;
    }
    return finite;
}

/* The device's sums are of squares of residuals in single precision: bounds as for clusters, docs/stability.md. */
static void watch(struct stage *s, struct hard_terms_figures *figures, double *before)
{
    struct nacre_error error = {0};
    int terms = s->attempt.problem.terms;
    bool two = s->data.copy_count > 1;
    double told = 0;
    bench_succeed(s->method->ops->measure(s->method, 0, &told, &error), &error);
    told = ldexp(told, s->responses.exponent[0]);
    read_all(s);
    struct double_terms model = {&s->data, terms, s->f, two ? s->h : NULL, {NULL}};
    size_t numbers = (size_t)s->data.grid.count * (size_t)terms;
    bool finite = all(s->f, s->count, &figures->positive) &&
                  (!two || all(s->h, s->count, &figures->positive));
    for (int c = 0; c < s->responses.channels; c++) {
        model.numbers[c] = s->numbers[c];
        finite = all(s->numbers[c], numbers, &figures->positive) && finite;
    }
    struct double_objective now = double_terms_objective(&model);
    double noise = hard_noise() * now.energy;
    figures->finite = figures->finite && finite && isfinite(told) && isfinite(now.objective);
    if (now.objective > *before + noise) {
        figures->rise = fmax(figures->rise, (now.objective - *before - noise) / *before);
    }
    if (told != now.objective) {
        double allowed = 1e-5 * now.objective + 100 * noise;
        figures->device = fmax(figures->device, fabs(told - now.objective) / allowed);
    }
    figures->slope = now.slope;
    figures->energy = now.energy;
    figures->objective = *before = now.objective;
}

struct hard_terms_figures hard_terms_run(const struct hard_case *hard, const struct opencl *opencl,
                                         enum hard_start start, int terms, int steps)
{
    struct hard_terms_figures figures = {.finite = true, .positive = true};
    struct nacre_error error = {0};
    struct stage s;
    double before = INFINITY;
    open_stage(&s, hard, opencl, start, terms > 0 ? terms : hard->terms);
    TEST_ASSERT_NOT_NULL(s.method);
    figures.reach = s.data.reach;
    start_as(&s, start);
    for (int i = 0; i < (steps > 0 ? steps : 40); i++) {
        double objective = 0;
        bench_succeed(s.method->ops->step(s.method, 0, &objective, &error), &error);
        watch(&s, &figures, &before);
    }
    close_stage(&s);
    return figures;
}

void hard_terms_material(const struct hard_case *hard, int bits, const struct opencl *opencl,
                         struct nacre_material *material, struct factor_summary *summary)
{
    struct factor_options options = factor_options_default();
    struct nacre_error error = {0};
    struct sample sample = hard_sample(hard);
    struct responses responses = sample_load(&sample, layout_lanes(opencl));
    options.model = FACTOR_MODEL_TERMS;
    options.terms = hard->terms;
    options.clusters = 0;
    options.iterations = 40;
    options.tolerance = 0;
    options.bits = bits;
    bench_succeed(
        factorize_responses(&responses, 1, &options, opencl, NULL, material, summary, &error),
        &error);
    responses_finish(&responses);
    sample_finish(&sample);
    hard_pass_through_file(material);
}
