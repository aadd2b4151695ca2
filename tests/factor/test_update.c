/* The update kernels against the double-precision reference, and what they promise of any run. */
#include "reference.h"
#include "sample.h"

#include "factor/random.h"
#include "factor/update.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct opencl opencl;

void setUp(void)
{
}

void tearDown(void)
{
}

static void succeed(int status, const struct nacre_error *error)
{
    TEST_ASSERT_EQUAL_MESSAGE(NACRE_OK, status, error->text);
}

/* A problem whose clusters are columns of points and whose kernels differ in width. */
struct bench {
    struct responses responses;
    struct problem problem;
    uint32_t *ids;
    float *kernels;
    struct method *method;
    size_t count; /* floats of one factor */
    float *f, *h;
};

static struct bench bench_new(const struct sample *sample, int terms, int clusters, int lanes)
{
    struct bench b = {.responses = sample_load(sample, lanes)};
    int half = sample->window / 2, area = sample->window * sample->window;
    size_t points = (size_t)sample->width * (size_t)sample->height;
    b.ids = malloc(points * sizeof *b.ids);
    b.kernels = malloc((size_t)(clusters * sample->channels * area) * sizeof *b.kernels);
    for (size_t i = 0; i < points; i++) {
        b.ids[i] = (uint32_t)(i * 7 / 3 % (size_t)clusters);
    }
    for (int k = 0; k < clusters; k++) {
        for (int c = 0; c < sample->channels; c++) {
            for (int i = 0; i < area; i++) {
                double r = hypot(i % sample->window - half, i / sample->window - half);
                b.kernels[(k * sample->channels + c) * area + i] =
                    (float)(exp(-r / (0.5 + 0.3 * k + 0.1 * c)) + 1e-5);
            }
        }
    }
    b.problem = (struct problem){
        .ids = b.ids, .kernels = b.kernels, .clusters = clusters, .terms = terms, .seed = 3};
    b.count = points * (size_t)terms;
    b.f = malloc(b.count * sizeof *b.f);
    b.h = malloc(b.count * sizeof *b.h);
    return b;
}

static void bench_start(struct bench *b, const struct update_tile *tile)
{
    struct nacre_error error = {0};
    b->problem.responses = &b->responses;
    succeed(update_new(&opencl, &b->problem, tile, &b->method, &error), &error);
}

static void bench_finish(struct bench *b)
{
    method_free(b->method);
    responses_finish(&b->responses);
    free(b->ids);
    free(b->kernels);
    free(b->f);
    free(b->h);
}

static void bench_read(struct bench *b, int channel)
{
    struct nacre_error error = {0};
    succeed(b->method->ops->read(b->method, channel, b->f, b->h, &error), &error);
}

/* The same problem in double, of one channel, with the factors read last. finish_reference frees it. */
static struct reference make_reference(const struct bench *b, int channel)
{
    const struct responses *r = &b->responses;
    size_t area = (size_t)r->window * (size_t)r->window;
    size_t points = (size_t)r->width * (size_t)r->height;
    double *responses = malloc(points * area * sizeof *responses);
    double *kernels = malloc((size_t)b->problem.clusters * area * sizeof *kernels);
    float *window = malloc(area * sizeof *window);
    struct reference reference = {.width = r->width,
                                  .height = r->height,
                                  .window = r->window,
                                  .terms = b->problem.terms,
                                  .responses = responses,
                                  .ids = b->ids,
                                  .kernels = kernels,
                                  .f = malloc(b->count * sizeof(double)),
                                  .h = malloc(b->count * sizeof(double))};
    for (size_t i = 0; i < points; i++) {
        responses_get(r, channel, (int)(i % (size_t)r->width), (int)(i / (size_t)r->width), window);
        for (size_t j = 0; j < area; j++) {
            responses[i * area + j] = window[j];
        }
    }
    for (size_t k = 0; k < (size_t)b->problem.clusters; k++) {
        for (size_t j = 0; j < area; j++) {
            kernels[k * area + j] =
                b->kernels[(k * (size_t)r->channels + (size_t)channel) * area + j];
        }
    }
    for (size_t i = 0; i < b->count; i++) {
        reference.f[i] = b->f[i];
        reference.h[i] = b->h[i];
    }
    free(window);
    return reference;
}

static void finish_reference(struct reference *reference)
{
    free((void *)(size_t)reference->responses);
    free((void *)(size_t)reference->kernels);
    free(reference->f);
    free(reference->h);
}

/* Every entry within 1e-4 of itself, the requirement; entries of 0 in double may be anything up to the floor. */
static void assert_close(const double *expected, const float *actual, size_t count,
                         const char *what)
{
    for (size_t i = 0; i < count; i++) {
        double difference = fabs(expected[i] - (double)actual[i]);
        if (!(difference <= 1e-4 * expected[i] + 1.01 * (double)UPDATE_FLOOR)) {
            char text[160];
            (void)snprintf(text, sizeof text, "%s[%zu]: %.9g in double, %.9g", what, i, expected[i],
                           (double)actual[i]);
            TEST_FAIL_MESSAGE(text);
        }
    }
}

static void compare_one_iteration(struct bench *b, const struct update_tile *tile)
{
    struct nacre_error error = {0};
    bench_start(b, tile);
    for (int c = 0; c < b->responses.channels; c++) {
        double objective = 0, measured = 0;
        bench_read(b, c);
        struct reference reference = make_reference(b, c);
        double expected = reference_objective(&reference);
        succeed(b->method->ops->step(b->method, c, &objective, &error), &error);
        /* Float sums of some hundred numbers each, added in double: 1e-5 leaves room for their roundings. */
        TEST_ASSERT_DOUBLE_WITHIN(1e-5 * expected, expected, objective);
        reference_update(&reference, false);
        reference_update(&reference, true);
        bench_read(b, c);
        assert_close(reference.f, b->f, b->count, "F");
        assert_close(reference.h, b->h, b->count, "H");
        expected = reference_objective(&reference);
        succeed(b->method->ops->measure(b->method, c, &measured, &error), &error);
        /* Now F and H differ by roundings between the two, too: 1e-4 of each other. */
        TEST_ASSERT_DOUBLE_WITHIN(1e-4 * expected, expected, measured);
        finish_reference(&reference);
    }
}

struct shape {
    int width, height, window, terms, clusters, channels;
};

static void compare_shape(struct shape shape, int lanes)
{
    struct sample sample = sample_new(shape.width, shape.height, shape.channels, shape.window, 5);
    struct bench b = bench_new(&sample, shape.terms, shape.clusters, lanes);
    compare_one_iteration(&b, NULL);
    bench_finish(&b);
    sample_finish(&sample);
}

static void one_iteration_agrees_with_double_precision(void)
{
    static const struct shape shapes[] = {
        {1, 1, 1, 1, 1, 1},     {1, 1, 7, 3, 1, 1},     {1, 13, 5, 2, 1, 1},  {13, 1, 5, 2, 2, 1},
        {17, 11, 5, 4, 3, 3},   {16, 16, 9, 6, 4, 1},   {31, 7, 25, 3, 1, 1}, {5, 5, 25, 12, 5, 1},
        {37, 19, 11, 12, 1, 1}, {23, 29, 13, 20, 7, 1}, {33, 5, 3, 1, 6, 3},  {8, 3, 67, 2, 2, 1},
    };
    for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++) {
        compare_shape(shapes[i], update_lanes(&opencl));
    }
}

int main(void)
{
    struct nacre_error error = {0};
    UNITY_BEGIN();
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        (void)fprintf(stderr, "SKIP: %s\n", error.text);
        return 77;
    }
    RUN_TEST(one_iteration_agrees_with_double_precision);
    opencl_close(&opencl);
    return UNITY_END();
}
