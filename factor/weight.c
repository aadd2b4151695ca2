/* A method around another: what goes in is weighted by the responses' norms, what comes out is freed of them. */
#include "factor/weight.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

struct weighted {
    struct method method;
    const struct problem *problem;
    struct responses responses; /* X */
    float *kernels;             /* k, in the scaled units of `responses` */
    double *weights;            /* [height][width]: w_i; 0 where there is nothing but 0 */
    int exponent;               /* of n */
    struct problem inner_problem;
    struct method *inner;
};

static size_t points_of(const struct responses *r)
{
    return (size_t)r->width * (size_t)r->height;
}

static const float *kernel_of(const struct problem *p, size_t point, int channel)
{
    const struct responses *r = p->responses;
    size_t area = (size_t)r->window * (size_t)r->window;
    return p->kernels + ((size_t)p->ids[point] * (size_t)r->channels + (size_t)channel) * area;
}

/* The norm of all channels of a response; window: [K][K] of work. */
static double norm_of(const struct responses *r, int x, int y, float *window)
{
    double squares = 0;
    for (int c = 0; c < r->channels; c++) {
        double own = 0;
        responses_get(r, c, x, y, window);
        for (int i = 0; i < r->window * r->window; i++) {
            double value = (double)window[i];
            own += isnan(value) ? 0 : value * value;
        }
        squares += ldexp(own, 2 * r->exponent[c]);
    }
    return sqrt(squares);
}

/* From norms to weights. */
static void set_weights(struct weighted *w)
{
    double sum = 0;
    size_t count = 0;
    for (size_t i = 0; i < points_of(w->problem->responses); i++) {
        sum += w->weights[i];
        count += w->weights[i] > 0;
    }
    w->exponent = count > 0 ? ilogb(sum / (double)count) : 0;
    for (size_t i = 0; i < points_of(w->problem->responses); i++) {
        w->weights[i] = w->weights[i] > 0 ? ldexp(1 / w->weights[i], w->exponent) : 0;
    }
}

/* One response times its weight and kernel; window: [K][K] of work, response: [channels][K][K]. */
static void weigh_point(struct weighted *w, int x, int y, float *window, float *response)
{
    const struct responses *r = w->problem->responses;
    size_t area = (size_t)r->window * (size_t)r->window;
    size_t point = (size_t)y * (size_t)r->width + (size_t)x;
    for (int c = 0; c < r->channels; c++, response += area) {
        const float *kernel = kernel_of(w->problem, point, c);
        responses_get(r, c, x, y, window);
        for (size_t i = 0; i < area; i++) {
            response[i] = (float)((double)window[i] * w->weights[point] * (double)kernel[i]);
        }
    }
}

enum pass { PASS_NORMS, PASS_RESPONSES };

/* Of a row of points; work: [channels + 1][K][K]. */
static void weigh_row(struct weighted *w, int y, enum pass pass, float *work)
{
    const struct responses *r = w->problem->responses;
    size_t area = (size_t)r->window * (size_t)r->window;
    for (int x = 0; x < r->width; x++) {
        if (pass == PASS_NORMS) {
            w->weights[(size_t)y * (size_t)r->width + (size_t)x] = norm_of(r, x, y, work);
        } else {
            weigh_point(w, x, y, work, work + area);
            responses_put(&w->responses, x, y, work + area);
        }
    }
}

static int weigh_rows(struct weighted *w, enum pass pass, struct nacre_error *error)
{
    const struct responses *r = w->problem->responses;
    size_t area = (size_t)r->window * (size_t)r->window, floats = area * (size_t)(r->channels + 1);
    bool failed = false;
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < r->height; y++) {
        float *work = malloc(floats * sizeof *work);
        if (work) {
            weigh_row(w, y, pass, work);
        } else {
#pragma omp critical(factor_weight)
            failed = true;
        }
        free(work);
    }
    return failed ? nacre_fail_memory(error, "a weighted response") : NACRE_OK;
}

static int weigh_responses(struct weighted *w, struct nacre_error *error)
{
    int status = weigh_rows(w, PASS_NORMS, error);
    if (status == NACRE_OK) {
        set_weights(w);
        status = weigh_rows(w, PASS_RESPONSES, error);
    }
    if (status == NACRE_OK) {
        responses_scale(&w->responses);
    }
    return status;
}

static void square_kernels(struct weighted *w)
{
    const struct problem *p = w->problem;
    size_t area = (size_t)p->responses->window * (size_t)p->responses->window;
    size_t channels = (size_t)p->responses->channels;
    for (size_t i = 0; i < (size_t)p->clusters * channels * area; i++) {
        double kernel = (double)p->kernels[i];
        w->kernels[i] = (float)ldexp(kernel * kernel, -w->responses.exponent[i / area % channels]);
    }
}

static int make_room(struct weighted *w, struct nacre_error *error)
{
    const struct problem *p = w->problem;
    const struct responses *r = p->responses;
    const struct nacre_scan_info info = {.width = r->width,
                                         .height = r->height,
                                         .window = r->window,
                                         .channels = r->channels,
                                         .pixel = NACRE_FLOAT,
                                         .pitch_mm = 1};
    size_t area = (size_t)r->window * (size_t)r->window;
    size_t needed = responses_bytes(&info, r->lanes, false), available = responses_free_bytes();
    w->weights = calloc(points_of(r), sizeof *w->weights);
    w->kernels = malloc((size_t)p->clusters * (size_t)r->channels * area * sizeof *w->kernels);
    if (!w->weights || !w->kernels) {
        return nacre_fail_memory(error, "the weights");
    }
    if (needed > available) {
        return nacre_fail(error,
                          "weighted responses take %.1f GiB of memory more and %.1f GiB are free; "
                          "use --weight kernel or close other programs",
                          (double)needed * 0x1p-30, (double)available * 0x1p-30);
    }
    return responses_begin(&w->responses, &info, r->lanes, false, error);
}

/* From the inner method's scaled units to a sum of relative errors, and to what the caller's ldexp makes that. */
static double objective_of(const struct weighted *w, int channel, double objective)
{
    int outer = w->problem->responses->exponent[channel];
    return ldexp(objective, w->responses.exponent[channel] + outer - 2 * w->exponent);
}

static int step(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct weighted *w = (struct weighted *)method;
    int status = w->inner->ops->step(w->inner, channel, objective, error);
    if (objective) {
        *objective = objective_of(w, channel, *objective);
    }
    return status;
}

static int measure(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct weighted *w = (struct weighted *)method;
    int status = w->inner->ops->measure(w->inner, channel, objective, error);
    *objective = objective_of(w, channel, *objective);
    return status;
}

static int read_factors(struct method *method, int channel, float *f, float *h,
                        struct nacre_error *error)
{
    struct weighted *w = (struct weighted *)method;
    size_t points = points_of(&w->responses);
    int status = w->inner->ops->read(w->inner, channel, f, h, error);
    for (size_t i = 0; i < points * (size_t)w->problem->terms && status == NACRE_OK; i++) {
        double weight = w->weights[i % points];
        f[i] = weight > 0 ? (float)((double)f[i] / weight) : 0;
    }
    return status;
}

static int write_factors(struct method *method, int channel, const float *f, const float *h,
                         struct nacre_error *error)
{
    struct weighted *w = (struct weighted *)method;
    size_t points = points_of(&w->responses), count = points * (size_t)w->problem->terms;
    float *weighted = malloc(count * sizeof *weighted);
    if (!weighted) {
        return nacre_fail_memory(error, "the factors");
    }
    for (size_t i = 0; i < count; i++) {
        weighted[i] = (float)((double)f[i] * w->weights[i % points]);
    }
    int status = w->inner->ops->write(w->inner, channel, weighted, h, error);
    free(weighted);
    return status;
}

static size_t state_size(const struct method *method, int channel)
{
    const struct weighted *w = (const struct weighted *)method;
    return w->inner->ops->state_size(w->inner, channel);
}

static int save_state(struct method *method, int channel, void *state, struct nacre_error *error)
{
    struct weighted *w = (struct weighted *)method;
    return w->inner->ops->save(w->inner, channel, state, error);
}

static int load_state(struct method *method, int channel, const void *state,
                      struct nacre_error *error)
{
    struct weighted *w = (struct weighted *)method;
    return w->inner->ops->load(w->inner, channel, state, error);
}

static void explain(const struct method *method, const struct listener *to)
{
    const struct weighted *w = (const struct weighted *)method;
    tell(to, "weight", "1 / ||R_i||: relative errors, as asked for; %.1f MiB of weighted responses",
         (double)w->responses.size * (double)w->responses.channels * sizeof(float) * 0x1p-20);
    w->inner->ops->explain(w->inner, to);
}

static void weighted_free(struct method *method)
{
    struct weighted *w = (struct weighted *)method;
    method_free(w->inner);
    responses_finish(&w->responses);
    free(w->kernels);
    free(w->weights);
    free(w);
}

int weight_new(const struct problem *problem,
               int (*make)(void *data, const struct problem *problem, struct method **method,
                           struct nacre_error *error),
               void *data, struct method **method, struct nacre_error *error)
{
    static const struct method_ops ops = {.name = "weighted",
                                          .step = step,
                                          .measure = measure,
                                          .read = read_factors,
                                          .write = write_factors,
                                          .state_size = state_size,
                                          .save = save_state,
                                          .load = load_state,
                                          .explain = explain,
                                          .free = weighted_free};
    struct weighted *w = calloc(1, sizeof *w);
    *method = NULL;
    if (!w) {
        return nacre_fail_memory(error, "the method");
    }
    w->method.ops = &ops;
    w->problem = problem;
    int status = make_room(w, error);
    if (status == NACRE_OK) {
        status = weigh_responses(w, error);
    }
    if (status == NACRE_OK) {
        square_kernels(w);
        w->inner_problem = *problem;
        w->inner_problem.responses = &w->responses;
        w->inner_problem.kernels = w->kernels;
        status = make(data, &w->inner_problem, &w->inner, error);
    }
    if (status == NACRE_OK) {
        *method = &w->method;
    } else {
        weighted_free(&w->method);
    }
    return status;
}
