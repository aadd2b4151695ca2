/* Rounding planes so that what one term loses at a point others make up for. */
#include "factor/terms_round.h"

#include "factor/terms.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Times that the terms of a point are gone through: most points stay as they are from the third on. */
enum { SWEEPS = 4 };

/* What rounding a set's planes goes by. */
struct rounding {
    const struct terms_data *data;
    const float *other;  /* [terms][points]: planes of the other ends */
    const float *values; /* [terms][points]: before */
    double *kernels;     /* [channels][entries][terms], weighted by the root of the entry's scale */
    int first, channels, terms;
    double top;            /* the highest level */
    const double *largest; /* [terms] */
};

static size_t points_of(const struct terms_data *d)
{
    return (size_t)d->responses->width * (size_t)d->responses->height;
}

/* Kernels entry by entry, of those within reach. */
static int spread_kernels(struct rounding *r, const struct factors *f, struct nacre_error *error)
{
    const struct terms_grid *g = &r->data->grid;
    size_t area = (size_t)g->window * (size_t)g->window, terms = (size_t)r->terms;
    float *window = malloc(area * sizeof *window);
    r->kernels = malloc((size_t)r->channels * area * terms * sizeof *r->kernels);
    if (!window || !r->kernels) {
        free(window);
        return nacre_fail_memory(error, "rounding");
    }
    for (size_t i = 0; i < (size_t)r->channels * terms; i++) {
        size_t c = i / terms, t = i % terms;
        const float *numbers = f->kernels[(size_t)r->first + c] + t * (size_t)g->count;
        terms_grid_spread(g, numbers, window);
        for (size_t at = 0; at < area; at++) {
            r->kernels[(c * area + at) * terms + t] =
                (double)window[at] * sqrt((double)r->data->scales[(size_t)r->first + c][at]);
        }
    }
    free(window);
    return NACRE_OK;
}

/* A point's normal matrix, by entries within reach. mirrored: for the planes that light leaves by. */
static void make_matrix(const struct rounding *r, int x, int y, bool mirrored, double *matrix)
{
    const struct terms_data *d = r->data;
    int window = d->grid.window, half = window / 2, area = window * window;
    int width = d->responses->width, height = d->responses->height;
    size_t terms = (size_t)r->terms, points = points_of(d);
    bool one_way = d->options.reciprocity == TERMS_ONE_WAY;
    double own = (double)d->weights[y * width + x];
    memset(matrix, 0, terms * terms * sizeof *matrix);
    for (int dy = -d->reach; dy <= d->reach; dy++) {
        for (int dx = -d->reach; dx <= d->reach; dx++) {
            int xo = x + dx, yo = y + dy, at = (dy + half) * window + dx + half;
            if (xo < 0 || xo >= width || yo < 0 || yo >= height || (dx == 0 && dy == 0)) {
                continue;
            }
            size_t there = (size_t)yo * (size_t)width + (size_t)xo;
            double far = (double)d->weights[there];
            double weight = !one_way ? own + far : mirrored ? far : own;
            for (int c = 0; c < r->channels; c++) {
                const double *kernel =
                    r->kernels + (size_t)(c * area + (mirrored ? area - 1 - at : at)) * terms;
                double light[TERMS_MOST];
                for (size_t t = 0; t < terms; t++) {
                    light[t] = kernel[t] * (double)r->other[t * points + there];
                }
                for (size_t t = 0; t < terms; t++) {
                    double *row = matrix + t * terms, own_light = weight * light[t];
#pragma omp simd
                    for (size_t s = 0; s < terms; s++) {
                        row[s] += own_light * light[s];
                    }
                }
            }
        }
    }
}

static double value_of(const struct rounding *r, size_t t, double level)
{
    return r->largest[t] * (level / r->top) * (level / r->top);
}

static double nearest_level(const struct rounding *r, size_t t, double value)
{
    return value > 0 ? fmin(r->top, rint(r->top * sqrt(value / r->largest[t]))) : 0;
}

/* Of the two levels around a value, the one whose value is nearer. */
static double best_level(const struct rounding *r, size_t t, double value)
{
    double near = nearest_level(r, t, value), best = near;
    for (int step = -1; step <= 1; step += 2) {
        double level = fmin(r->top, fmax(0, near + step));
        if (fabs(value_of(r, t, level) - value) < fabs(value_of(r, t, best) - value)) {
            best = level;
        }
    }
    return best;
}

/* Levels of one point in place of planes' values. */
static void round_point(const struct rounding *r, size_t point, const double *matrix, float *planes)
{
    size_t terms = (size_t)r->terms, points = points_of(r->data);
    double change[TERMS_MOST], levels[TERMS_MOST];
    for (size_t t = 0; t < terms; t++) {
        double value = (double)r->values[t * points + point];
        levels[t] = nearest_level(r, t, value);
        change[t] = value_of(r, t, levels[t]) - value;
    }
    for (size_t i = 0; i < SWEEPS * terms; i++) {
        size_t t = i % terms;
        double value = (double)r->values[t * points + point], pull = 0;
        double own = matrix[t * terms + t];
        if (!(value > 0) || !(own > 0)) {
            continue;
        }
        for (size_t s = 0; s < terms; s++) {
            pull += s == t ? 0 : matrix[t * terms + s] * change[s];
        }
        levels[t] = best_level(r, t, fmax(0, value - pull / own));
        change[t] = value_of(r, t, levels[t]) - value;
    }
    for (size_t t = 0; t < terms; t++) {
        planes[t * points + point] = (float)levels[t];
    }
}

/* All points; planes hold the values, and then the levels. */
static int round_all(const struct rounding *r, bool mirrored, float *planes,
                     struct nacre_error *error)
{
    const struct responses *of = r->data->responses;
    size_t terms = (size_t)r->terms;
    bool failed = false;
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < of->height; y++) {
        double *matrix = calloc(terms * terms, sizeof *matrix);
        if (!matrix) {
#pragma omp critical(factor_round)
            failed = true;
            continue;
        }
        for (int x = 0; x < of->width; x++) {
            size_t point = (size_t)y * (size_t)of->width + (size_t)x;
            make_matrix(r, x, y, mirrored, matrix);
            round_point(r, point, matrix, planes);
        }
        free(matrix);
    }
    return failed ? nacre_fail_memory(error, "rounding") : NACRE_OK;
}

int terms_round(const struct terms_data *d, const struct factors *f, int set, int side, int bits,
                float *planes, double *largest, struct nacre_error *error)
{
    size_t points = points_of(d), count = (size_t)f->terms * points;
    const float *other = side == 0 && f->h[set] ? f->h[set] : f->f[set];
    float *values = malloc(count * sizeof *values);
    struct rounding r = {.data = d,
                         .other = other,
                         .values = values,
                         .first = set,
                         .channels = terms_data_sets(d) > 1 ? 1 : f->channels,
                         .terms = f->terms,
                         .top = ldexp(1, bits) - 1,
                         .largest = largest};
    int status = NACRE_OK;
    if (!values) {
        return nacre_fail_memory(error, "rounding");
    }
    memcpy(values, planes, count * sizeof *values);
    for (size_t i = 0; i < count; i++) {
        double *most = &largest[i / points], value = (double)values[i];
        *most = i % points == 0 ? value : fmax(*most, value);
    }
    status = spread_kernels(&r, f, error);
    if (status == NACRE_OK) {
        status = round_all(&r, side == 1, planes, error);
    }
    free(values);
    free(r.kernels);
    return status;
}
