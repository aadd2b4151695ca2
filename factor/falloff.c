/* Polar feature vectors of responses. */
#include "factor/falloff.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

/* A place on a circle around the middle of a window: the entries around it and their bilinear weights. An entry of no
 * weight is that of the largest, lest one that was not measured count, or one beyond the rim. */
struct place {
    uint32_t entries[4];
    float weights[4];
};

struct circles {
    int radii;
    size_t *starts; /* [radii + 1]: the first place of each */
    struct place *places;
};

static struct place place_at(int size, double x, double y)
{
    int x0 = (int)floor(x), y0 = (int)floor(y), largest = 0;
    double fx = x - x0, fy = y - y0;
    struct place place;
    for (int k = 0; k < 4; k++) {
        double weight = (k % 2 ? fx : 1 - fx) * (k / 2 ? fy : 1 - fy);
        place.weights[k] = weight > 1e-9 ? (float)weight : 0; /* what cosines round to */
        place.entries[k] = (uint32_t)((y0 + k / 2) * size + x0 + k % 2);
        largest = place.weights[k] > place.weights[largest] ? k : largest;
    }
    for (int k = 0; k < 4; k++) {
        place.entries[k] = place.weights[k] > 0 ? place.entries[k] : place.entries[largest];
    }
    return place;
}

int circles_new(int size, struct circles **circles, struct nacre_error *error)
{
    size_t count = 1 + 4 * (size_t)(size / 2) * (size_t)(size / 2 + 1);
    struct circles *made = calloc(1, sizeof *made);
    int half = size / 2, status = NACRE_OK;
    size_t n = 0;
    *circles = NULL;
    if (made) {
        made->radii = half + 1;
        made->starts = calloc((size_t)half + 2, sizeof *made->starts);
        made->places = calloc(count, sizeof *made->places);
    }
    if (!made || !made->starts || !made->places) {
        status = nacre_fail_memory(error, "the feature vectors");
        goto out;
    }
    for (int r = 0; r <= half; r++) {
        /* About one place a point along the circle, and all eight main directions. */
        int angles = r == 0 ? 1 : 8 * r;
        made->starts[r] = n;
        for (int a = 0; a < angles; a++) {
            double angle = 2 * M_PI * a / angles;
            made->places[n++] = place_at(size, half + r * cos(angle), half + r * sin(angle));
        }
    }
    made->starts[half + 1] = n;
    *circles = made;
    made = NULL;
out:
    circles_free(made);
    return status;
}

void circles_free(struct circles *circles)
{
    if (circles) {
        free(circles->starts);
        free(circles->places);
        free(circles);
    }
}

void features_of_window(const struct circles *circles, const float *window, float *radii)
{
    for (int r = 0; r < circles->radii; r++) {
        float largest = -INFINITY;
        for (size_t i = circles->starts[r]; i < circles->starts[r + 1]; i++) {
            const struct place *place = &circles->places[i];
            float value = place->weights[0] * window[place->entries[0]] +
                          place->weights[1] * window[place->entries[1]] +
                          place->weights[2] * window[place->entries[2]] +
                          place->weights[3] * window[place->entries[3]];
            largest = value > largest ? value : largest; /* passes over NaN */
        }
        radii[r] = largest > -INFINITY ? largest : (float)NAN;
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
    struct circles *circles = NULL;
    bool failed = false;
    *features =
        (struct features){.count = r->measured_count, .length = radii * (size_t)r->channels};
    features->points = calloc(features->count + 1, sizeof *features->points);
    features->values = calloc(features->count * features->length + 1, sizeof *features->values);
    if (!features->points || !features->values ||
        circles_new(r->window, &circles, NULL) != NACRE_OK) {
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
                features_of_window(circles, window, out);
                normalise(out, radii);
            }
        }
        free(window);
    }
    circles_free(circles);
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
