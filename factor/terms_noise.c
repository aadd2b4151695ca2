/* What fitting noise is worth: half the difference of a pair is as large as the noise of its mean, which is what is fitted,
 * and holds nothing else; its projection on what a point's values can change is what these would gain by it. */
#include "factor/terms_noise.h"

#include "factor/terms.h"

#include <math.h>
#include <stddef.h>

/* Points that are looked at, about. */
#define POINTS 400.0

/* Of the largest of a matrix' diagonal; terms that differ by less at a point are one. */
#define RIDGE 1e-6

/* The normal equations of one point's values above 0: 0 ones stay there. */
struct equations {
    int count, terms[TERMS_MOST];
    double matrix[TERMS_MOST][TERMS_MOST], right[TERMS_MOST];
};

/* Factored in place, half of b^T A^-1 b. */
static double solve(struct equations *e)
{
    double largest = 0, gain = 0;
    for (int i = 0; i < e->count; i++) {
        largest = fmax(largest, e->matrix[i][i]);
    }
    for (int i = 0; i < e->count && largest > 0; i++) {
        double right = e->right[i], square = e->matrix[i][i] + RIDGE * largest;
        for (int j = 0; j < i; j++) {
            double sum = e->matrix[i][j];
            for (int k = 0; k < j; k++) {
                sum -= e->matrix[i][k] * e->matrix[j][k];
            }
            e->matrix[i][j] = sum / e->matrix[j][j];
            square -= e->matrix[i][j] * e->matrix[i][j];
            right -= e->matrix[i][j] * e->right[j];
        }
        e->matrix[i][i] = sqrt(fmax(square, RIDGE * largest));
        e->right[i] = right / e->matrix[i][i];
        gain += e->right[i] * e->right[i] / 2;
    }
    return gain;
}

/* What a change of each value does to one entry, weighted, and the entry's noise. */
static void add_entry(struct equations *e, const double *change, double weight, double noise)
{
    for (int i = 0; i < e->count; i++) {
        for (int j = 0; j <= i; j++) {
            e->matrix[i][j] += weight * change[i] * change[j];
        }
        e->right[i] += weight * change[i] * noise;
    }
}

/* Entry (u, v) of (x, y), which does not reach beyond the sample. */
static void add_pair(const struct terms_data *d, const struct factors *f, int channel, int x, int y,
                     int u, int v, struct equations *e)
{
    const struct terms_grid *g = &d->grid;
    int half = g->window / 2, at = v * g->window + u;
    size_t points = (size_t)f->width * (size_t)f->height;
    size_t there = (size_t)(y + v - half) * (size_t)f->width + (size_t)(x + u - half);
    const float *planes = f->f[d->options.separate ? channel : 0];
    struct terms_pair p = terms_data_pair(d, channel, x, y, u, v);
    double change[TERMS_MOST], share = g->share[at];
    if (isnan(p.forth) || isnan(p.back)) {
        return;
    }
    for (int i = 0; i < e->count; i++) {
        const float *numbers =
            f->kernels[channel] + (size_t)e->terms[i] * (size_t)g->count + g->first[at];
        double kernel = (double)numbers[0];
        if (share > 0) {
            kernel += share * ((double)numbers[1] - kernel);
        }
        change[i] = kernel * (double)planes[(size_t)e->terms[i] * points + there];
    }
    add_entry(e, change, (p.weight_forth + p.weight_back) * (double)d->scales[channel][at],
              ldexp((p.forth - p.back) / 2, -d->copies[0].exponent[channel]));
}

/* What one point's values would gain, of one set of planes. */
static double gain_at(const struct terms_data *d, const struct factors *f, int set, int x, int y)
{
    struct equations e = {0};
    int half = d->grid.window / 2, channels = terms_data_sets(d) > 1 ? 1 : f->channels;
    size_t points = (size_t)f->width * (size_t)f->height;
    size_t here = (size_t)y * (size_t)f->width + (size_t)x;
    for (int t = 0; t < f->terms; t++) {
        if (f->f[set][(size_t)t * points + here] > 0) {
            e.terms[e.count++] = t;
        }
    }
    for (int v = 0; v < d->grid.window; v++) {
        for (int u = 0; u < d->grid.window; u++) {
            int xo = x + u - half, yo = y + v - half;
            bool centre = u == half && v == half;
            for (int c = set; c < set + channels && !centre; c++) {
                if (xo >= 0 && xo < f->width && yo >= 0 && yo < f->height) {
                    add_pair(d, f, c, x, y, u, v, &e);
                }
            }
        }
    }
    return solve(&e);
}

/* Each entry is in the equations of both its ends and can be fitted once: half of their sum. */
double terms_noise_gain(const struct terms_data *d, const struct factors *f)
{
    int stride = (int)ceil(sqrt((double)f->width * f->height / POINTS));
    double gain = 0;
    size_t looked = 0;
    if (d->options.reciprocity == TERMS_ONE_WAY) {
        return 0;
    }
    for (int y = stride / 2; y < f->height; y += stride) {
        for (int x = stride / 2; x < f->width; x += stride) {
            looked++;
            for (int set = 0; set < terms_data_sets(d); set++) {
                gain += gain_at(d, f, set, x, y);
            }
        }
    }
    double points = (double)f->width * f->height;
    return looked ? ldexp(gain / 2 * points / (double)looked, d->exponent) : 0;
}
