/* A real method whose steps take time on a clock that tests own. */
#include "paced.h"

#include "factor/hals.h"
#include "factor/terms.h"
#include "factor/update.h"

#include <stdlib.h>

#define STARTED_NS INT64_C(1000000000000)

struct paced_method {
    struct method method;
    struct method *inner;
    struct paced *paced;
    int terms;
};

static int64_t now_ns(struct clock *clock)
{
    return ((struct paced *)clock)->now_ns;
}

static void sleep_until_ns(struct clock *clock, int64_t time_ns)
{
    struct paced *paced = (struct paced *)clock;
    paced->now_ns = time_ns > paced->now_ns ? time_ns : paced->now_ns;
}

/* Channel 0 stands for the iteration. */
static int step(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct paced_method *m = (struct paced_method *)method;
    struct paced *paced = m->paced;
    if (channel == 0) {
        if (paced->cancel_at > 0 && paced->iterations + 1 == paced->cancel_at) {
            (void)nacre_fail(error, "stopped on request");
            return NACRE_CANCELLED;
        }
        if (paced->fail_at > 0 && paced->iterations + 1 >= paced->fail_at &&
            paced->iterations + 1 <= paced->fail_until) {
            paced->iterations++;
            return nacre_fail(error, "the device lost its memory");
        }
        if (paced->before) {
            paced->before(paced->data, paced->iterations + 1);
        }
        paced->iterations++;
        double seconds = paced->seconds_per_term * m->terms;
        if (paced->slow_from > 0 && paced->iterations >= paced->slow_from) {
            seconds *= paced->slow_factor;
        }
        paced->now_ns += (int64_t)(seconds * 1e9);
        paced->longest = seconds > paced->longest ? seconds : paced->longest;
    }
    return m->inner->ops->step(m->inner, channel, objective, error);
}

static int measure(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct method *inner = ((struct paced_method *)method)->inner;
    return inner->ops->measure(inner, channel, objective, error);
}

static int read_factors(struct method *method, int channel, float *f, float *h,
                        struct nacre_error *error)
{
    struct method *inner = ((struct paced_method *)method)->inner;
    return inner->ops->read(inner, channel, f, h, error);
}

static int read_kernels(struct method *method, int channel, float *numbers,
                        struct nacre_error *error)
{
    struct method *inner = ((struct paced_method *)method)->inner;
    return inner->ops->read_kernels(inner, channel, numbers, error);
}

static int write_factors(struct method *method, int channel, const float *f, const float *h,
                         struct nacre_error *error)
{
    struct method *inner = ((struct paced_method *)method)->inner;
    return inner->ops->write(inner, channel, f, h, error);
}

static size_t state_size(const struct method *method, int channel)
{
    const struct method *inner = ((const struct paced_method *)method)->inner;
    return inner->ops->state_size(inner, channel);
}

static int save_state(struct method *method, int channel, void *state, struct nacre_error *error)
{
    struct method *inner = ((struct paced_method *)method)->inner;
    return inner->ops->save(inner, channel, state, error);
}

static int load_state(struct method *method, int channel, const void *state,
                      struct nacre_error *error)
{
    struct method *inner = ((struct paced_method *)method)->inner;
    return inner->ops->load(inner, channel, state, error);
}

static void explain(const struct method *method, const struct listener *to)
{
    const struct method *inner = ((const struct paced_method *)method)->inner;
    inner->ops->explain(inner, to);
}

static void paced_free(struct method *method)
{
    struct paced_method *m = (struct paced_method *)method;
    method_free(m->inner);
    free(m);
}

static const struct method_ops ops = {
    .name = "paced",
    .step = step,
    .measure = measure,
    .read = read_factors,
    .read_kernels = read_kernels,
    .write = write_factors,
    .state_size = state_size,
    .save = save_state,
    .load = load_state,
    .explain = explain,
    .free = paced_free,
};

static int make(void *data, const struct problem *problem, struct method **method,
                struct nacre_error *error)
{
    struct paced *paced = data;
    struct paced_method *m = calloc(1, sizeof *m);
    if (!m) {
        return nacre_fail_memory(error, "the method");
    }
    int status = problem->data ? terms_new(paced->opencl, problem, &m->inner, error)
                 : paced->method == FACTOR_METHOD_MU
                     ? update_new(paced->opencl, problem, NULL, &m->inner, error)
                     : hals_new(paced->opencl, problem, NULL, &m->inner, error);
    if (status != NACRE_OK) {
        free(m);
        return status;
    }
    m->method.ops = &ops;
    m->paced = paced;
    m->terms = problem->terms;
    *method = &m->method;
    return NACRE_OK;
}

void paced_begin(struct paced *paced, const struct opencl *opencl, enum factor_method method)
{
    static const struct clock_ops clock_ops = {
        .name = "paced", .now_ns = now_ns, .sleep_until_ns = sleep_until_ns};
    *paced = (struct paced){.clock = {&clock_ops},
                            .now_ns = STARTED_NS,
                            .maker = {make, paced},
                            .opencl = opencl,
                            .method = method};
}

double paced_seconds(const struct paced *paced)
{
    return (double)(paced->now_ns - STARTED_NS) * 1e-9;
}

void paced_apply(struct paced *paced, struct factor_options *options)
{
    options->clock = &paced->clock;
    options->maker = &paced->maker;
    options->method = paced->method;
}
