/* Laying out entries distance by distance. */
#include "entries.h"

#include "../timing.h"

#include <math.h>
#include <stdlib.h>

/* The mean response of each channel plus 1e-5 of its maximum. */
static double *mean_response(const struct sample *s, const float *measured)
{
    size_t size = sample_response_size(s), points = (size_t)s->width * (size_t)s->height;
    size_t area = (size_t)s->window * (size_t)s->window;
    double *mean = allocate(size * sizeof *mean);
    for (size_t k = 0; k < size; k++) {
        double sum = 0, count = 0;
        for (size_t i = 0; i < points; i++) {
            double value = (double)measured[i * size + k];
            sum += isnan(value) ? 0 : value;
            count += !isnan(value);
        }
        mean[k] = count > 0 ? fmax(0, sum / count) : 0;
    }
    for (size_t c = 0; c < (size_t)s->channels; c++) {
        double greatest = 0;
        for (size_t k = 0; k < area; k++) {
            greatest = fmax(greatest, mean[c * area + k]);
        }
        for (size_t k = 0; k < area; k++) {
            mean[c * area + k] += 1e-5 * greatest;
        }
    }
    return mean;
}

/* W^2 by point (for relative errors) or by entry of a window (for the kernel's weight). */
static double *find_weights(const struct sample *s, const float *measured,
                            enum factor_weight weight)
{
    size_t size = sample_response_size(s), points = (size_t)s->width * (size_t)s->height;
    double *weights;
    if (weight == FACTOR_WEIGHT_KERNEL) {
        weights = mean_response(s, measured);
        for (size_t k = 0; k < size; k++) {
            weights[k] = 1 / weights[k];
        }
        return weights;
    }
    weights = allocate(points * sizeof *weights);
    for (size_t i = 0; i < points; i++) {
        double square = 0;
        for (size_t k = 0; k < size; k++) {
            double value = (double)measured[i * size + k];
            square += isnan(value) ? 0 : value * value;
        }
        weights[i] = square > 0 ? 1 / square : 0;
    }
    return weights;
}

/* Add one measurement of an entry to those that are there. */
static void add(struct entries *e, size_t at, double value, double weight)
{
    double both = e->weights[at] + weight;
    if (isnan(value) || !(weight > 0)) {
        return;
    }
    double apart = value - e->targets[at];
    e->rest += e->weights[at] * weight / both * apart * apart / 2;
    e->targets[at] += weight / both * apart;
    e->weights[at] = both;
}

static void choose_distances(struct entries *e, bool folded)
{
    int half = e->window / 2;
    e->dx = allocate((size_t)e->window * (size_t)e->window * sizeof *e->dx);
    e->dy = allocate((size_t)e->window * (size_t)e->window * sizeof *e->dy);
    for (int dy = -half; dy <= half; dy++) {
        for (int dx = -half; dx <= half; dx++) {
            if (!folded || dy > 0 || (dy == 0 && dx >= 0)) {
                e->dx[e->count] = dx;
                e->dy[e->count++] = dy;
            }
        }
    }
}

void entries_make(const struct sample *s, const float *measured, enum factor_weight weight,
                  bool folded, struct entries *e)
{
    size_t points = (size_t)s->width * (size_t)s->height, size = sample_response_size(s);
    size_t area = (size_t)s->window * (size_t)s->window;
    int half = s->window / 2;
    double *weights = find_weights(s, measured, weight);
    *e =
        (struct entries){s->width, s->height, s->channels, s->window, 0, NULL, NULL, NULL, NULL, 0};
    choose_distances(e, folded);
    e->targets = allocate((size_t)(s->channels * e->count) * points * sizeof *e->targets);
    e->weights = allocate((size_t)(s->channels * e->count) * points * sizeof *e->weights);
    for (int n = 0; n < s->channels * e->count; n++) {
        int c = n / e->count, d = n % e->count;
        struct span span = entries_span(e, c, d);
        bool twice = folded && span.shift != 0, by_point = weight == FACTOR_WEIGHT_RESPONSE;
        size_t forth = (size_t)c * area + (size_t)((e->dy[d] + half) * s->window + e->dx[d] + half);
        size_t back = (size_t)c * area + (size_t)((half - e->dy[d]) * s->window + half - e->dx[d]);
        for (size_t i = span.first; i < span.end; i++) {
            size_t o = (size_t)((ptrdiff_t)i + span.shift);
            int xo = (int)(i % (size_t)s->width) + e->dx[d];
            if (xo < 0 || xo >= s->width) {
                continue;
            }
            add(e, span.start + i, (double)measured[i * size + forth],
                weights[by_point ? i : forth]);
            if (twice) {
                add(e, span.start + i, (double)measured[o * size + back],
                    weights[by_point ? o : back]);
            }
        }
    }
    free(weights);
}

struct span entries_span(const struct entries *e, int channel, int distance)
{
    size_t points = (size_t)e->width * (size_t)e->height;
    ptrdiff_t shift = (ptrdiff_t)e->dy[distance] * e->width + e->dx[distance];
    return (struct span){.start = ((size_t)channel * (size_t)e->count + (size_t)distance) * points,
                         .shift = shift,
                         .first = shift < 0 ? (size_t)-shift : 0,
                         .end = shift > 0 ? points - (size_t)shift : points};
}

void entries_finish(struct entries *e)
{
    free(e->dx);
    free(e->dy);
    free(e->targets);
    free(e->weights);
    *e = (struct entries){0};
}
