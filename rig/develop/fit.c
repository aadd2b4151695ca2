/* Least squares for pixels that see mixtures of surface points. */
#include "rig/develop/fit.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { ROUNDS = 40 };

/* Far below any noise, and for a single entry still below 10^-4 of the brightest in a frame. */
static const double tolerance = 1e-5;

/* The farthest that two points of one pixel lie apart in x or in y. */
static int reach_of(const struct footprints *f, int width, const uint32_t *pixels, size_t count)
{
    int reach = 0;
    for (size_t i = 0; i < count; i++) {
        size_t begin = f->start[pixels[i]];
        size_t end = f->start[pixels[i] + 1];
        if (end > begin) {
            /* Rows come in order of y, then x. */
            int top = (int)(f->points[begin] / (uint32_t)width);
            int bottom = (int)(f->points[end - 1] / (uint32_t)width);
            reach = bottom - top > reach ? bottom - top : reach;
        }
        for (size_t k = begin; k < end; k++) {
            for (size_t l = begin; l < k; l++) {
                int across = abs((int)(f->points[k] % (uint32_t)width) -
                                 (int)(f->points[l] % (uint32_t)width));
                reach = across > reach ? across : reach;
            }
        }
    }
    return reach;
}

/* Band 0 is (0, 0), then (1 ... reach, 0), then (-reach ... reach, dy) for dy from 1 on. */
static size_t band_of(int reach, int dx, int dy)
{
    return (size_t)((ptrdiff_t)dy * (2 * reach + 1) + dx);
}

static void add_pixel(const struct footprints *f, int width, int reach, size_t pixel, float weight,
                      struct fit_matrix *matrix)
{
    for (size_t k = f->start[pixel]; k < f->start[pixel + 1]; k++) {
        size_t p = f->points[k];
        for (size_t l = k; l < f->start[pixel + 1]; l++) {
            size_t q = f->points[l];
            int dx = (int)(q % (size_t)width) - (int)(p % (size_t)width);
            int dy = (int)(q / (size_t)width) - (int)(p / (size_t)width);
            matrix->bands[band_of(reach, dx, dy) * matrix->points + p] +=
                weight * f->share[k] * f->share[l];
        }
    }
}

int fit_matrix_init(struct fit_matrix *matrix, const struct footprints *footprints,
                    int surface_width, const uint32_t *pixels, const float *weight, size_t count,
                    size_t points, struct nacre_error *error)
{
    int reach = reach_of(footprints, surface_width, pixels, count);
    size_t bands = band_of(reach, reach, reach) + 1;
    *matrix = (struct fit_matrix){.points = points,
                                  .count = bands,
                                  .offset = calloc(bands, sizeof *matrix->offset),
                                  .bands = calloc(bands * points, sizeof *matrix->bands)};
    if (!matrix->offset || !matrix->bands) {
        fit_matrix_finish(matrix);
        return nacre_fail_memory(error, "the fit of surface points");
    }
    for (int dy = 0; dy <= reach; dy++) {
        for (int dx = dy ? -reach : 0; dx <= reach; dx++) {
            matrix->offset[band_of(reach, dx, dy)] = (size_t)((ptrdiff_t)dy * surface_width + dx);
        }
    }
    for (size_t i = 0; i < count; i++) {
        if (weight[i] > 0) {
            add_pixel(footprints, surface_width, reach, pixels[i], weight[i], matrix);
        }
    }
    return NACRE_OK;
}

void fit_matrix_finish(struct fit_matrix *matrix)
{
    if (matrix) {
        free(matrix->offset);
        free(matrix->bands);
        *matrix = (struct fit_matrix){0};
    }
}

static void apply(const struct fit_matrix *matrix, const double *restrict x, double *restrict y)
{
    const float *restrict diagonal = matrix->bands;
#pragma omp simd
    for (size_t p = 0; p < matrix->points; p++) {
        y[p] = (double)diagonal[p] * x[p];
    }
    for (size_t k = 1; k < matrix->count; k++) {
        const float *restrict band = matrix->bands + k * matrix->points;
        size_t offset = matrix->offset[k];
        size_t count = matrix->points > offset ? matrix->points - offset : 0;
#pragma omp simd
        for (size_t p = 0; p < count; p++) {
            y[p] += (double)band[p] * x[p + offset];
        }
#pragma omp simd
        for (size_t p = 0; p < count; p++) {
            y[p + offset] += (double)band[p] * x[p];
        }
    }
}

static double dot(const double *a, const double *b, size_t count)
{
    double sum = 0;
#pragma omp simd reduction(+ : sum)
    for (size_t i = 0; i < count; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* residual / diagonal, 0 where the diagonal is. */
static void precondition(const float *diagonal, const double *residual, double *scaled,
                         size_t count)
{
    for (size_t i = 0; i < count; i++) {
        scaled[i] = diagonal[i] > 0 ? residual[i] / (double)diagonal[i] : 0;
    }
}

int fit_solve(const struct fit_matrix *matrix, const double *right, double *x,
              struct nacre_error *error)
{
    size_t points = matrix->points;
    double *memory = malloc(4 * points * sizeof *memory);
    if (!memory) {
        return nacre_fail_memory(error, "the fit of surface points");
    }
    double *residual = memory;
    double *scaled = memory + points;
    double *direction = memory + 2 * points;
    double *image = memory + 3 * points;
    apply(matrix, x, image);
    for (size_t i = 0; i < points; i++) {
        residual[i] = right[i] - image[i];
    }
    precondition(matrix->bands, residual, scaled, points);
    memcpy(direction, scaled, points * sizeof *direction);
    double slope = dot(residual, scaled, points);
    double limit = tolerance * tolerance * dot(right, right, points);
    for (int round = 0; round < ROUNDS && dot(residual, residual, points) > limit; round++) {
        apply(matrix, direction, image);
        double curvature = dot(direction, image, points);
        if (!(curvature > 0)) {
            break;
        }
        double length = slope / curvature;
#pragma omp simd
        for (size_t i = 0; i < points; i++) {
            x[i] += length * direction[i];
            residual[i] -= length * image[i];
        }
        precondition(matrix->bands, residual, scaled, points);
        double next = dot(residual, scaled, points);
#pragma omp simd
        for (size_t i = 0; i < points; i++) {
            direction[i] = scaled[i] + next / slope * direction[i];
        }
        slope = next;
    }
    free(memory);
    return NACRE_OK;
}
