/* What pixels of a camera out of focus see.
 *
 * The shape of the blur is not known, and hardly matters where it is narrower than a surface point: its variance does. It is
 * taken as mixtures of whole pixels, each a few times as [a, 1 - 2a, a] in x and in y, whose variance is 2a each time. */
#include "rig/develop/blur.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* The most variance of one time: with more the middle would be no more than its sides. */
#define VARIANCE_MOST 0.5

int blur_weights(double pixels, double weights[2 * BLUR_REACH + 1])
{
    double variance = fmin(pixels, BLUR_MOST) * fmin(pixels, BLUR_MOST);
    int reach = (int)ceil(variance / VARIANCE_MOST);
    double side = reach > 0 ? variance / reach / 2 : 0;
    memset(weights, 0, (2 * BLUR_REACH + 1) * sizeof *weights);
    weights[reach] = 1;
    for (int time = 0; time < reach; time++) {
        double before = 0;
        for (int i = 0; i <= 2 * reach; i++) {
            double here = weights[i];
            weights[i] = (1 - 2 * side) * here + side * (before + weights[i + 1]);
            before = here;
        }
    }
    return reach;
}

/* A pixel's row while it is made: shares by point, and which points have some. */
struct row {
    float *share; /* by point of the surface */
    uint32_t *points;
    size_t count;
};

static void add(struct row *row, const struct footprints *f, size_t pixel, double weight)
{
    double part = weight * (double)f->inside[pixel];
    for (size_t k = f->start[pixel]; k < f->start[pixel + 1]; k++) {
        uint32_t point = f->points[k];
        if (row->share[point] == 0) {
            row->points[row->count++] = point;
        }
        row->share[point] += (float)(part * (double)f->share[k]);
    }
}

static int compare_points(const void *a, const void *b)
{
    const uint32_t *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

/* Append the row in the order of its points, and empty it. */
static bool append(struct row *row, struct footprints *to, size_t *capacity, size_t pixel)
{
    double seen = 0;
    size_t used = to->start[pixel];
    qsort(row->points, row->count, sizeof *row->points, compare_points);
    for (size_t k = 0; k < row->count; k++) {
        seen += (double)row->share[row->points[k]];
    }
    if (used + row->count > *capacity) {
        *capacity = 2 * (used + row->count);
        uint32_t *points = realloc(to->points, *capacity * sizeof *points);
        to->points = points ? points : to->points;
        float *share = realloc(to->share, *capacity * sizeof *share);
        to->share = share ? share : to->share;
        if (!points || !share) {
            return false;
        }
    }
    for (size_t k = 0; k < row->count; k++) {
        uint32_t point = row->points[k];
        to->points[used] = point;
        to->share[used++] = (float)((double)row->share[point] / seen);
        row->share[point] = 0;
    }
    row->count = 0;
    to->inside[pixel] = (float)fmin(seen, 1);
    to->start[pixel + 1] = used;
    return true;
}

static bool blur_all(const struct footprints *from, int width, const double *weights, int reach,
                     struct row *row, struct footprints *to, size_t capacity)
{
    int height = (int)(from->pixels / (size_t)width);
    for (size_t i = 0; i < from->pixels; i++) {
        int x = (int)(i % (size_t)width), y = (int)(i / (size_t)width);
        for (int dy = -reach; dy <= reach; dy++) {
            for (int dx = -reach; dx <= reach; dx++) {
                if (x + dx >= 0 && x + dx < width && y + dy >= 0 && y + dy < height) {
                    add(row, from, (size_t)(y + dy) * (size_t)width + (size_t)(x + dx),
                        weights[reach + dx] * weights[reach + dy]);
                }
            }
        }
        if (!append(row, to, &capacity, i)) {
            return false;
        }
    }
    return true;
}

int blur_footprints(struct footprints *footprints, int width, double pixels,
                    struct nacre_error *error)
{
    double weights[2 * BLUR_REACH + 1];
    int reach = blur_weights(pixels, weights);
    size_t count = footprints->pixels, entries = footprints->start[count], most = 0;
    if (reach == 0) {
        return NACRE_OK;
    }
    for (size_t k = 0; k < entries; k++) {
        most = footprints->points[k] > most ? footprints->points[k] : most;
    }
    size_t capacity = 2 * entries + 16;
    struct footprints blurred = {.pixels = count,
                                 .start = calloc(count + 1, sizeof *blurred.start),
                                 .points = malloc(capacity * sizeof *blurred.points),
                                 .share = malloc(capacity * sizeof *blurred.share),
                                 .inside = calloc(count, sizeof *blurred.inside)};
    struct row row = {.share = calloc(most + 1, sizeof *row.share),
                      .points = malloc((most + 1) * sizeof *row.points)};
    bool enough = blurred.start && blurred.points && blurred.share && blurred.inside && row.share &&
                  row.points &&
                  blur_all(footprints, width, weights, reach, &row, &blurred, capacity);
    free(row.share);
    free(row.points);
    if (!enough) {
        footprints_finish(&blurred);
        return nacre_fail_memory(error, "the footprints of a camera out of focus");
    }
    footprints_finish(footprints);
    *footprints = blurred;
    return NACRE_OK;
}
