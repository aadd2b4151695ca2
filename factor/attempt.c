/* One factorization with given terms and clusters. */
#include "factor/attempt.h"

#include "factor/fill.h"
#include "factor/kmeans.h"
#include "factor/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Streams of random numbers drawn from one seed. */
enum { STREAM_CLUSTERS = 1, STREAM_FACTORS = 2 };

/* The labels of a number of clusters, found now or in another run. */
static int find_labels(struct attempt *a, struct factor_prepared *prepared, int clusters,
                       const struct factor_options *o, const uint32_t **labels,
                       struct nacre_error *error)
{
    const struct features *features = &prepared->features;
    for (int i = 0; i < PREPARED_LABELS; i++) {
        const struct prepared_labels *known = &prepared->labels[i];
        if (known->labels && known->clusters == clusters && known->seed == o->seed) {
            a->shared_seconds += known->seconds;
            *labels = known->labels;
            return NACRE_OK;
        }
    }
    struct clock system = clock_monotonic(), *clock = o->clock ? o->clock : &system;
    int64_t begun_ns = clock_now_ns(clock);
    uint32_t *found = malloc(features->count * sizeof *found);
    if (!found) {
        return nacre_fail_memory(error, "the clusters");
    }
    int status = kmeans(features->values, features->count, features->length, clusters,
                        random_bits((uint64_t)o->seed, STREAM_CLUSTERS), found, error);
    if (status != NACRE_OK) {
        free(found);
        return status;
    }
    struct prepared_labels *place = &prepared->labels[prepared->labels_next++ % PREPARED_LABELS];
    free(place->labels);
    *place = (struct prepared_labels){.clusters = clusters,
                                      .seed = o->seed,
                                      .labels = found,
                                      .seconds = (double)(clock_now_ns(clock) - begun_ns) * 1e-9};
    *labels = found;
    return NACRE_OK;
}

static int find_clusters(struct attempt *a, struct factor_prepared *prepared, int clusters,
                         const struct factor_options *o, uint32_t *ids, struct nacre_error *error)
{
    const struct responses *r = a->problem.responses;
    const struct features *features = &prepared->features;
    const uint32_t *labels = NULL;
    int status = find_labels(a, prepared, clusters, o, &labels, error);
    for (size_t i = 0; i < features->count && status == NACRE_OK; i++) {
        ids[features->points[i]] = labels[i];
    }
    return status == NACRE_OK ? fill_labels(r->width, r->height, r->measured, ids, error) : status;
}

int attempt_begin(struct attempt *a, const struct responses *r, struct factor_prepared *prepared,
                  const struct terms_data *data, const struct factor_options *o, int terms,
                  int clusters, struct nacre_error *error)
{
    size_t points = (size_t)r->width * (size_t)r->height;
    size_t area = (size_t)r->window * (size_t)r->window;
    *a = (struct attempt){.probed_at = -1};
    a->ids = malloc(points * sizeof *a->ids);
    a->kernels = malloc((size_t)clusters * (size_t)r->channels * area * sizeof *a->kernels);
    a->kinds = data ? calloc(points, sizeof *a->kinds) : NULL;
    if (!a->ids || !a->kernels || (data && !a->kinds)) {
        return nacre_fail_memory(error, "the clusters");
    }
    a->problem = (struct problem){.responses = r,
                                  .ids = a->ids,
                                  .kernels = a->kernels,
                                  .clusters = clusters,
                                  .terms = terms,
                                  .data = data,
                                  .kinds = a->kinds,
                                  .seed = random_bits((uint64_t)o->seed, STREAM_FACTORS),
                                  .regularise = o->regularise};
    memset(a->ids, 0xff, points * sizeof *a->ids);
    int status = factors_allocate(&a->factors, &a->problem, error);
    if (status == NACRE_OK && prepared) {
        status = find_clusters(a, prepared, clusters, o, a->ids, error);
    }
    if (status == NACRE_OK && prepared && data) {
        size_t count = prepared->features.count;
        int kinds = (size_t)terms < count ? terms : (int)count;
        status = find_clusters(a, prepared, kinds, o, a->kinds, error);
    }
    if (status == NACRE_OK && prepared) {
        status = kernels_compute(r, a->ids, clusters, o->kernel, o->epsilon, a->kernels, error);
    }
    return status;
}

static int grow(float **values, int capacity)
{
    float *grown = realloc(*values, (size_t)capacity * sizeof **values);
    if (grown) {
        *values = grown;
    }
    return grown != NULL;
}

int attempt_extend_history(struct attempt *a, struct nacre_error *error)
{
    struct history *h = &a->history;
    if (h->count == h->capacity) {
        int capacity = 2 * h->capacity + 64;
        if (!grow(&h->objective, capacity) || !grow(&h->seconds, capacity) ||
            !grow(&h->error, capacity)) {
            return nacre_fail_memory(error, "the history");
        }
        h->capacity = capacity;
    }
    h->objective[h->count] = h->seconds[h->count] = h->error[h->count] = NAN;
    h->count++;
    return NACRE_OK;
}

int attempt_inherit(struct attempt *a, const struct attempt *from, struct nacre_error *error)
{
    const struct history *h = &from->history;
    for (int i = 0; i < h->count; i++) {
        if (attempt_extend_history(a, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
        a->history.objective[i] = h->objective[i];
        a->history.seconds[i] = h->seconds[i];
        a->history.error[i] = h->error[i];
    }
    a->inherited = a->known = h->count;
    return NACRE_OK;
}

int attempt_iterations(const struct attempt *a)
{
    return a->history.count - a->inherited;
}

int attempt_advance(struct attempt *a, bool step, double *objective, struct nacre_error *error)
{
    const struct method_ops *ops = a->method->ops;
    const struct responses *r = a->problem.responses;
    int status = NACRE_OK;
    *objective = 0;
    for (int c = 0; c < r->channels && status == NACRE_OK; c++) {
        double part = 0;
        status =
            step ? ops->step(a->method, c, &part, error) : ops->measure(a->method, c, &part, error);
        *objective += ldexp(part, r->exponent[c]);
    }
    return status;
}

void attempt_finish(struct attempt *a)
{
    method_free(a->method);
    factors_finish(&a->factors);
    free(a->ids);
    free(a->kinds);
    free(a->kernels);
    free(a->history.objective);
    free(a->history.seconds);
    free(a->history.error);
    *a = (struct attempt){0};
}
