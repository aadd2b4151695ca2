/* Rounding planes: levels that change a point's light less than the nearest ones. */
#include "bench.h"
#include "device.h"
#include "recipe.h"
#include "stage.h"

#include "factor/terms_round.h"

#include <math.h>
#include <stdio.h>
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

/* A stage after some steps, its planes and kernels as factors, and planes as levels of so many bits. */
struct rounded {
    struct stage stage;
    struct factors factors;
    float *levels;
    double largest[8];
    int bits;
};

static struct rounded round_sample(const struct sample *sample, int terms, int bits)
{
    struct rounded r = {.stage = stage_open(&opencl, sample, terms), .bits = bits};
    struct nacre_error error = {0};
    size_t count = (size_t)terms * r.stage.points;
    stage_begin(&opencl, &r.stage);
    for (int i = 0; i < 12; i++) {
        bench_succeed(r.stage.method->ops->step(r.stage.method, 0, NULL, &error), &error);
    }
    stage_read(&r.stage);
    r.factors = (struct factors){.width = sample->width,
                                 .height = sample->height,
                                 .channels = 1,
                                 .terms = terms,
                                 .f = {r.stage.planes},
                                 .numbers = r.stage.data.grid.count,
                                 .kernels = {r.stage.numbers}};
    r.levels = malloc(count * sizeof *r.levels);
    TEST_ASSERT_NOT_NULL(r.levels);
    memcpy(r.levels, r.stage.planes, count * sizeof *r.levels);
    bench_succeed(terms_round(&r.stage.data, &r.factors, 0, 0, bits, r.levels, r.largest, &error),
                  &error);
    return r;
}

static void finish(struct rounded *r)
{
    free(r->levels);
    stage_close(&r->stage);
}

static double value_of(const struct rounded *r, size_t at, double level)
{
    double top = ldexp(1, r->bits) - 1;
    return r->largest[at / r->stage.points] * (level / top) * (level / top);
}

/* Weighted squares by which light from a point to others changes, all others as they are, where its values become those of
 * levels: the nearest, or those found. */
static double change_at(const struct rounded *r, int point, bool nearest)
{
    const struct stage *s = &r->stage;
    const struct responses *of = &s->data.copies[0];
    int half = of->window / 2, width = of->width, x = point % width, y = point / width;
    double sum = 0, top = ldexp(1, r->bits) - 1;
    for (int i = 0; i < of->window * of->window; i++) {
        int xo = x + i % of->window - half, yo = y + i / of->window - half;
        if (xo < 0 || xo >= width || yo < 0 || yo >= of->height || i == of->window * half + half) {
            continue;
        }
        double light = 0, there = (double)s->data.weights[yo * width + xo];
        for (size_t t = 0; t < s->terms; t++) {
            size_t at = t * s->points + (size_t)point;
            float kernel[49];
            double value = (double)s->planes[at];
            double level =
                nearest ? rint(top * sqrt(value / r->largest[t])) : (double)r->levels[at];
            terms_grid_spread(&s->data.grid, s->numbers + t * (size_t)s->data.grid.count, kernel);
            light += (value_of(r, at, level) - value) * (double)kernel[i] *
                     (double)s->planes[t * s->points + (size_t)(yo * width + xo)];
        }
        sum +=
            (double)s->data.scales[0][i] * ((double)s->data.weights[point] + there) * light * light;
    }
    return sum;
}

/* Nowhere is light changed more than by the nearest levels, from which the search sets out. Of three terms that overlap two can
 * make up for the third's rounding, of which light off the centre has two ways to differ, near and far: on the whole less than
 * half is left. */
static void one_term_makes_up_for_what_another_loses(void)
{
    struct recipe recipe = {.noise = true, .scale = 3};
    struct sample sample = recipe_make(&recipe, 19, 13, 1, 7);
    struct rounded r = round_sample(&sample, 3, 5);
    double of_nearest = 0, of_found = 0;
    for (int point = 0; point < 19 * 13; point++) {
        double nearest = change_at(&r, point, true), found = change_at(&r, point, false);
        TEST_ASSERT_TRUE(found <= nearest * (1 + 1e-9) + 1e-15);
        of_nearest += nearest;
        of_found += found;
    }
    TEST_ASSERT_TRUE(of_found < 0.5 * of_nearest);
    finish(&r);
    sample_finish(&sample);
}

/* One term has none to make up for it: its levels are the nearest, and the largest value has the highest. */
static void one_term_alone_has_the_nearest_levels(void)
{
    struct recipe recipe = {.scale = 1};
    struct sample sample = recipe_make(&recipe, 19, 13, 1, 7);
    struct rounded r = round_sample(&sample, 1, 6);
    double highest = 0;
    for (size_t i = 0; i < r.stage.points; i++) {
        double value = (double)r.stage.planes[i], level = (double)r.levels[i];
        highest = fmax(highest, level);
        TEST_ASSERT_TRUE(level == rint(level) && level >= 0 && level <= 63);
        TEST_ASSERT_TRUE(fabs(value_of(&r, i, level) - value) <=
                         fabs(value_of(&r, i, fmin(63, level + 1)) - value) + 1e-12);
        TEST_ASSERT_TRUE(fabs(value_of(&r, i, level) - value) <=
                         fabs(value_of(&r, i, fmax(0, level - 1)) - value) + 1e-12);
    }
    TEST_ASSERT_TRUE(highest == 63);
    finish(&r);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(one_term_makes_up_for_what_another_loses);
    RUN_TEST(one_term_alone_has_the_nearest_levels);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
