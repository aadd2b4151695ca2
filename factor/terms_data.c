/* Responses, weights and the grid of kernels for the model with a kernel per term. */
#include "factor/terms_data.h"

#include "factor/kernels.h"
#include "factor/terms_gain.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Squared distances near the centre at which a radial kernel has a number of its own; farther out every point. */
static const int near_squares[] = {0, 1, 2, 4, 5, 8, 9, 10, 13, 16};

/* What is within reach: all but this share of the weighted squares, without the centre; half of the window's entries or fewer,
 * and as far out as radial kernels have numbers at other distances than whole ones. */
#define MOST_BEYOND 1e-3
enum { REACH_SAVES = 2, LEAST_REACH = 4, REACH_POINTS = 1000 };

enum { NEAR_SQUARES = sizeof near_squares / sizeof *near_squares, NEAR = 4 };

static size_t points_of(const struct responses *r)
{
    return (size_t)r->width * (size_t)r->height;
}

static size_t area_of(const struct responses *r)
{
    return (size_t)r->window * (size_t)r->window;
}

/* Up to the first beyond the window's corners. */
int terms_radii(int window)
{
    const int half = window / 2;
    int farthest = (int)ceil(hypot(half, half));
    return NEAR_SQUARES + (farthest > NEAR ? farthest - NEAR : 0);
}

static void list_radii(struct terms_grid *g)
{
    g->count = terms_radii(g->window);
    for (int i = 0; i < g->count; i++) {
        g->radius[i] =
            i < NEAR_SQUARES ? sqrtf((float)near_squares[i]) : (float)(NEAR + 1 + i - NEAR_SQUARES);
    }
}

static void place_entry(struct terms_grid *g, int i)
{
    int half = g->window / 2, k = 0;
    int dx = i % g->window - half, dy = i / g->window - half;
    double distance = hypot(dx, dy);
    if (!g->radius) {
        g->first[i] = i;
        g->share[i] = 0;
        return;
    }
    /* Radii are rounded to float: an entry at sqrt(2) is at the number there. */
    while (k + 1 < g->count && (double)g->radius[k + 1] <= distance + 1e-6) {
        k++;
    }
    double share = distance - (double)g->radius[k];
    g->first[i] = k;
    g->share[i] =
        share > 1e-6 && k + 1 < g->count ? share / (double)(g->radius[k + 1] - g->radius[k]) : 0;
}

static int grid_begin(struct terms_grid *g, int window, bool full, struct nacre_error *error)
{
    size_t area = (size_t)window * (size_t)window;
    *g = (struct terms_grid){.window = window,
                             .count = (int)area,
                             .radius = full ? NULL : calloc(area + NEAR_SQUARES, sizeof(float)),
                             .first = calloc(area, sizeof *g->first),
                             .share = calloc(area, sizeof *g->share)};
    if (!g->first || !g->share || (!full && !g->radius)) {
        return nacre_fail_memory(error, "the kernels");
    }
    if (!full) {
        list_radii(g);
    }
    for (int i = 0; i < window * window; i++) {
        place_entry(g, i);
    }
    return NACRE_OK;
}

void terms_grid_spread(const struct terms_grid *g, const float *numbers, float *kernel)
{
    for (int i = 0; i < g->window * g->window; i++) {
        double share = g->share[i];
        double value = (1 - share) * (double)numbers[g->first[i]];
        kernel[i] = (float)(share > 0 ? value + share * (double)numbers[g->first[i] + 1] : value);
    }
}

/* Squared norms of responses, all channels, in the responses' own unit. window: [K][K] of work. */
static double squares_of(const struct responses *r, size_t point, float *window)
{
    int x = (int)(point % (size_t)r->width), y = (int)(point / (size_t)r->width);
    double squares = 0;
    for (int c = 0; c < r->channels; c++) {
        double own = 0;
        responses_get(r, c, x, y, window);
        for (size_t j = 0; j < area_of(r); j++) {
            own += isnan(window[j]) ? 0 : (double)window[j] * (double)window[j];
        }
        squares += ldexp(own, 2 * r->exponent[c]);
    }
    return squares;
}

/* Weights of relative errors, times the power of two that makes them about 1; returns its exponent. Dark points weigh
 * nothing, and what is below floats' range beside the others is dark. */
static int weigh_by_response(struct terms_data *d, double *squares, float *window)
{
    const struct responses *r = d->responses;
    double sum = 0;
    size_t lit = 0;
    for (size_t i = 0; i < points_of(r); i++) {
        squares[i] = squares_of(r, i, window);
        sum += squares[i] > 0 ? log2(squares[i]) : 0;
        lit += squares[i] > 0;
    }
    int exponent = lit ? (int)lrint(sum / (double)lit) : 0;
    for (size_t i = 0; i < points_of(r); i++) {
        double weight = squares[i] > 0 ? ldexp(1 / squares[i], exponent) : 0;
        d->weights[i] = weight < FLT_MAX ? (float)weight : 0;
    }
    return exponent;
}

/* Factors that make weighted squares of scaled responses what they are in the objective, less 2^exponent. */
static int scale_entries(struct terms_data *d, int exponent, double epsilon,
                         struct nacre_error *error)
{
    const struct responses *r = d->responses;
    size_t area = area_of(r);
    bool by_kernel = d->options.weight == TERMS_WEIGHT_KERNEL;
    uint32_t *ids = calloc(points_of(r), sizeof *ids);
    float *kernels = malloc((size_t)r->channels * area * sizeof *kernels);
    int status = NACRE_OK;
    if (!ids || !kernels) {
        status = nacre_fail_memory(error, "the weights");
        goto out;
    }
    if (by_kernel) {
        status = kernels_compute(r, ids, 1, KERNELS_AVERAGE, epsilon, kernels, error);
        d->exponent = r->exponent[0];
    }
    for (int c = 0; c < r->channels && status == NACRE_OK; c++) {
        d->scales[c] = malloc(area * sizeof *d->scales[c]);
        if (!d->scales[c]) {
            status = nacre_fail_memory(error, "the weights");
            break;
        }
        /* Entry i and its counterpart have one weight. */
        for (size_t i = 0; i < area; i++) {
            const float *kernel = kernels + (size_t)c * area;
            d->scales[c][i] =
                (float)(by_kernel ? ldexp(2 / ((double)kernel[i] + (double)kernel[area - 1 - i]),
                                          r->exponent[c] - d->exponent)
                                  : ldexp(1, 2 * r->exponent[c] - exponent));
        }
    }
out:
    free(ids);
    free(kernels);
    return status;
}

struct terms_pair terms_data_pair(const struct terms_data *d, int channel, int x, int y, int u,
                                  int v)
{
    const struct responses *r = d->responses;
    int half = r->window / 2, end = r->window - 1, xo = x + u - half, yo = y + v - half;
    size_t here = (size_t)y * (size_t)r->width + (size_t)x;
    size_t there = (size_t)yo * (size_t)r->width + (size_t)xo;
    double gain = d->gain ? (double)d->gain[there] / (double)d->gain[here] : 1;
    return (struct terms_pair){gain * (double)responses_value(r, channel, x, y, u, v),
                               (double)responses_value(r, channel, xo, yo, end - u, end - v) / gain,
                               (double)d->weights[here], (double)d->weights[there]};
}

/* What is fitted in the place of one entry. */
static double merge(const struct terms_data *d, struct terms_pair p, bool transposed)
{
    if (d->options.reciprocity == TERMS_ONE_WAY) {
        return transposed ? p.back : p.forth;
    }
    if (isnan(p.forth) || isnan(p.back)) {
        return isnan(p.forth) ? p.back : p.forth;
    }
    double weight = p.weight_forth + p.weight_back;
    return weight > 0 ? (p.weight_forth * p.forth + p.weight_back * p.back) / weight : 0;
}

/* What the objective keeps however good the model is. */
static double miss_of(const struct terms_data *d, struct terms_pair p)
{
    double weight = p.weight_forth + p.weight_back;
    if (d->options.reciprocity == TERMS_ONE_WAY || isnan(p.forth) || isnan(p.back) ||
        !(weight > 0)) {
        return 0;
    }
    return p.weight_forth * p.weight_back / weight * (p.forth - p.back) * (p.forth - p.back);
}

/* One point's response, [channels][K][K], as it is fitted. Adds its part of the channels' constants. */
static void merge_response(const struct terms_data *d, int x, int y, bool transposed,
                           float *response, double *constants)
{
    const struct responses *r = d->responses;
    int half = r->window / 2;
    for (size_t i = 0; i < area_of(r) * (size_t)r->channels; i++) {
        int c = (int)(i / area_of(r)), at = (int)(i % area_of(r));
        int u = at % r->window, v = at / r->window, xo = x + u - half, yo = y + v - half;
        response[i] = 0;
        if (xo < 0 || xo >= r->width || yo < 0 || yo >= r->height || (u == half && v == half)) {
            continue;
        }
        struct terms_pair p = terms_data_pair(d, c, x, y, u, v);
        response[i] = (float)merge(d, p, transposed);
        constants[c] += (double)d->scales[c][at] * miss_of(d, p) / 4; /* each pair is met twice */
    }
}

static int merge_all(struct terms_data *d, int copy, struct nacre_error *error)
{
    const struct responses *r = d->responses;
    const struct nacre_scan_info info = {.width = r->width,
                                         .height = r->height,
                                         .window = r->window,
                                         .channels = r->channels,
                                         .pixel = NACRE_HALF,
                                         .pitch_mm = 1};
    size_t needed = responses_bytes(&info, r->lanes, true), available = responses_free_bytes();
    double *constants = calloc((size_t)r->height * RESPONSES_CHANNELS, sizeof *constants);
    bool failed = false;
    if (needed > available || !constants) {
        free(constants);
        return nacre_fail(error,
                          "the responses as a kernel per term wants them take %.1f GiB of memory "
                          "more and %.1f GiB are free; use --model clusters or close other "
                          "programs",
                          (double)needed * 0x1p-30, (double)available * 0x1p-30);
    }
    int status = responses_begin(&d->copies[copy], &info, r->lanes, true, error);
    d->copy_count = copy + 1;
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < (status == NACRE_OK ? r->height : 0); y++) {
        float *response = malloc(area_of(r) * (size_t)r->channels * sizeof *response);
        for (int x = 0; x < r->width && response; x++) {
            merge_response(d, x, y, copy == 1, response,
                           constants + (size_t)y * RESPONSES_CHANNELS);
            responses_put(&d->copies[copy], x, y, response);
        }
        if (!response) {
#pragma omp critical(factor_terms)
            failed = true;
        }
        free(response);
    }
    for (int i = 0; i < r->height * RESPONSES_CHANNELS && copy == 0; i++) {
        d->constant[i % RESPONSES_CHANNELS] += constants[i];
    }
    free(constants);
    if (status == NACRE_OK && failed) {
        return nacre_fail_memory(error, "a response");
    }
    if (status == NACRE_OK) {
        responses_scale(&d->copies[copy]);
    }
    return status;
}

/* The copies have powers of two of their own: scales go with them from now on. */
static void adopt_exponents(struct terms_data *d)
{
    const struct responses *r = d->responses;
    for (int c = 0; c < r->channels; c++) {
        for (size_t i = 0; i < area_of(r); i++) {
            d->scales[c][i] = ldexpf(d->scales[c][i], 2 * d->copies[0].exponent[c]);
        }
    }
}

/* Adds what entries so far from the centre as their ring weigh, of one point's response. */
static void add_rings(const struct terms_data *d, int channel, int x, int y, float *window,
                      double *rings)
{
    const struct responses *r = d->responses;
    int half = r->window / 2;
    double weight = (double)d->weights[y * r->width + x];
    responses_get(r, channel, x, y, window);
    for (int i = 0; i < r->window * r->window; i++) {
        int across = abs(i % r->window - half), down = abs(i / r->window - half);
        if (!isnan(window[i])) {
            rings[across > down ? across : down] +=
                weight * (double)d->scales[channel][i] * (double)window[i] * (double)window[i];
        }
    }
}

/* The fewest rows and columns around the centre beyond which there is but a small share of the weighted squares, if they
 * save enough. A few points tell. */
static int find_reach(const struct terms_data *d, float *window, double *rings)
{
    const struct responses *r = d->responses;
    int half = r->window / 2, stride = (int)ceil(sqrt((double)points_of(r) / REACH_POINTS));
    double all = 0, beyond = 0;
    for (int i = 0; i < r->width * r->height; i++) {
        int x = i % r->width, y = i / r->width;
        for (int c = 0; x % stride == 0 && y % stride == 0 && c < r->channels; c++) {
            add_rings(d, c, x, y, window, rings);
        }
    }
    for (int k = 1; k <= half; k++) {
        all += rings[k];
    }
    int reach = half;
    for (; reach > LEAST_REACH; reach--) {
        beyond += rings[reach];
        if (beyond > MOST_BEYOND * all) {
            break;
        }
    }
    int side = 2 * reach + 1;
    return REACH_SAVES * side * side <= r->window * r->window ? reach : half;
}

int terms_data_begin(struct terms_data *d, const struct responses *r,
                     const struct terms_options *options, double epsilon, struct nacre_error *error)
{
    *d = (struct terms_data){.responses = r, .options = *options};
    float *window = malloc(area_of(r) * sizeof *window);
    double *squares = malloc(points_of(r) * sizeof *squares);
    double *rings = calloc((size_t)r->window, sizeof *rings);
    int exponent = 0;
    d->weights = malloc(points_of(r) * sizeof *d->weights);
    int status = grid_begin(&d->grid, r->window, options->full, error);
    if (!window || !squares || !rings || !d->weights) {
        status = nacre_fail_memory(error, "the weights");
        goto out;
    }
    for (size_t i = 0; i < points_of(r); i++) {
        d->weights[i] = 1;
    }
    if (status == NACRE_OK && options->weight == TERMS_WEIGHT_RESPONSE) {
        exponent = weigh_by_response(d, squares, window);
    }
    if (status == NACRE_OK) {
        status = scale_entries(d, exponent, epsilon, error);
    }
    if (status == NACRE_OK) {
        d->reach = find_reach(d, window, rings);
        status = terms_gain_find(d, error);
    }
    if (status == NACRE_OK) {
        status = merge_all(d, 0, error);
    }
    if (status == NACRE_OK && d->options.reciprocity == TERMS_ONE_WAY) {
        status = merge_all(d, 1, error);
    }
    if (status == NACRE_OK) {
        adopt_exponents(d);
    }
out:
    free(window);
    free(squares);
    free(rings);
    return status;
}

void terms_data_finish(struct terms_data *d)
{
    for (int i = 0; i < d->copy_count; i++) {
        responses_finish(&d->copies[i]);
    }
    for (int c = 0; c < RESPONSES_CHANNELS; c++) {
        free(d->scales[c]);
    }
    free(d->grid.radius);
    free(d->grid.first);
    free(d->grid.share);
    free(d->weights);
    free(d->gain);
    *d = (struct terms_data){0};
}
