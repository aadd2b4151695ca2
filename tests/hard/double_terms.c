/* The objective of a kernel per term in double precision. */
#include "double_terms.h"

#include <math.h>
#include <stdlib.h>

enum { TERMS_LIMIT = 32 };

/* Sums over a channel's entries. */
struct sums {
    double misses, squares;       /* V (R - M)^2, V R^2 */
    double along[TERMS_LIMIT];    /* V (R - M) m_t, m_t the term's part of M */
    double of_terms[TERMS_LIMIT]; /* V m_t^2 */
};

static void add_entry(const struct double_terms *m, int channel, size_t here, size_t there, int at,
                      double value, const float *kernels, struct sums *sums)
{
    const struct terms_data *d = m->data;
    const struct responses *r = &d->copies[0];
    size_t points = (size_t)r->width * (size_t)r->height;
    size_t area = (size_t)r->window * (size_t)r->window;
    const float *h = m->h ? m->h : m->f;
    double parts[TERMS_LIMIT], model = 0;
    double weight = (double)d->weights[here] + (d->copy_count == 1 ? (double)d->weights[there] : 0);
    weight *= (double)d->scales[channel][at];
    for (size_t t = 0; t < (size_t)m->terms; t++) {
        parts[t] = (double)m->f[t * points + here] * (double)kernels[t * area + (size_t)at] *
                   (double)h[t * points + there];
        model += parts[t];
    }
    for (size_t t = 0; t < (size_t)m->terms; t++) {
        sums->along[t] += weight * (value - model) * parts[t];
        sums->of_terms[t] += weight * parts[t] * parts[t];
    }
    sums->misses += weight * (value - model) * (value - model);
    sums->squares += weight * value * value;
}

static struct sums sum_channel(const struct double_terms *m, int channel)
{
    const struct responses *r = &m->data->copies[0];
    struct sums sums = {0};
    int half = r->window / 2, area = r->window * r->window;
    float *kernels = calloc((size_t)m->terms * (size_t)area + 1, sizeof *kernels);
    for (int t = 0; t < m->terms; t++) {
        terms_grid_spread(&m->data->grid,
                          m->numbers[channel] + (size_t)t * (size_t)m->data->grid.count,
                          kernels + (size_t)t * (size_t)area);
    }
    for (int i = 0; i < r->width * r->height * area; i++) {
        int at = i % area, x = i / area % r->width, y = i / area / r->width;
        int u = at % r->window, v = at / r->window, xo = x + u - half, yo = y + v - half;
        if (xo < 0 || xo >= r->width || yo < 0 || yo >= r->height || at == area / 2) {
            continue;
        }
        float value = responses_value(r, channel, x, y, u, v);
        if (!isnan(value)) {
            add_entry(m, channel, (size_t)y * (size_t)r->width + (size_t)x,
                      (size_t)yo * (size_t)r->width + (size_t)xo, at, (double)value, kernels,
                      &sums);
        }
    }
    free(kernels);
    return sums;
}

struct double_objective double_terms_objective(const struct double_terms *m)
{
    const struct terms_data *d = m->data;
    struct double_objective found = {0};
    double pairs = d->copy_count == 1 ? 4 : 2; /* each is met twice where it is one number */
    for (int c = 0; c < d->responses->channels; c++) {
        struct sums sums = sum_channel(m, c);
        found.objective += sums.misses / pairs + d->constant[c];
        found.energy += sums.squares / pairs + d->constant[c];
        for (int t = 0; t < m->terms; t++) {
            double size = sqrt(sums.squares) * sqrt(sums.of_terms[t]);
            found.slope = size > 0 ? fmax(found.slope, fabs(sums.along[t]) / size) : found.slope;
        }
    }
    found.objective = ldexp(found.objective, d->exponent);
    found.energy = ldexp(found.energy, d->exponent);
    return found;
}
