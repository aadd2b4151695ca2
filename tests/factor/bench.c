/* What the tests of methods share. */
#include "bench.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

void bench_succeed(int status, const struct nacre_error *error)
{
    TEST_ASSERT_EQUAL_MESSAGE(NACRE_OK, status, error->text);
}

struct bench bench_new(const struct sample *sample, int terms, int clusters, int lanes)
{
    struct bench b = {.responses = sample_load(sample, lanes)};
    int half = sample->window / 2, area = sample->window * sample->window;
    size_t points = (size_t)sample->width * (size_t)sample->height;
    b.ids = malloc(points * sizeof *b.ids);
    b.kernels = malloc((size_t)(clusters * sample->channels * area) * sizeof *b.kernels);
    for (size_t i = 0; i < points; i++) {
        b.ids[i] = (uint32_t)(i * 7 / 3 % (size_t)clusters);
    }
    for (int k = 0; k < clusters; k++) {
        for (int c = 0; c < sample->channels; c++) {
            for (int i = 0; i < area; i++) {
                int dx = i % sample->window - half, dy = i / sample->window - half;
                double r = hypot(dx, dy);
                b.kernels[(k * sample->channels + c) * area + i] =
                    (float)(exp(-r / (0.5 + 0.3 * k + 0.1 * c)) + 1e-5);
            }
        }
    }
    b.problem = (struct problem){
        .ids = b.ids, .kernels = b.kernels, .clusters = clusters, .terms = terms, .seed = 3};
    b.count = points * (size_t)terms;
    b.f = malloc(b.count * sizeof *b.f);
    b.h = malloc(b.count * sizeof *b.h);
    return b;
}

void bench_finish(struct bench *b)
{
    method_free(b->method);
    responses_finish(&b->responses);
    free(b->ids);
    free(b->kernels);
    free(b->f);
    free(b->h);
}

void bench_read(struct bench *b, int channel)
{
    struct nacre_error error = {0};
    bench_succeed(b->method->ops->read(b->method, channel, b->f, b->h, &error), &error);
}

void bench_run(struct bench *b, int count)
{
    struct nacre_error error = {0};
    for (int i = 0; i < count; i++) {
        for (int c = 0; c < b->responses.channels; c++) {
            double objective = 0;
            bench_succeed(b->method->ops->step(b->method, c, i % 2 ? &objective : NULL, &error),
                          &error);
        }
    }
}

float *bench_factors(struct bench *b)
{
    float *both = malloc(2 * b->count * sizeof *both);
    TEST_ASSERT_NOT_NULL(both);
    bench_read(b, 0);
    memcpy(both, b->f, b->count * sizeof *both);
    memcpy(both + b->count, b->h, b->count * sizeof *both);
    return both;
}

struct reference bench_reference(const struct bench *b, int channel)
{
    const struct responses *r = &b->responses;
    size_t area = (size_t)r->window * (size_t)r->window;
    size_t points = (size_t)r->width * (size_t)r->height;
    double *responses = malloc(points * area * sizeof *responses);
    double *kernels = malloc((size_t)b->problem.clusters * area * sizeof *kernels);
    float *window = malloc(area * sizeof *window);
    struct reference reference = {.width = r->width,
                                  .height = r->height,
                                  .window = r->window,
                                  .terms = b->problem.terms,
                                  .responses = responses,
                                  .ids = b->ids,
                                  .kernels = kernels,
                                  .f = malloc(b->count * sizeof(double)),
                                  .h = malloc(b->count * sizeof(double))};
    for (size_t i = 0; i < points; i++) {
        responses_get(r, channel, (int)(i % (size_t)r->width), (int)(i / (size_t)r->width), window);
        for (size_t j = 0; j < area; j++) {
            responses[i * area + j] = window[j];
        }
    }
    for (size_t k = 0; k < (size_t)b->problem.clusters; k++) {
        for (size_t j = 0; j < area; j++) {
            kernels[k * area + j] =
                b->kernels[(k * (size_t)r->channels + (size_t)channel) * area + j];
        }
    }
    for (size_t i = 0; i < b->count; i++) {
        reference.f[i] = b->f[i];
        reference.h[i] = b->h[i];
    }
    free(window);
    return reference;
}

void bench_reference_finish(struct reference *reference)
{
    free(reference->responses);
    free(reference->kernels);
    free(reference->f);
    free(reference->h);
}
