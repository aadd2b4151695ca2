/* The method terms on a sample. */
#include "stage.h"

#include "bench.h"

#include "factor/layout.h"

#include <stdlib.h>

struct stage stage_open(const struct opencl *opencl, const struct sample *sample, int terms)
{
    struct stage s = {.points = (size_t)sample->width * (size_t)sample->height,
                      .terms = (size_t)terms};
    s.responses = sample_load(sample, layout_lanes(opencl));
    s.kinds = calloc(s.points, sizeof *s.kinds);
    s.kernels = calloc((size_t)sample->channels * (size_t)sample->window * (size_t)sample->window,
                       sizeof *s.kernels);
    for (size_t i = 0; i < s.points; i++) {
        s.kinds[i] = (uint32_t)(i % s.terms);
    }
    return s;
}

void stage_begin(const struct opencl *opencl, struct stage *s)
{
    const struct terms_options options = {.reciprocity = TERMS_RECIPROCAL};
    struct nacre_error error = {0};
    bench_succeed(terms_data_begin(&s->data, &s->responses, &options, 1e-5, &error), &error);
    s->problem = (struct problem){.responses = &s->responses,
                                  .ids = s->kinds,
                                  .kernels = s->kernels,
                                  .clusters = 1,
                                  .terms = (int)s->terms,
                                  .seed = 3,
                                  .data = &s->data,
                                  .kinds = s->kinds};
    bench_succeed(terms_new(opencl, &s->problem, &s->method, &error), &error);
    s->planes = malloc((s->terms * s->points + 1) * sizeof *s->planes);
    s->numbers = malloc((s->terms * (size_t)s->data.grid.count + 1) * sizeof *s->numbers);
}

void stage_read(struct stage *s)
{
    struct nacre_error error = {0};
    bench_succeed(s->method->ops->read(s->method, 0, s->planes, NULL, &error), &error);
    bench_succeed(s->method->ops->read_kernels(s->method, 0, s->numbers, &error), &error);
}

void stage_close(struct stage *s)
{
    method_free(s->method);
    terms_data_finish(&s->data);
    responses_finish(&s->responses);
    free(s->kinds);
    free(s->kernels);
    free(s->planes);
    free(s->numbers);
}
