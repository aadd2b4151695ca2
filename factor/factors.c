/* F and H of all channels at rest in memory. */
#include "factor/factors.h"

#include "factor/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static size_t plane_of(const struct factors *factors)
{
    return (size_t)factors->width * (size_t)factors->height;
}

int factors_allocate(struct factors *factors, const struct problem *problem,
                     struct nacre_error *error)
{
    const struct responses *r = problem->responses;
    *factors = (struct factors){
        .width = r->width, .height = r->height, .channels = r->channels, .terms = problem->terms};
    size_t count = plane_of(factors) * (size_t)factors->terms;
    const struct terms_data *data = problem->data;
    int sets = data ? terms_data_sets(data) : factors->channels;
    bool two_sided = !data || data->copy_count == 2;
    factors->numbers = data ? data->grid.count : 0;
    for (int c = 0; c < factors->channels; c++) {
        factors->f[c] = c < sets ? calloc(count, sizeof *factors->f[c]) : NULL;
        factors->h[c] = c < sets && two_sided ? calloc(count, sizeof *factors->h[c]) : NULL;
        factors->kernels[c] =
            data ? calloc((size_t)factors->terms * (size_t)factors->numbers + 1, sizeof(float))
                 : NULL;
        if ((c < sets && (!factors->f[c] || (two_sided && !factors->h[c]))) ||
            (data && !factors->kernels[c])) {
            return nacre_fail_memory(error, "the factors");
        }
    }
    return NACRE_OK;
}

void factors_finish(struct factors *factors)
{
    for (int c = 0; c < RESPONSES_CHANNELS; c++) {
        free(factors->f[c]);
        free(factors->h[c]);
        free(factors->kernels[c]);
    }
    *factors = (struct factors){0};
}

static void copy(float *to, const float *from, size_t count)
{
    if (to && from) {
        memcpy(to, from, count * sizeof *to);
    }
}

void factors_copy(struct factors *to, const struct factors *from)
{
    size_t count = plane_of(from) * (size_t)from->terms;
    for (int c = 0; c < from->channels; c++) {
        copy(to->f[c], from->f[c], count);
        copy(to->h[c], from->h[c], count);
        copy(to->kernels[c], from->kernels[c], (size_t)from->terms * (size_t)from->numbers);
    }
}

int factors_read(struct factors *factors, struct method *method, struct nacre_error *error)
{
    int status = NACRE_OK;
    for (int c = 0; c < factors->channels && status == NACRE_OK; c++) {
        status = method->ops->read(method, c, factors->f[c], factors->h[c], error);
        if (status == NACRE_OK && factors->kernels[c]) {
            status = method->ops->read_kernels(method, c, factors->kernels[c], error);
        }
    }
    return status;
}

int factors_write(const struct factors *factors, struct method *method, struct nacre_error *error)
{
    int status = NACRE_OK;
    for (int c = 0; c < factors->channels && status == NACRE_OK; c++) {
        status = method->ops->write(method, c, factors->f[c], factors->h[c], error);
    }
    return status;
}

struct strength {
    double value;
    int term;
};

/* Strongest first; of equals the first. */
static int compare_strength(const void *a, const void *b)
{
    const struct strength *left = a, *right = b;
    if (left->value != right->value) {
        return left->value > right->value ? -1 : 1;
    }
    return left->term < right->term ? -1 : 1;
}

static int compare_term(const void *a, const void *b)
{
    const struct strength *left = a, *right = b;
    return left->term < right->term ? -1 : 1;
}

/* The terms of a channel by what they bring to the model on the whole, the first `keep` of them in their order. */
static void rank(const struct factors *factors, int channel, int keep, struct strength *terms)
{
    size_t plane = plane_of(factors);
    for (int t = 0; t < factors->terms; t++) {
        const float *f = factors->f[channel] + (size_t)t * plane;
        const float *h =
            (factors->h[channel] ? factors->h[channel] : factors->f[channel]) + (size_t)t * plane;
        double sum_f = 0, sum_h = 0;
        for (size_t i = 0; i < plane; i++) {
            sum_f += (double)f[i];
            sum_h += (double)h[i];
        }
        terms[t] = (struct strength){sum_f * sum_h, t};
    }
    qsort(terms, (size_t)factors->terms, sizeof *terms, compare_strength);
    qsort(terms, (size_t)keep, sizeof *terms, compare_term);
}

/* Random terms behind the first `kept`. */
static void add_small(struct factors *to, int channel, int kept, uint64_t seed)
{
    const float size = 0.1F * sqrtf(1 / (float)to->terms);
    size_t plane = plane_of(to), first = (size_t)kept * plane;
    size_t end = (size_t)to->terms * plane;
    uint64_t stream = random_bits(seed, 2 * (uint64_t)channel);
    for (size_t i = first; i < end; i++) {
        to->f[channel][i] = 2 * size * (float)random_uniform(stream, 2 * i);
        if (to->h[channel]) {
            to->h[channel][i] = 2 * size * (float)random_uniform(stream, 2 * i + 1);
        }
    }
}

int factors_fit(const struct factors *from, uint64_t seed, struct factors *to,
                struct nacre_error *error)
{
    size_t plane = plane_of(from);
    int kept = from->terms < to->terms ? from->terms : to->terms;
    struct strength *terms = malloc((size_t)from->terms * sizeof *terms);
    if (!terms) {
        return nacre_fail_memory(error, "the factors");
    }
    for (int c = 0; c < from->channels && from->f[c]; c++) {
        rank(from, c, kept, terms);
        for (int t = 0; t < kept; t++) {
            size_t source = (size_t)terms[t].term * plane;
            memcpy(to->f[c] + (size_t)t * plane, from->f[c] + source, plane * sizeof *to->f[c]);
            if (to->h[c]) {
                memcpy(to->h[c] + (size_t)t * plane, from->h[c] + source, plane * sizeof *to->h[c]);
            }
        }
        add_small(to, c, kept, seed);
    }
    free(terms);
    return NACRE_OK;
}
