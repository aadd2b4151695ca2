/* What fitting noise gains, and the runs that it ends. */
#include "bench.h"
#include "device.h"
#include "recipe.h"
#include "stage.h"

#include "factor/terms_noise.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unity.h>

static struct opencl opencl;

void setUp(void)
{
}

void tearDown(void)
{
}

/* Make R(x_i, x_o) larger by a share of itself and R(x_o, x_i) smaller by it, another one for each pair. */
static void part_pairs(struct sample *sample, double share)
{
    int half = sample->window / 2, area = sample->window * sample->window;
    for (int point = 0; point < sample->width * sample->height; point++) {
        int x = point % sample->width, y = point / sample->width;
        for (int i = 0; i < area; i++) {
            int there =
                (y + i / sample->window - half) * sample->width + x + i % sample->window - half;
            double apart = sin(12.9898 * point) - sin(12.9898 * there);
            sample_at(sample, x, y)[i] *= (float)(1 + share * apart);
        }
    }
}

/* What one term gains, by its definition: a change of its plane at a point moves the point's entries in proportion to
 * themselves, S, so half (sum V S n)^2 / sum V S^2, n = half of R - R^T; half of the sum over points. */
static double gain_by_definition(const struct stage *s, const struct sample *sample)
{
    int half = sample->window / 2, area = sample->window * sample->window;
    double sum = 0, *norms = calloc(s->points, sizeof *norms);
    for (size_t i = 0; i < s->points * (size_t)area; i++) {
        double value = (double)sample->responses[i];
        norms[i / (size_t)area] += value * value;
    }
    for (int point = 0; point < (int)s->points; point++) {
        int x = point % sample->width, y = point / sample->width;
        double right = 0, square = 0;
        for (int i = 0; i < area; i++) {
            int xo = x + i % sample->window - half, yo = y + i / sample->window - half;
            if (i == area / 2 || xo < 0 || xo >= sample->width || yo < 0 || yo >= sample->height) {
                continue;
            }
            double forth = (double)sample_at(sample, x, y)[i];
            double back = (double)sample_at(sample, xo, yo)[area - 1 - i];
            double weight = 1 / norms[point] + 1 / norms[yo * sample->width + xo];
            right += weight * (forth + back) / 2 * (forth - back) / 2;
            square += weight * (forth + back) / 2 * (forth + back) / 2;
        }
        sum += right * right / square / 2;
    }
    free(norms);
    return sum / 2;
}

/* Read what a stage holds after some steps, and ask what fitting noise would gain. */
static double gain_of(const struct sample *sample, int terms, double *definition)
{
    struct stage s = stage_open(&opencl, sample, terms);
    struct nacre_error error = {0};
    stage_begin(&opencl, &s);
    for (int i = 0; i < 12; i++) {
        bench_succeed(s.method->ops->step(s.method, 0, NULL, &error), &error);
    }
    stage_read(&s);
    const struct factors factors = {.width = sample->width,
                                    .height = sample->height,
                                    .channels = 1,
                                    .terms = terms,
                                    .f = {s.planes},
                                    .numbers = s.data.grid.count,
                                    .kernels = {s.numbers}};
    double gain = terms_noise_gain(&s.data, &factors);
    if (definition) {
        *definition = gain_by_definition(&s, sample);
    }
    stage_close(&s);
    return gain;
}

/* One term fits a homogeneous sample but for kernels' lines between distances, of which this window has few: to some 0.1 %
 * of an entry; planes that follow what differs move by its 2 %. So 5 % of the gain, a square, and no more. */
static void fitting_noise_gains_its_projection(void)
{
    struct recipe recipe = {.homogeneous = true, .scale = 3};
    struct sample sample = recipe_make(&recipe, 19, 13, 1, 7);
    double expected = 0;
    TEST_ASSERT_TRUE(gain_of(&sample, 1, NULL) < 1e-9); /* squares of 2^-24, 247 points */
    part_pairs(&sample, 0.01);
    double gain = gain_of(&sample, 1, &expected);
    TEST_ASSERT_TRUE(expected > 1e-4);
    TEST_ASSERT_DOUBLE_WITHIN(0.05 * expected, expected, gain);
    TEST_ASSERT_TRUE(gain_of(&sample, 3, NULL) > gain);
    sample_finish(&sample);
}

/* The real method, whose objective is told as `scale` over the iterations. */
struct told {
    struct method method;
    struct method *inner;
    double scale;
    int steps;
};

static int step_told(struct method *method, int channel, double *objective,
                     struct nacre_error *error)
{
    struct told *t = (struct told *)method;
    int status = t->inner->ops->step(t->inner, channel, NULL, error);
    if (objective) { /* that before the step, so after one fewer */
        *objective = t->scale / fmax(0.5, t->steps - 1);
    }
    t->steps++;
    return status;
}

static int measure_told(struct method *method, int channel, double *objective,
                        struct nacre_error *error)
{
    struct told *t = (struct told *)method;
    (void)channel;
    (void)error;
    *objective = t->scale / t->steps;
    return NACRE_OK;
}

static int read_told(struct method *method, int channel, float *f, float *h,
                     struct nacre_error *error)
{
    struct method *inner = ((struct told *)method)->inner;
    return inner->ops->read(inner, channel, f, h, error);
}

static int read_told_kernels(struct method *method, int channel, float *numbers,
                             struct nacre_error *error)
{
    struct method *inner = ((struct told *)method)->inner;
    return inner->ops->read_kernels(inner, channel, numbers, error);
}

static void explain_told(const struct method *method, const struct listener *to)
{
    (void)method;
    (void)to;
}

static void free_told(struct method *method)
{
    method_free(((struct told *)method)->inner);
    free(method);
}

static const struct method_ops told_ops = {.name = "told",
                                           .step = step_told,
                                           .measure = measure_told,
                                           .read = read_told,
                                           .read_kernels = read_told_kernels,
                                           .explain = explain_told,
                                           .free = free_told};

/* data: what the objective is after one iteration, in the responses' unit. */
static int make_told(void *data, const struct problem *problem, struct method **method,
                     struct nacre_error *error)
{
    struct told *t = calloc(1, sizeof *t);
    TEST_ASSERT_NOT_NULL(t);
    *t = (struct told){.method = {&told_ops},
                       .scale = ldexp(*(double *)data, -problem->responses->exponent[0])};
    *method = &t->method;
    return terms_new(&opencl, problem, &t->inner, error);
}

/* After how many iterations one term's run on the sample ends, if iteration n leaves the objective at scale / n. */
static int end_of(const struct sample *sample, double scale)
{
    const struct method_maker maker = {make_told, &scale};
    struct factor_options options = recipe_options(1, 300);
    struct factor_summary summary;
    options.tolerance = 0.03;
    options.reciprocity = TERMS_RECIPROCAL;
    options.maker = &maker;
    struct nacre_material m = recipe_fit(&opencl, sample, &options, &summary);
    int iterations = m.iterations;
    TEST_ASSERT_EQUAL_STRING(iterations < 300 ? "tolerance" : "iterations", summary.stopped_by);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    return iterations;
}

/* An objective of s / n falls by s / n while n doubles, half of what it fell before, and so by s / n for ever after: that is the
 * noise's gain at n = s / gain. The later half halves the objective, so that is no valley's end at 15 times 3 %; what one
 * iteration brings is 1 / n, below 3 % from n = 33 on. By whole numbers a quarter of n is off by less than 1 in 20, of which
 * later^2 / (before - later) is the same share or three times as much, and the gain by definition is good to 5 %: 20 % of n in
 * all, where half or twice the gain would be 100 % or 50 %. */
static void a_run_ends_where_what_is_left_is_noise(void)
{
    struct recipe recipe = {.homogeneous = true, .scale = 3};
    struct sample sample = recipe_make(&recipe, 19, 13, 1, 7);
    double gain = 0;
    part_pairs(&sample, 0.01);
    (void)gain_of(&sample, 1, &gain);
    TEST_ASSERT_DOUBLE_WITHIN(16, 80, end_of(&sample, 80 * gain));
    TEST_ASSERT_DOUBLE_WITHIN(32, 160, end_of(&sample, 160 * gain));
    sample_finish(&sample);
}

/* Pairs that do not differ are no noise: such a run goes on. */
static void a_run_without_noise_goes_on(void)
{
    struct recipe recipe = {.homogeneous = true, .scale = 3};
    struct sample sample = recipe_make(&recipe, 19, 13, 1, 7);
    TEST_ASSERT_EQUAL_INT(300, end_of(&sample, 1));
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(fitting_noise_gains_its_projection);
    RUN_TEST(a_run_ends_where_what_is_left_is_noise);
    RUN_TEST(a_run_without_noise_goes_on);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
