/* What comes of factorizing a sample. */
#include "outcome.h"

#include "bench.h"

#include "factor/layout.h"

#include <string.h>

struct outcome outcome_of(const struct sample *sample, const struct factor_options *options,
                          const struct opencl *opencl, struct nacre_error *error)
{
    struct outcome outcome = {0};
    struct responses responses = sample_load(sample, layout_lanes(opencl));
    outcome.status = factorize_responses(&responses, 0.5, options, opencl, NULL, &outcome.material,
                                         &outcome.summary, error);
    responses_finish(&responses);
    return outcome;
}

void outcome_finish(struct outcome *outcome)
{
    nacre_material_finish(&outcome->material);
    factor_summary_finish(&outcome->summary);
}

static int read_response(const void *data, int x, int y, float *response, struct nacre_error *error)
{
    const struct sample *s = data;
    (void)error;
    memcpy(response, sample_at(s, x, y),
           (size_t)s->channels * (size_t)s->window * (size_t)s->window * sizeof *response);
    return NACRE_OK;
}

struct error_report outcome_judge(const struct sample *sample,
                                  const struct nacre_material *material)
{
    const struct error_source source = {.data = sample, .read = read_response};
    struct error_report report = {0};
    struct nacre_error error = {0};
    bench_succeed(error_measure(&source, material, NULL, &report, &error), &error);
    return report;
}
