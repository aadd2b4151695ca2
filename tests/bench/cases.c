/* The problems of the benchmarks, and what a thousand of the paper's updates reach there. */
#include "cases.h"

#include "timing.h"

#include "factor/factorize.h"
#include "factor/falloff.h"
#include "factor/fill.h"
#include "factor/kmeans.h"
#include "factor/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* factorize()'s streams of random numbers. */
enum { STREAM_CLUSTERS = 1, STREAM_FACTORS = 2 };

/* The last two columns are what `bench_methods --goals` prints. */
const struct bench_case cases[] = {
    {"small", FIELD_CANDLE, 64, 48, 25, 1, 12, 5, 8.6050286, 3.6422663},
    {"candle", FIELD_CANDLE, 212, 154, 49, 1, 12, 1, 0, 0},
    {"candle", FIELD_CANDLE, 212, 154, 49, 1, 12, 5, 191.58168, 90.125423},
    {"candle", FIELD_CANDLE, 212, 154, 49, 1, 12, 100, 0, 0},
    {"marble 4x4", FIELD_MARBLE, 277, 277, 39, 1, 20, 1, 0, 0},
    {"marble 4x4", FIELD_MARBLE, 277, 277, 39, 1, 20, 5, 375.2739, 143.10954},
    {"marble 4x4", FIELD_MARBLE, 277, 277, 39, 1, 20, 100, 0, 0},
    {"candle", FIELD_CANDLE, 212, 154, 49, 3, 12, 100, 0, 0},
    {0},
};

const struct bench_case *case_find(const char *name, int channels, int clusters)
{
    for (const struct bench_case *c = cases; c->name; c++) {
        if (strcmp(c->name, name) == 0 && c->channels == channels && c->clusters == clusters) {
            return c;
        }
    }
    return NULL;
}

static int find_clusters(const struct case_problem *made, int clusters, uint64_t seed,
                         struct nacre_error *error)
{
    const struct responses *r = &made->responses;
    struct features features = {0};
    uint32_t *labels = NULL;
    int status = features_new(r, &features, error);
    if (status != NACRE_OK) {
        return status;
    }
    labels = allocate(features.count * sizeof *labels);
    status = kmeans(features.values, features.count, features.length, clusters,
                    random_bits(seed, STREAM_CLUSTERS), labels, error);
    for (size_t i = 0; i < features.count && status == NACRE_OK; i++) {
        made->ids[features.points[i]] = labels[i];
    }
    if (status == NACRE_OK) {
        status = fill_labels(r->width, r->height, r->measured, made->ids, error);
    }
    free(labels);
    features_finish(&features);
    return status;
}

void case_make(const struct bench_case *c, int lanes, bool half, struct case_problem *made)
{
    const struct factor_options o = factor_options_default();
    struct field field = field_new(c->kind, c->width, c->height, c->window, c->channels, CASE_SEED);
    size_t points = (size_t)c->width * (size_t)c->height;
    size_t area = (size_t)c->window * (size_t)c->window;
    struct nacre_error error = {0};
    *made = (struct case_problem){.responses = field_load(&field, lanes, half),
                                  .ids = allocate(points * sizeof *made->ids),
                                  .kernels = allocate((size_t)c->clusters * (size_t)c->channels *
                                                      area * sizeof *made->kernels)};
    field_finish(&field);
    if (find_clusters(made, c->clusters, (uint64_t)o.seed, &error) != NACRE_OK ||
        kernels_compute(&made->responses, made->ids, c->clusters, o.kernel, o.epsilon,
                        made->kernels, &error) != NACRE_OK) {
        fail(error.text);
    }
    made->problem = (struct problem){.responses = &made->responses,
                                     .ids = made->ids,
                                     .kernels = made->kernels,
                                     .clusters = c->clusters,
                                     .terms = c->terms,
                                     .seed = random_bits((uint64_t)o.seed, STREAM_FACTORS)};
}

void case_finish(struct case_problem *made)
{
    responses_finish(&made->responses);
    free(made->ids);
    free(made->kernels);
    *made = (struct case_problem){0};
}

float *case_windows(const struct case_problem *made)
{
    const struct responses *r = &made->responses;
    size_t points = (size_t)r->width * (size_t)r->height;
    size_t area = (size_t)r->window * (size_t)r->window;
    float *windows = allocate(points * area * sizeof *windows);
#pragma omp parallel for
    for (size_t i = 0; i < points; i++) {
        float *window = windows + i * area;
        responses_get(r, 0, (int)(i % (size_t)r->width), (int)(i / (size_t)r->width), window);
        for (size_t entry = 0; entry < area; entry++) {
            window[entry] = isnan(window[entry]) ? 0 : window[entry];
        }
    }
    return windows;
}

double case_objective(const struct case_problem *made, struct method *method)
{
    double sum = 0;
    for (int c = 0; c < made->responses.channels; c++) {
        struct nacre_error error = {0};
        double part = 0;
        if (method->ops->measure(method, c, &part, &error) != NACRE_OK) {
            fail(error.text);
        }
        sum += ldexp(part, made->responses.exponent[c]);
    }
    return sum;
}
