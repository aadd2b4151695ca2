/* The mean relative error of factors on a few points of the sample. */
#include "factor/probe.h"

#include "factor/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A random one of the measured points from each of `count` stretches of equal length; all where there are no more. */
static void choose_points(struct probe *probe, uint64_t seed)
{
    const struct responses *r = probe->responses;
    size_t points = (size_t)r->width * (size_t)r->height, measured = 0, chosen = 0, next = 0;
    double stretch = (double)r->measured_count / (double)probe->count;
    bool all = probe->count == r->measured_count;
    for (size_t i = 0; i < points && chosen < probe->count; i++) {
        if (!all && measured >= next) {
            double offset = (double)chosen + random_uniform(seed, chosen);
            next = (size_t)(offset * stretch * (1 - 1e-12));
            next = next > measured ? next : measured;
        }
        if (r->measured[i]) {
            if (all || measured == next) {
                probe->points[chosen++] = i;
            }
            measured++;
        }
    }
    probe->count = chosen;
}

static void keep_point(struct probe *probe, size_t i)
{
    const struct responses *r = probe->responses;
    size_t area = (size_t)r->window * (size_t)r->window, width = (size_t)r->width;
    int x = (int)(probe->points[i] % width), y = (int)(probe->points[i] / width);
    probe->beyond[i] = r->beyond ? ldexp(r->beyond[probe->points[i]], -2 * probe->largest) : 0;
    probe->norms[i] = probe->beyond[i];
    for (int c = 0; c < r->channels; c++) {
        float *window = probe->windows + (i * (size_t)r->channels + (size_t)c) * area;
        responses_get(r, c, x, y, window);
        for (size_t j = 0; j < area; j++) {
            double value = isnan(window[j]) ? 0 : (double)window[j];
            probe->norms[i] += probe->weights[c] * value * value;
        }
    }
}

int probe_begin(struct probe *probe, const struct responses *r, size_t most, uint64_t seed,
                struct nacre_error *error)
{
    size_t area = (size_t)r->window * (size_t)r->window;
    int largest = r->exponent[0];
    *probe = (struct probe){.responses = r,
                            .count = r->measured_count < most ? r->measured_count : most};
    probe->points = malloc((probe->count + 1) * sizeof *probe->points);
    probe->windows =
        malloc((probe->count + 1) * (size_t)r->channels * area * sizeof *probe->windows);
    probe->norms = malloc((probe->count + 1) * sizeof *probe->norms);
    probe->misses = malloc((probe->count + 1) * sizeof *probe->misses);
    probe->beyond = malloc((probe->count + 1) * sizeof *probe->beyond);
    probe->lines = malloc((probe->count + 1) * (size_t)r->window * sizeof *probe->lines);
    if (!probe->points || !probe->windows || !probe->norms || !probe->misses || !probe->beyond ||
        !probe->lines) {
        return nacre_fail_memory(error, "the points to watch");
    }
    for (int c = 1; c < r->channels; c++) {
        largest = r->exponent[c] > largest ? r->exponent[c] : largest;
    }
    probe->largest = largest;
    for (int c = 0; c < r->channels; c++) {
        probe->weights[c] = ldexp(1, 2 * (r->exponent[c] - largest));
    }
    choose_points(probe, seed);
#pragma omp parallel for
    for (size_t i = 0; i < probe->count; i++) {
        keep_point(probe, i);
    }
    return NACRE_OK;
}

/* A row of a point's window by the model without its kernel: line[count], from entry `first_there` of a plane on. */
static void add_terms(const struct factors *factors, int channel, size_t point, size_t first_there,
                      int count, float *line)
{
    size_t plane = (size_t)factors->width * (size_t)factors->height;
    memset(line, 0, (size_t)count * sizeof *line);
    for (size_t t = 0; t < (size_t)factors->terms; t++) {
        float f = factors->f[channel][t * plane + point];
        const float *h = factors->h[channel] + t * plane + first_there;
        for (int u = 0; u < count; u++) {
            line[u] += f * h[u];
        }
    }
}

/* The squared difference of one channel of a point. */
/* The same with a kernel per term: row v of the window, from entry u0 on, without the centre, which c holds. */
static void add_shaped(const struct problem *problem, const struct factors *factors, int channel,
                       size_t point, size_t first_there, int v, int u0, int count, float *line)
{
    const struct terms_data *data = problem->data;
    const struct terms_grid *g = &data->grid;
    size_t plane = (size_t)factors->width * (size_t)factors->height;
    int set = factors->f[channel] ? channel : 0;
    const float *own = factors->f[set], *other = factors->h[set] ? factors->h[set] : own;
    memset(line, 0, (size_t)count * sizeof *line);
    if (!own) {
        return; /* nothing was read yet */
    }
    for (size_t t = 0; t < (size_t)factors->terms; t++) {
        const float *numbers = factors->kernels[channel] + t * (size_t)g->count;
        for (int u = 0; u < count; u++) {
            int at = v * g->window + u0 + u;
            double share = g->share[at];
            double value = (1 - share) * (double)numbers[g->first[at]];
            value += share > 0 ? share * (double)numbers[g->first[at] + 1] : 0;
            line[u] += (float)(value * (double)own[t * plane + point] *
                               (double)other[t * plane + first_there + (size_t)u]);
        }
    }
    for (int u = 0; u < count; u++) {
        size_t there = first_there + (size_t)u;
        line[u] = ldexpf(line[u], data->copies[0].exponent[channel]);
        line[u] *= data->gain ? data->gain[point] / data->gain[there] : 1;
    }
}

static double miss(const struct probe *probe, const struct problem *problem,
                   const struct factors *factors, size_t i, int channel)
{
    const struct responses *r = probe->responses;
    size_t window = (size_t)r->window, area = window * window, point = probe->points[i];
    int half = r->window / 2;
    int x = (int)(point % (size_t)r->width), y = (int)(point / (size_t)r->width);
    int u0 = x < half ? half - x : 0;
    int u1 = x + half >= r->width ? r->width - x + half : r->window;
    const float *measured = probe->windows + (i * (size_t)r->channels + (size_t)channel) * area;
    const float *kernel =
        problem->kernels +
        ((size_t)problem->ids[point] * (size_t)r->channels + (size_t)channel) * area;
    float *line = probe->lines + i * window;
    double sum = 0;
    for (int v = 0; v < r->window; v++) {
        int there = y + v - half;
        if (there < 0 || there >= r->height) {
            continue;
        }
        size_t first = (size_t)v * window + (size_t)u0;
        size_t from = (size_t)there * (size_t)r->width + (size_t)(x + u0 - half);
        if (problem->data) {
            add_shaped(problem, factors, channel, point, from, v, u0, u1 - u0, line);
        } else {
            add_terms(factors, channel, point, from, u1 - u0, line);
        }
        for (size_t u = 0; u < (size_t)(u1 - u0); u++) {
            float modelled = problem->data ? line[u] : line[u] * kernel[first + u];
            bool centred = problem->data && v == half && u0 + (int)u == half;
            float difference = centred ? 0 : measured[first + u] - modelled;
            sum += isnan(measured[first + u]) ? 0 : (double)(difference * difference);
        }
    }
    return sum;
}

double probe_measure(const struct probe *probe, const struct problem *problem,
                     const struct factors *factors)
{
    double sum = 0;
    size_t count = 0;
#pragma omp parallel for schedule(dynamic, 8)
    for (size_t i = 0; i < probe->count; i++) {
        probe->misses[i] = probe->beyond[i];
        for (int c = 0; c < factors->channels; c++) {
            probe->misses[i] += probe->weights[c] * miss(probe, problem, factors, i, c);
        }
    }
    for (size_t i = 0; i < probe->count; i++) {
        if (probe->norms[i] > 0) {
            sum += sqrt(probe->misses[i] / probe->norms[i]);
            count++;
        }
    }
    return count ? sum / (double)count : 0;
}

void probe_finish(struct probe *probe)
{
    free(probe->points);
    free(probe->windows);
    free(probe->norms);
    free(probe->misses);
    free(probe->beyond);
    free(probe->lines);
    *probe = (struct probe){0};
}
