/* Fitting the paper's model with soft weights in double precision. */
#include "soft.h"

#include "../timing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Distances are summed in so many parts, whatever the threads, and so many points at a time. */
enum { PARTS = 16, PIECE = 512 };

/* The share of its own cluster that each point starts with. */
static const double own_share = 0.9;

/* The numbers: F, H [channels][terms][points], w [clusters][points], g [channels][clusters][K K]. */
struct task {
    const struct entries *entries;
    size_t points, area, terms, clusters, h, w, g, count;
};

/* A piece of the plane at one distance. */
struct piece {
    int channel, distance;
    size_t first, count;
    ptrdiff_t shift;
    const double *targets, *weights;
    double product[PIECE], kernel[PIECE], error[PIECE];
};

static struct task task_of(const struct entries *e, const struct nacre_material *m)
{
    struct task t = {.entries = e,
                     .points = (size_t)e->width * (size_t)e->height,
                     .area = (size_t)e->window * (size_t)e->window,
                     .terms = (size_t)m->terms,
                     .clusters = (size_t)m->clusters};
    size_t channels = (size_t)e->channels;
    t.h = channels * t.terms * t.points;
    t.w = 2 * t.h;
    t.g = t.w + t.clusters * t.points;
    t.count = t.g + channels * t.clusters * t.area;
    return t;
}

/* Products, mixed kernels, weighted errors and half the sum of squares. */
static double model_piece(const struct task *t, const double *x, struct piece *p)
{
    double value = 0, *product = p->product, *kernel = p->kernel;
    size_t c = (size_t)p->channel, count = p->count;
    memset(product, 0, sizeof p->product);
    memset(kernel, 0, sizeof p->kernel);
    for (size_t n = 0; n < t->terms; n++) {
        const double *f = x + (c * t->terms + n) * t->points + p->first;
        const double *h = f + t->h + p->shift;
#pragma omp simd
        for (size_t i = 0; i < count; i++) {
            product[i] += f[i] * h[i];
        }
    }
    for (size_t j = 0; j < t->clusters; j++) {
        double g = x[t->g + (c * t->clusters + j) * t->area + (size_t)p->distance];
        const double *w = x + t->w + j * t->points + p->first;
#pragma omp simd
        for (size_t i = 0; i < count; i++) {
            kernel[i] += w[i] * g;
        }
    }
#pragma omp simd reduction(+ : value)
    for (size_t i = 0; i < count; i++) {
        double miss = product[i] * kernel[i] - p->targets[i];
        value += p->weights[i] * miss * miss / 2;
        p->error[i] = p->weights[i] * miss;
    }
    return value;
}

static void add_factors(const struct task *t, const double *x, const struct piece *p,
                        double *gradient, double *diagonal)
{
    double by[PIECE];
    size_t count = p->count;
    for (size_t i = 0; i < count; i++) {
        by[i] = gradient ? p->error[i] * p->kernel[i] : p->weights[i] * p->kernel[i] * p->kernel[i];
    }
    for (size_t n = 0; n < t->terms; n++) {
        size_t at = ((size_t)p->channel * t->terms + n) * t->points + p->first;
        size_t to = (size_t)((ptrdiff_t)(t->h + at) + p->shift);
        const double *f = x + at, *h = x + to;
        double *df = (gradient ? gradient : diagonal) + at;
        double *dh = (gradient ? gradient : diagonal) + to;
#pragma omp simd
        for (size_t i = 0; i < count; i++) {
            df[i] += by[i] * (gradient ? h[i] : h[i] * h[i]);
            dh[i] += by[i] * (gradient ? f[i] : f[i] * f[i]);
        }
    }
}

static void add_kernels(const struct task *t, const double *x, const struct piece *p,
                        double *gradient, double *diagonal)
{
    double by[PIECE], *to = gradient ? gradient : diagonal;
    size_t count = p->count;
    for (size_t i = 0; i < count; i++) {
        by[i] =
            gradient ? p->error[i] * p->product[i] : p->weights[i] * p->product[i] * p->product[i];
    }
    for (size_t j = 0; j < t->clusters; j++) {
        size_t at = t->w + j * t->points + p->first;
        size_t number =
            t->g + ((size_t)p->channel * t->clusters + j) * t->area + (size_t)p->distance;
        double g = gradient ? x[number] : x[number] * x[number], sum = 0, *dw = to + at;
        const double *w = x + at;
#pragma omp simd reduction(+ : sum)
        for (size_t i = 0; i < count; i++) {
            dw[i] += by[i] * g;
            sum += by[i] * (gradient ? w[i] : w[i] * w[i]);
        }
        to[number] += sum;
    }
}

static double sum_part(const struct task *t, const double *x, int part, double *gradient,
                       double *diagonal)
{
    const struct entries *e = t->entries;
    double value = 0;
    for (int n = part; n < e->channels * e->count; n += PARTS) {
        struct span span = entries_span(e, n / e->count, n % e->count);
        struct piece p = {.channel = n / e->count, .distance = n % e->count, .shift = span.shift};
        for (p.first = span.first; p.first < span.end; p.first += PIECE) {
            p.count = span.end - p.first < PIECE ? span.end - p.first : PIECE;
            p.targets = e->targets + span.start + p.first;
            p.weights = e->weights + span.start + p.first;
            value += model_piece(t, x, &p);
            if (gradient) {
                add_factors(t, x, &p, gradient, NULL);
                add_kernels(t, x, &p, gradient, NULL);
            }
            if (diagonal) {
                add_factors(t, x, &p, NULL, diagonal);
                add_kernels(t, x, &p, NULL, diagonal);
            }
        }
    }
    return value;
}

static double evaluate(void *data, const double *x, double *gradient, double *diagonal)
{
    const struct task *t = data;
    double *gradients[PARTS] = {NULL}, *diagonals[PARTS] = {NULL}, values[PARTS];
    double value = t->entries->rest;
#pragma omp parallel for schedule(dynamic)
    for (int part = 0; part < PARTS; part++) {
        gradients[part] = gradient ? allocate(t->count * sizeof(double)) : NULL;
        diagonals[part] = diagonal ? allocate(t->count * sizeof(double)) : NULL;
        values[part] = sum_part(t, x, part, gradients[part], diagonals[part]);
    }
    for (size_t i = 0; i < t->count; i++) {
        double g = 0, d = 0;
        for (int part = 0; part < PARTS; part++) {
            g += gradient ? gradients[part][i] : 0;
            d += diagonal ? diagonals[part][i] : 0;
        }
        if (gradient) {
            gradient[i] = g;
        }
        if (diagonal) {
            diagonal[i] = d;
        }
    }
    for (int part = 0; part < PARTS; part++) {
        value += values[part];
        free(gradients[part]);
        free(diagonals[part]);
    }
    return value;
}

/* Where numbers of a material stand: F of term n in channel c, and kernel j. */
static size_t plane_at(const struct nacre_material *m, size_t c, size_t n, size_t points)
{
    return (n * (size_t)m->channels + c) * points;
}

static void copy_factors(const struct task *t, struct nacre_material *m, double *x, bool out)
{
    for (size_t c = 0; c < (size_t)m->channels; c++) {
        for (size_t n = 0; n < t->terms; n++) {
            size_t at = (c * t->terms + n) * t->points, to = plane_at(m, c, n, t->points);
            for (size_t i = 0; i < t->points; i++) {
                if (out) {
                    m->f[to + i] = (float)x[at + i];
                    m->h[to + i] = (float)x[t->h + at + i];
                } else {
                    x[at + i] = (double)m->f[to + i];
                    x[t->h + at + i] = (double)m->h[to + i];
                }
            }
        }
        for (size_t j = 0; j < t->clusters; j++) {
            for (size_t d = 0; d < t->area; d++) {
                size_t at = t->g + (c * t->clusters + j) * t->area + d;
                float *g = &m->kernels[(j * (size_t)m->channels + c) * t->area + d];
                if (out) {
                    *g = (float)x[at];
                } else {
                    x[at] = (double)*g;
                }
            }
        }
    }
}

/* Weights that sum to 1; F takes what they summed to. */
static void normalise(const struct task *t, int channels, double *x)
{
    for (size_t i = 0; i < t->points; i++) {
        double sum = 0;
        for (size_t j = 0; j < t->clusters; j++) {
            sum += x[t->w + j * t->points + i];
        }
        for (size_t j = 0; j < t->clusters; j++) {
            double *w = &x[t->w + j * t->points + i];
            *w = sum > 0 ? *w / sum : j == 0;
        }
        for (size_t n = 0; n < (size_t)channels * t->terms; n++) {
            x[n * t->points + i] *= sum;
        }
    }
}

int soft_fit(const struct entries *e, const struct nacre_material *hard,
             const struct minimise_limits *limits, struct nacre_material *soft)
{
    struct nacre_error error = {0};
    struct task t = task_of(e, hard);
    struct function function = {t.count, false, &t, evaluate};
    double *x = allocate(t.count * sizeof *x);
    int iterations = 0;
    struct nacre_material start = *hard; /* its planes are read alone */
    copy_factors(&t, &start, x, false);
    for (size_t i = 0; i < t.points; i++) {
        for (size_t j = 0; j < t.clusters; j++) {
            x[t.w + j * t.points + i] =
                hard->ids[i] == j ? own_share : (1 - own_share) / (double)t.clusters;
        }
    }
    (void)minimise(&function, limits, x, &iterations);
    normalise(&t, e->channels, x);
    *soft = (struct nacre_material){.width = hard->width,
                                    .height = hard->height,
                                    .channels = hard->channels,
                                    .factor_channels = hard->channels,
                                    .window = hard->window,
                                    .terms = hard->terms,
                                    .clusters = hard->clusters,
                                    .mixed = hard->clusters,
                                    .layout = NACRE_KERNEL_SINGLE,
                                    .pixel = NACRE_FLOAT,
                                    .pitch_mm = hard->pitch_mm};
    if (nacre_material_allocate(soft, true, false, &error) != NACRE_OK) {
        fail(error.text);
    }
    copy_factors(&t, soft, x, true);
    for (size_t j = 0; j < t.clusters; j++) {
        for (size_t i = 0; i < t.points; i++) {
            soft->ids[j * t.points + i] = (uint32_t)j;
            soft->weights[j * t.points + i] = (float)x[t.w + j * t.points + i];
        }
    }
    free(x);
    return iterations;
}
