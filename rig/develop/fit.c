/* Least squares for pixels that see mixtures of surface points. */
#include "rig/develop/fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ROUNDS = 40 };

/* Far below any noise, and for a single entry still below 10^-4 of the brightest in a frame. */
static const double tolerance = 1e-5;

struct system {
    const struct footprints *footprints;
    const uint32_t *pixels;
    const float *weight;
    size_t count, points;
};

static void apply(const struct system *system, const double *x, double *y)
{
    const struct footprints *f = system->footprints;
    memset(y, 0, system->points * sizeof *y);
    for (size_t i = 0; i < system->count; i++) {
        size_t begin = f->start[system->pixels[i]];
        size_t end = f->start[system->pixels[i] + 1];
        double mixture = 0;
        for (size_t k = begin; k < end; k++) {
            mixture += (double)f->share[k] * x[f->points[k]];
        }
        mixture *= (double)system->weight[i];
        for (size_t k = begin; k < end; k++) {
            y[f->points[k]] += (double)f->share[k] * mixture;
        }
    }
}

static void add_diagonal(const struct system *system, double *diagonal)
{
    const struct footprints *f = system->footprints;
    for (size_t i = 0; i < system->count; i++) {
        size_t end = f->start[system->pixels[i] + 1];
        for (size_t k = f->start[system->pixels[i]]; k < end; k++) {
            diagonal[f->points[k]] +=
                (double)f->share[k] * (double)f->share[k] * (double)system->weight[i];
        }
    }
}

static double dot(const double *a, const double *b, size_t count)
{
    double sum = 0;
    for (size_t i = 0; i < count; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* residual / diagonal, 0 where the diagonal is. */
static void precondition(const double *diagonal, const double *residual, double *scaled,
                         size_t count)
{
    for (size_t i = 0; i < count; i++) {
        scaled[i] = diagonal[i] > 0 ? residual[i] / diagonal[i] : 0;
    }
}

int fit_solve(const struct footprints *footprints, const uint32_t *pixels, const float *weight,
              size_t count, size_t points, const double *right, double *x,
              struct nacre_error *error)
{
    struct system system = {footprints, pixels, weight, count, points};
    double *memory = calloc(5 * points, sizeof *memory);
    if (!memory) {
        return nacre_fail_memory(error, "the fit of surface points");
    }
    double *diagonal = memory;
    double *residual = memory + points;
    double *scaled = memory + 2 * points;
    double *direction = memory + 3 * points;
    double *image = memory + 4 * points;
    add_diagonal(&system, diagonal);
    apply(&system, x, image);
    for (size_t i = 0; i < points; i++) {
        residual[i] = right[i] - image[i];
    }
    precondition(diagonal, residual, scaled, points);
    memcpy(direction, scaled, points * sizeof *direction);
    double slope = dot(residual, scaled, points);
    double limit = tolerance * tolerance * dot(right, right, points);
    for (int round = 0; round < ROUNDS && dot(residual, residual, points) > limit; round++) {
        apply(&system, direction, image);
        double curvature = dot(direction, image, points);
        if (!(curvature > 0)) {
            break;
        }
        double length = slope / curvature;
        for (size_t i = 0; i < points; i++) {
            x[i] += length * direction[i];
            residual[i] -= length * image[i];
        }
        precondition(diagonal, residual, scaled, points);
        double next = dot(residual, scaled, points);
        for (size_t i = 0; i < points; i++) {
            direction[i] = scaled[i] + next / slope * direction[i];
        }
        slope = next;
    }
    free(memory);
    return NACRE_OK;
}
