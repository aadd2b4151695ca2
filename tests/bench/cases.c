/* The problems of the benchmarks, and what a thousand of the paper's updates reach there. */
#include "cases.h"

#include "timing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The last two columns are what `bench_goals` prints. */
const struct bench_case cases[] = {
    {"small", FIELD_CANDLE, 64, 48, 25, 1, 12, 5, 8.6050286, 3.6422663},
    {"candle", FIELD_CANDLE, 212, 154, 49, 1, 12, 1, 379.68765, 201.35217},
    {"candle", FIELD_CANDLE, 212, 154, 49, 1, 12, 5, 191.58168, 90.125423},
    {"candle", FIELD_CANDLE, 212, 154, 49, 1, 12, 100, 178.73176, 79.140241},
    {"marble 4x4", FIELD_MARBLE, 277, 277, 39, 1, 20, 1, 653.38498, 238.75596},
    {"marble 4x4", FIELD_MARBLE, 277, 277, 39, 1, 20, 5, 375.2739, 143.10954},
    {"marble 4x4", FIELD_MARBLE, 277, 277, 39, 1, 20, 100, 321.08964, 125.50276},
    {"candle", FIELD_CANDLE, 212, 154, 49, 3, 12, 100, 510.21147, 221.09688},
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

void case_make(const struct bench_case *c, int lanes, bool half, struct case_problem *made)
{
    const struct factor_options options = factor_options_default();
    struct field field = field_new(c->kind, c->width, c->height, c->window, c->channels, CASE_SEED);
    struct factor_prepared prepared = {0};
    struct nacre_error error = {0};
    *made = (struct case_problem){.responses = field_load(&field, lanes, half)};
    if (features_new(&made->responses, &prepared.features, &error) != NACRE_OK ||
        attempt_begin(&made->attempt, &made->responses, &prepared, NULL, &options, c->terms,
                      c->clusters, &error) != NACRE_OK) {
        fail(error.text);
    }
    factor_prepared_finish(&prepared);
    field_finish(&field);
}

void case_finish(struct case_problem *made)
{
    attempt_finish(&made->attempt);
    responses_finish(&made->responses);
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
