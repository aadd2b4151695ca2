/* The outside check: the paper's updates against dense, general matrices in double precision. */
#include "bench.h"
#include "dense.h"
#include "device.h"

#include "factor/layout.h"
#include "factor/update.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unity.h>

enum { UPDATES = 20 };

static struct opencl opencl;

void setUp(void)
{
}

void tearDown(void)
{
}

/* The same problem as full matrices, W = 1 / sqrt(G). */
static struct dense dense_of(const struct reference *r)
{
    size_t width = (size_t)r->width, points = width * (size_t)r->height, terms = (size_t)r->terms;
    struct dense d = {.points = points,
                      .terms = terms,
                      .r = calloc(points * points, sizeof(double)),
                      .g = calloc(points * points, sizeof(double)),
                      .w = calloc(points * points, sizeof(double)),
                      .f = malloc(points * terms * sizeof(double)),
                      .h = malloc(points * terms * sizeof(double))};
    int half = r->window / 2, area = r->window * r->window;
    for (size_t i = 0; i < points * (size_t)area; i++) {
        size_t in = i / (size_t)area, entry = i % (size_t)area;
        int x = (int)(in % width) + (int)entry % r->window - half;
        int y = (int)(in / width) + (int)entry / r->window - half;
        if (x >= 0 && x < r->width && y >= 0 && y < r->height && !isnan(r->responses[i])) {
            size_t at = in * points + (size_t)y * width + (size_t)x;
            d.r[at] = r->responses[i];
            d.g[at] = r->kernels[(size_t)r->ids[in] * (size_t)area + entry];
            d.w[at] = 1 / sqrt(d.g[at]);
        }
    }
    for (size_t i = 0; i < points * terms; i++) {
        d.f[i % points * terms + i / points] = r->f[i];
        d.h[i] = r->h[i];
    }
    return d;
}

static void dense_finish(struct dense *d)
{
    free(d->r);
    free(d->g);
    free(d->w);
    free(d->f);
    free(d->h);
}

static double f_of(const struct dense *d, size_t i)
{
    return d->f[i % d->points * d->terms + i / d->points];
}

/* Relative to each entry; below 1e-6 of the largest to that, as entries that die out lose their digits first. */
static void assert_close(double expected, double actual, double tolerance, double largest)
{
    TEST_ASSERT_DOUBLE_WITHIN(tolerance * fmax(expected, 1e-6 * largest), expected, actual);
}

static double largest_of(const double *values, size_t count)
{
    double largest = 0;
    for (size_t i = 0; i < count; i++) {
        largest = fmax(largest, values[i]);
    }
    return largest;
}

static void start(struct bench *b)
{
    struct nacre_error error = {0};
    b->problem.responses = &b->responses;
    bench_succeed(update_new(&opencl, &b->problem, NULL, &b->method, &error), &error);
}

static void compare(struct sample *sample, int clusters)
{
    struct bench b = bench_new(sample, 4, clusters, layout_lanes(&opencl));
    struct nacre_error error = {0};
    start(&b);
    bench_read(&b, 0);
    struct reference pairs = bench_reference(&b, 0);
    struct dense d = dense_of(&pairs);
    for (int i = 0; i < UPDATES; i++) {
        reference_update(&pairs, false);
        reference_update(&pairs, true);
        dense_update_f(&d);
        dense_update_h(&d);
        bench_succeed(b.method->ops->step(b.method, 0, NULL, &error), &error);
    }
    bench_read(&b, 0);
    double largest_f = largest_of(d.f, b.count), largest_h = largest_of(d.h, b.count);
    for (size_t i = 0; i < b.count; i++) {
        assert_close(f_of(&d, i), pairs.f[i], 1e-10, largest_f);
        assert_close(d.h[i], pairs.h[i], 1e-10, largest_h);
        assert_close(f_of(&d, i), (double)b.f[i], 1e-4, largest_f);
        assert_close(d.h[i], (double)b.h[i], 1e-4, largest_h);
    }
    dense_finish(&d);
    bench_reference_finish(&pairs);
    bench_finish(&b);
}

static void updates_agree_with_dense_matrices(void)
{
    struct sample sample = sample_new(11, 9, 1, 7, 5);
    compare(&sample, 1);
    compare(&sample, 3);
    sample_finish(&sample);
}

static void updates_with_missing_entries_agree_with_dense_matrices(void)
{
    struct sample sample = sample_new(11, 9, 1, 7, 5);
    sample_punch_holes(&sample);
    compare(&sample, 3);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(updates_agree_with_dense_matrices);
    RUN_TEST(updates_with_missing_entries_agree_with_dense_matrices);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
