/* Smooth gains of projector and camera from what reciprocal pairs differ by.
 *
 * With R(x_i, x_o) = gain(x_i) / gain(x_o) S(x_i, x_o), S reciprocal, a pair's difference over its sum is
 * tanh(l(x_i) - l(x_o)), l = log gain. l is a sum of cosines over the sample, fitted by weighted least squares; what is not
 * linear in it takes a second and a third round. */
#include "factor/terms_gain.h"

#include <math.h>
#include <stdlib.h>

enum {
    WAVES = 5,                   /* along each side, the constant included */
    COSINES = WAVES * WAVES - 1, /* a constant changes nothing */
    REACH = 4,                   /* pairs no farther apart than this hold most of the light */
    ROUNDS = 3,
    PAIRS_WANTED = 400000,
};

/* A gain is taken for one when its cosines explain this much more than they would of noise, and when it makes pairs differ
 * by this share; what is then left beyond noise may be so much. */
#define SIGNIFICANT 20
#define LEAST_SHARE 1e-3
#define MOST_LEFT   0.05

/* What pairs say, all weighted: normal equations of the cosines, sums of squares, and of neighbouring pairs' products. */
struct equations {
    double matrix[COSINES][COSINES], side[COSINES];
    double differences, sums, products;
    size_t pairs;
};

/* All cosines at a point. */
static void cosines_at(const struct responses *r, int x, int y, double *values)
{
    double across[WAVES], down[WAVES];
    for (int k = 0; k < WAVES; k++) {
        across[k] = cos(M_PI * k * (x + 0.5) / r->width);
        down[k] = cos(M_PI * k * (y + 0.5) / r->height);
    }
    for (int k = 0; k < COSINES; k++) {
        values[k] = across[(k + 1) % WAVES] * down[(k + 1) / WAVES];
    }
}

static bool read_pair(const struct terms_data *d, int channel, int x, int y, int dx, int dy,
                      double *difference, double *sum)
{
    const struct responses *r = d->responses;
    int half = r->window / 2, xo = x + dx, yo = y + dy;
    if (xo < 0 || xo >= r->width || yo < 0 || yo >= r->height || abs(dx) > half || dy > half) {
        return false;
    }
    double gain =
        d->gain ? (double)d->gain[yo * r->width + xo] / (double)d->gain[y * r->width + x] : 1;
    double forth = gain * (double)responses_value(r, channel, x, y, half + dx, half + dy);
    double back = (double)responses_value(r, channel, xo, yo, half - dx, half - dy) / gain;
    *difference = forth - back;
    *sum = forth + back;
    return !isnan(*sum);
}

static void add_pair(const struct terms_data *d, int channel, int x, int y, int dx, int dy,
                     struct equations *q)
{
    const struct responses *r = d->responses;
    double difference = 0, sum = 0, next = 0, unused = 0;
    double slope[COSINES], here_values[COSINES], there_values[COSINES];
    if (!read_pair(d, channel, x, y, dx, dy, &difference, &sum)) {
        return;
    }
    int here = y * r->width + x, there = (y + dy) * r->width + x + dx;
    double weight = ((double)d->weights[here] + (double)d->weights[there]) *
                    (double)d->scales[channel][(size_t)(r->window / 2 + dy) * (size_t)r->window +
                                               (size_t)(r->window / 2 + dx)];
    cosines_at(r, x, y, here_values);
    cosines_at(r, x + dx, y + dy, there_values);
    for (int k = 0; k < COSINES; k++) {
        slope[k] = sum * (here_values[k] - there_values[k]);
    }
    for (int k = 0; k < COSINES; k++) {
        q->side[k] += weight * slope[k] * difference;
        for (int j = 0; j <= k; j++) {
            q->matrix[k][j] += weight * slope[k] * slope[j];
        }
    }
    q->differences += weight * difference * difference;
    q->sums += weight * sum * sum;
    if (read_pair(d, channel, x, y, dx + 1, dy, &next, &unused)) {
        q->products += weight * difference * next;
    }
    q->pairs++;
}

static void gather(const struct terms_data *d, struct equations *q)
{
    const struct responses *r = d->responses;
    double all = (double)r->width * r->height * 2 * REACH * (REACH + 1) * r->channels;
    int stride = (int)ceil(sqrt(fmax(1, all / PAIRS_WANTED)));
    *q = (struct equations){0};
    for (int y = stride / 2; y < r->height; y += stride) {
        for (int x = stride / 2; x < r->width; x += stride) {
            for (int i = 0; i < r->channels * (REACH + 1) * (2 * REACH + 1); i++) {
                int c = i / ((REACH + 1) * (2 * REACH + 1));
                int dx = i % (2 * REACH + 1) - REACH, dy = i / (2 * REACH + 1) % (REACH + 1);
                if (dy > 0 || dx > 0) {
                    add_pair(d, c, x, y, dx, dy, q);
                }
            }
        }
    }
}

/* Cholesky's method with a little of the diagonal added, for cosines that the sample is too small to tell apart. */
static void solve(struct equations *q, double *l)
{
    double trace = 0;
    for (int k = 0; k < COSINES; k++) {
        trace += q->matrix[k][k];
    }
    for (int k = 0; k < COSINES; k++) {
        q->matrix[k][k] += 1e-9 * trace + 1e-300;
        for (int j = 0; j <= k; j++) {
            double sum = q->matrix[k][j];
            for (int i = 0; i < j; i++) {
                sum -= q->matrix[k][i] * q->matrix[j][i];
            }
            q->matrix[k][j] = j == k ? sqrt(fmax(sum, 1e-300)) : sum / q->matrix[j][j];
        }
    }
    for (int k = 0; k < COSINES; k++) {
        l[k] = q->side[k];
        for (int i = 0; i < k; i++) {
            l[k] -= q->matrix[k][i] * l[i];
        }
        l[k] /= q->matrix[k][k];
    }
    for (int k = COSINES - 1; k >= 0; k--) {
        for (int i = k + 1; i < COSINES; i++) {
            l[k] -= q->matrix[i][k] * l[i];
        }
        l[k] /= q->matrix[k][k];
    }
}

/* The gain times exp of the sum of cosines. */
static void apply(struct terms_data *d, const double *l)
{
    const struct responses *r = d->responses;
    for (int i = 0; i < r->width * r->height; i++) {
        double sum = 0, values[COSINES];
        cosines_at(r, i % r->width, i / r->width, values);
        for (int k = 0; k < COSINES; k++) {
            sum += l[k] * values[k];
        }
        d->gain[i] *= (float)exp(sum);
    }
}

/* Neighbouring pairs' noise is independent: what they have in common is not noise. As a share of the pairs' means. */
static double beyond_noise(const struct equations *q)
{
    return q->sums > 0 ? sqrt(fmax(0, q->products) / q->sums) * 2 : 0;
}

int terms_gain_find(struct terms_data *d, struct nacre_error *error)
{
    enum terms_reciprocity wanted = d->options.reciprocity;
    size_t points = (size_t)d->responses->width * (size_t)d->responses->height;
    struct equations q;
    double before = 0, l[COSINES];
    if (wanted == TERMS_RECIPROCAL) {
        return NACRE_OK;
    }
    d->gain = malloc(points * sizeof *d->gain);
    if (!d->gain) {
        return nacre_fail_memory(error, "the gain");
    }
    for (size_t i = 0; i < points; i++) {
        d->gain[i] = 1;
    }
    for (int round = 0; round < ROUNDS && wanted != TERMS_ONE_WAY; round++) {
        gather(d, &q);
        before = round == 0 ? q.differences : before;
        d->asymmetry = round == 0 ? beyond_noise(&q) : d->asymmetry;
        solve(&q, l);
        apply(d, l);
    }
    gather(d, &q);
    d->asymmetry_left = beyond_noise(&q);
    double explained = before - q.differences, noise = q.differences;
    bool gained = q.pairs > 2 * COSINES &&
                  explained / COSINES > SIGNIFICANT * noise / (double)(q.pairs - COSINES) &&
                  explained > LEAST_SHARE * LEAST_SHARE / 4 * q.sums;
    if (wanted == TERMS_AUTO) {
        d->options.reciprocity = d->asymmetry_left > MOST_LEFT ? TERMS_ONE_WAY
                                 : gained                      ? TERMS_GAINED
                                                               : TERMS_RECIPROCAL;
    }
    if (d->options.reciprocity != TERMS_GAINED) {
        free(d->gain);
        d->gain = NULL;
    }
    return NACRE_OK;
}
