/* Figures of a scan that tell whether it can be factored well. */
#include "factor/quality.h"

#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

/* Entries that are looked at, at most: of whole rows of points, spread over the sample. */
#define ENTRIES 4e6

/* What is worth a warning. A model of a tenth of the responses' bytes errs by about 1 %: what spoils less is no news. */
#define MOST_MISSING     0.01
#define MOST_SATURATED   1e-3
#define MOST_OFFSET      0.25
#define MOST_RIM         0.02
#define MOST_RECIPROCITY 0.05
#define MOST_ROUNDING    0.01

static bool is_inside(const struct responses *r, int x, int y)
{
    return x >= 0 && x < r->width && y >= 0 && y < r->height;
}

/* Every so many rows of points are looked at ... */
static int stride_of(const struct responses *r)
{
    double of_row = (double)r->channels * r->width * r->window * r->window;
    return (int)fmax(1, ceil(of_row * r->height / ENTRIES));
}

/* ... from this one on. */
static int first_of(const struct responses *r)
{
    return (stride_of(r) - 1) / 2 < r->height ? (stride_of(r) - 1) / 2 : 0;
}

/* The largest value of a channel, in scaled units. */
static float largest_of(const struct responses *r, int channel)
{
    int area = r->window * r->window;
    float largest = 0;
    for (int y = first_of(r); y < r->height; y += stride_of(r)) {
        for (int i = 0; i < r->width * area; i++) {
            float value =
                responses_value(r, channel, i / area, y, i % r->window, i / r->window % r->window);
            largest = value > largest ? value : largest; /* passes over NaN */
        }
    }
    return largest;
}

/* Counts and sums over all entries of measured responses, in scaled units. */
struct totals {
    size_t entries, missing, brightest;
    double all, rim;
};

/* One row of a window that lies inside the sample from `first` to `end`. What is cut off by saturation is flat: of entries
 * at the largest value those count that lie beside another. */
static void add_line(const struct responses *r, struct totals *t, const float *line, float largest,
                     int v, int first, int end)
{
    bool rim_row = v == 0 || v == r->window - 1;
    for (int u = first; u < end; u++) {
        t->entries++;
        if (isnan(line[u])) {
            t->missing++;
            continue;
        }
        bool beside =
            (u > first && line[u - 1] == largest) || (u + 1 < end && line[u + 1] == largest);
        t->brightest += largest > 0 && line[u] == largest && beside;
        t->all += (double)line[u];
        t->rim += rim_row || u == 0 || u == r->window - 1 ? (double)line[u] : 0;
    }
}

/* The responses of a row of points; `line`: [K]. */
static void add_row(const struct responses *r, int channel, int y, float largest, float *line,
                    struct totals *t)
{
    int half = r->window / 2;
    for (int x = 0; x < r->width; x++) {
        int first = x < half ? half - x : 0;
        int end = x + half >= r->width ? r->width - x + half : r->window;
        for (int v = 0; v < r->window && r->measured[(size_t)y * (size_t)r->width + (size_t)x];
             v++) {
            if (is_inside(r, x, y + v - half)) {
                responses_get_row(r, channel, x, y, v, line);
                add_line(r, t, line, largest, v, first, end);
            }
        }
    }
}

static int measure_entries(const struct responses *r, struct quality *q, struct nacre_error *error)
{
    struct totals *rows = calloc((size_t)r->height, sizeof *rows), sum = {0};
    float *lines = malloc((size_t)r->height * (size_t)r->window * sizeof *lines);
    double all = 0, rim = 0;
    if (!rows || !lines) {
        free(rows);
        free(lines);
        return nacre_fail_memory(error, "the scan's figures");
    }
    for (int c = 0; c < r->channels; c++) {
        float largest = largest_of(r, c);
#pragma omp parallel for
        for (int y = first_of(r); y < r->height; y += stride_of(r)) {
            rows[y] = (struct totals){0};
            add_row(r, c, y, largest, lines + (size_t)y * (size_t)r->window, &rows[y]);
        }
        for (int y = first_of(r); y < r->height; y += stride_of(r)) {
            sum.entries += rows[y].entries;
            sum.missing += rows[y].missing;
            sum.brightest += rows[y].brightest;
            all += ldexp(rows[y].all, r->exponent[c]);
            rim += ldexp(rows[y].rim, r->exponent[c]);
        }
    }
    free(rows);
    free(lines);
    q->missing = sum.entries ? (double)sum.missing / (double)sum.entries : 0;
    q->saturated = sum.entries ? (double)sum.brightest / (double)sum.entries : 0;
    q->rim = all > 0 ? rim / all : 0;
    return NACRE_OK;
}

/* Of each response whose window lies inside the sample and is measured whole, weighted alike. */
static void sum_responses(const struct responses *r, double *mean, float *window)
{
    int half = r->window / 2, area = r->window * r->window;
    for (int y = half; y + half < r->height; y += stride_of(r)) {
        for (int i = half * r->channels; i < (r->width - half) * r->channels; i++) {
            double sum = 0;
            responses_get(r, i % r->channels, i / r->channels, y, window);
            for (int j = 0; j < area; j++) {
                sum += (double)window[j];
            }
            for (int j = 0; j < area && sum > 0; j++) { /* not where an entry is missing */
                mean[j] += (double)window[j] / sum;
            }
        }
    }
}

static void find_peak(const struct responses *r, const double *mean, struct quality *q)
{
    int half = r->window / 2, area = r->window * r->window;
    double largest = 0, weight = 0;
    for (int i = 0; i < area; i++) {
        largest = fmax(largest, mean[i]);
    }
    for (int i = 0; i < area && largest > 0; i++) {
        int dx = i % r->window - half, dy = i / r->window - half;
        double above = fmax(0, mean[i] - largest / 2);
        weight += above;
        q->peak_x += above * dx;
        q->peak_y += above * dy;
    }
    q->peak_x = weight > 0 ? q->peak_x / weight : 0;
    q->peak_y = weight > 0 ? q->peak_y / weight : 0;
}

static int measure_peak(const struct responses *r, struct quality *q, struct nacre_error *error)
{
    size_t area = (size_t)r->window * (size_t)r->window;
    double *mean = calloc(area, sizeof *mean);
    float *window = malloc(area * sizeof *window);
    int status = NACRE_OK;
    if (mean && window) {
        sum_responses(r, mean, window);
        find_peak(r, mean, q);
    } else {
        status = nacre_fail_memory(error, "the mean response");
    }
    free(mean);
    free(window);
    return status;
}

/* Sums over reciprocal pairs, in the responses' unit: of the squared differences, of the part of them that noise
 * explains, and of the squared entries. */
struct exchange {
    size_t pairs;
    double difference, noise, energy;
    double floor; /* of points, relative */
    size_t points;
};

/* The difference and the mean of a pair; false where it was not measured. */
static bool take_pair(const struct responses *r, int channel, int x, int y, int u, int v,
                      double *difference, double *mean)
{
    int half = r->window / 2, xo = x + u - half, yo = y + v - half, end = r->window - 1;
    if (!is_inside(r, xo, yo)) {
        return false;
    }
    double forth = (double)responses_value(r, channel, x, y, u, v);
    double back = (double)responses_value(r, channel, xo, yo, end - u, end - v);
    *difference = forth - back;
    *mean = (forth + back) / 2;
    return !isnan(*difference);
}

/* A pair that was measured. */
struct pair {
    bool known;
    double difference, mean;
};

/* The square of what noise makes of three pairs side by side. A gain makes differences d in proportion to the means s, by
 * a share d / s that changes evenly from pair to pair; d1/s1 - 2 d2/s2 + d3/s3 is free of it, and is scaled to have the
 * variance of one difference. Written without quotients, as means may be 0. */
static bool tell_noise(const struct pair *p, double *square)
{
    double s1 = p[0].mean, s2 = p[1].mean, s3 = p[2].mean;
    double left = s2 * s3, middle = 2 * s1 * s3, right = s1 * s2;
    double sum = p[0].difference * left - p[1].difference * middle + p[2].difference * right;
    double variance = left * left + middle * middle + right * right;
    *square = sum * sum / variance;
    return p[0].known && p[1].known && p[2].known && variance > 0;
}

/* One row of the window of one point; a row of K pairs in `pairs` as work space. */
static void exchange_row(const struct responses *r, int channel, int x, int y, int v,
                         struct pair *pairs, struct exchange *sums)
{
    double difference = 0, noise = 0, energy = 0, square = 0;
    size_t count = 0, triples = 0;
    for (int u = 0; u < r->window; u++) {
        struct pair *p = &pairs[u];
        *p = (struct pair){0};
        p->known = (u != r->window / 2 || v != r->window / 2) &&
                   take_pair(r, channel, x, y, u, v, &p->difference, &p->mean);
        if (p->known) {
            count++;
            difference += p->difference * p->difference;
            energy += 2 * p->mean * p->mean + p->difference * p->difference / 2;
        }
    }
    for (int u = 0; u + 2 < r->window; u++) {
        if (tell_noise(&pairs[u], &square)) {
            triples++;
            noise += square;
        }
    }
    double scale = ldexp(1, 2 * r->exponent[channel]);
    sums->pairs += count;
    sums->difference += scale * difference;
    sums->energy += scale * energy;
    sums->noise += triples ? scale * noise * (double)count / (double)triples : 0;
}

/* The square of the centre of the response. */
static double centre_of(const struct responses *r, int x, int y)
{
    double sum = 0;
    for (int c = 0; c < r->channels; c++) {
        double value = (double)responses_value(r, c, x, y, r->window / 2, r->window / 2);
        sum += isnan(value) ? 0 : ldexp(value * value, 2 * r->exponent[c]);
    }
    return sum;
}

static void exchange_point(const struct responses *r, int x, int y, struct pair *pairs,
                           struct exchange *sums)
{
    struct exchange own = {0};
    for (int c = 0; c < r->channels; c++) {
        for (int v = 0; v < r->window; v++) {
            exchange_row(r, c, x, y, v, pairs, &own);
        }
    }
    sums->pairs += own.pairs;
    sums->difference += own.difference;
    sums->noise += own.noise;
    sums->energy += own.energy;
    double energy = own.energy / 2 + centre_of(r, x, y);
    if (own.pairs > 0 && energy > 0) {
        sums->points++;
        sums->floor += sqrt(own.noise / 2 / energy);
    }
}

static int measure_pairs(const struct responses *r, struct quality *q, struct nacre_error *error)
{
    struct exchange *rows = calloc((size_t)r->height, sizeof *rows), sum = {0};
    bool failed = false;
    if (!rows) {
        return nacre_fail_memory(error, "the scan's figures");
    }
#pragma omp parallel for schedule(dynamic)
    for (int y = first_of(r); y < r->height; y += stride_of(r)) {
        struct pair *pairs = malloc((size_t)r->window * sizeof *pairs);
        for (int x = 0; x < r->width && pairs; x++) {
            exchange_point(r, x, y, pairs, &rows[y]);
        }
        if (!pairs) {
#pragma omp critical(factor_quality)
            failed = true;
        }
        free(pairs);
    }
    if (failed) {
        free(rows);
        return nacre_fail_memory(error, "the scan's figures");
    }
    for (int y = 0; y < r->height; y++) {
        sum.pairs += rows[y].pairs;
        sum.difference += rows[y].difference;
        sum.noise += rows[y].noise;
        sum.energy += rows[y].energy;
        sum.floor += rows[y].floor;
        sum.points += rows[y].points;
    }
    free(rows);
    q->pairs = sum.energy > 0 ? sum.pairs : 0;
    if (q->pairs > 0) {
        q->noise = sqrt(sum.noise / sum.energy);
        q->reciprocity = sqrt(2 * fmax(0, sum.difference - sum.noise) / sum.energy);
        q->floor = sum.points ? sum.floor / (double)sum.points : 0;
    }
    return NACRE_OK;
}

int quality_measure(const struct responses *r, struct quality *q, struct nacre_error *error)
{
    *q = (struct quality){0};
    int status = measure_entries(r, q, error);
    if (status == NACRE_OK) {
        status = measure_peak(r, q, error);
    }
    return status == NACRE_OK ? measure_pairs(r, q, error) : status;
}

/* Append a warning where `needed`. */
static int warn(bool needed, struct nacre_material *m, struct nacre_error *error,
                const char *format, ...) __attribute__((format(printf, 4, 5)));

static int warn(bool needed, struct nacre_material *m, struct nacre_error *error,
                const char *format, ...)
{
    char text[400];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format,
                    arguments); /* NOLINT(clang-analyzer-valist.Uninitialized) */
    va_end(arguments);
    return needed ? nacre_material_warn(m, text, error) : NACRE_OK;
}

int quality_warn(const struct quality *q, double wanted, struct nacre_material *m,
                 struct nacre_error *error)
{
    double offset = hypot(q->peak_x, q->peak_y);
    int status =
        warn(q->missing > MOST_MISSING, m, error,
             "%.1f %% of the entries of measured responses are missing; the model fills them in",
             100 * q->missing);
    if (status == NACRE_OK) {
        status = warn(q->saturated > MOST_SATURATED, m, error,
                      "%.2g %% of the entries hold the largest value: the scan is saturated there; "
                      "add a shorter exposure to the plan",
                      100 * q->saturated);
    }
    if (status == NACRE_OK) {
        status = warn(offset > MOST_OFFSET, m, error,
                      "responses peak (%+.2f, %+.2f) points off the lit one: camera and projector "
                      "were not aligned well; scan the dots anew",
                      q->peak_x, q->peak_y);
    }
    if (status == NACRE_OK) {
        status = warn(q->rim > MOST_RIM, m, error,
                      "%.1f %% of the light leaves on the rim of the window, and more beyond it: "
                      "the window of %d points is too small",
                      100 * q->rim, m->window);
    }
    if (status == NACRE_OK) {
        status = warn(q->pairs > 0 && q->reciprocity > MOST_RECIPROCITY, m, error,
                      "light from one point to another and back differs by %.1f %% beyond noise: "
                      "gains of projector or camera were left in the scan",
                      100 * q->reciprocity);
    }
    if (status == NACRE_OK) {
        status = warn(q->pairs > 0 && wanted < q->floor, m, error,
                      "the error asked for, %.2g %%, is below the scan's noise of about %.2g %%: a "
                      "model that reaches it has fitted noise",
                      100 * wanted, 100 * q->floor);
    }
    return status;
}

int quality_warn_planes(int bits, double fitted, double rounded, struct nacre_material *m,
                        struct nacre_error *error)
{
    return warn(
        rounded - fitted > MOST_ROUNDING, m, error,
        "planes of %d bits raise the mean error from %.2g %% to %.2g %%: dark points beside "
        "bright ones want finer ones; use --bits 10 or --bits 0",
        bits, 100 * fitted, 100 * rounded);
}
