/* Polar feature vectors of responses. */
#include "factor/falloff.h"

#include <math.h>
#include <stdlib.h>

/* Bilinear value at (x, y) of window[size][size], NaN where a value it needs is. */
static double sample_window(const float *window, int size, double x, double y)
{
    int x0 = (int)floor(x), y0 = (int)floor(y);
    double fx = x - x0, fy = y - y0, sum = 0;
    for (int j = 0; j < 2; j++) {
        for (int i = 0; i < 2; i++) {
            double weight = (i ? fx : 1 - fx) * (j ? fy : 1 - fy);
            if (weight > 1e-9) { /* roundings of cosines reach beyond the rim */
                if (x0 + i < 0 || x0 + i >= size || y0 + j < 0 || y0 + j >= size) {
                    return NAN;
                }
                sum += weight * (double)window[(y0 + j) * size + x0 + i];
            }
        }
    }
    return sum;
}

void features_of_window(const float *window, int size, float *radii)
{
    int half = size / 2;
    for (int r = 0; r <= half; r++) {
        /* About one sample a point along the circle, and all eight main directions. */
        int angles = r == 0 ? 1 : 8 * r;
        double largest = NAN;
        for (int a = 0; a < angles; a++) {
            double angle = 2 * M_PI * a / angles;
            double value =
                sample_window(window, size, half + r * cos(angle), half + r * sin(angle));
            largest = fmax(largest, value); /* the other where one is NaN */
        }
        radii[r] = (float)largest;
    }
}

static void normalise(float *radii, size_t count)
{
    double squares = 0;
    for (size_t i = 0; i < count; i++) {
        squares += isnan(radii[i]) ? 0 : (double)radii[i] * (double)radii[i];
    }
    for (size_t i = 0; i < count && squares > 0; i++) {
        radii[i] = (float)((double)radii[i] / sqrt(squares));
    }
}

/* Replace NaN by the mean over the points of which the entry is known. */
static void complete(struct features *features)
{
    for (size_t i = 0; i < features->length; i++) {
        double sum = 0;
        size_t known = 0;
        for (size_t p = 0; p < features->count; p++) {
            float value = features->values[p * features->length + i];
            if (!isnan(value)) {
                sum += (double)value;
                known++;
            }
        }
        for (size_t p = 0; p < features->count; p++) {
            float *value = &features->values[p * features->length + i];
            if (isnan(*value)) {
                *value = known ? (float)(sum / (double)known) : 0;
            }
        }
    }
}

int features_new(const struct responses *r, struct features *features, struct nacre_error *error)
{
    size_t radii = (size_t)r->window / 2 + 1, area = (size_t)r->window * (size_t)r->window;
    size_t point_count = (size_t)r->width * (size_t)r->height;
    bool failed = false;
    *features =
        (struct features){.count = r->measured_count, .length = radii * (size_t)r->channels};
    features->points = calloc(features->count + 1, sizeof *features->points);
    features->values = calloc(features->count * features->length + 1, sizeof *features->values);
    if (!features->points || !features->values) {
        features_finish(features);
        return nacre_fail_memory(error, "the feature vectors");
    }
    for (size_t i = 0, n = 0; i < point_count; i++) {
        if (r->measured[i]) {
            features->points[n++] = i;
        }
    }
#pragma omp parallel
    {
        float *window = malloc(area * sizeof *window);
#pragma omp critical(factor_features)
        failed |= !window;
#pragma omp for
        for (size_t p = 0; p < features->count; p++) {
            int x = (int)(features->points[p] % (size_t)r->width);
            int y = (int)(features->points[p] / (size_t)r->width);
            for (int c = 0; window && c < r->channels; c++) {
                float *out = features->values + p * features->length + (size_t)c * radii;
                responses_get(r, c, x, y, window);
                features_of_window(window, r->window, out);
                normalise(out, radii);
            }
        }
        free(window);
    }
    if (failed) {
        features_finish(features);
        return nacre_fail_memory(error, "the feature vectors");
    }
    complete(features);
    return NACRE_OK;
}

void features_finish(struct features *features)
{
    free(features->points);
    free(features->values);
    *features = (struct features){0};
}
