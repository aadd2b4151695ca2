/* Steps with a kernel per term against double precision, and their state. */
#include "bench.h"
#include "device.h"
#include "recipe.h"
#include "stage.h"

#include "factor/terms_kernels.h"
#include "factor/terms_steps.h"

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

/* g_t at an entry, by the definition of a radial kernel. */
static double kernel_of(const struct stage *s, size_t t, int dx, int dy)
{
    const float *radius = s->data.grid.radius;
    const float *numbers = s->numbers + t * (size_t)s->data.grid.count;
    double distance = hypot(dx, dy);
    for (int k = 0; k + 1 < s->data.grid.count; k++) {
        double low = (double)radius[k], high = (double)radius[k + 1];
        if (distance >= low - 1e-6 && distance < high - 1e-6) {
            double share = fmax(0, distance - low) / (high - low);
            return (1 - share) * (double)numbers[k] + share * (double)numbers[k + 1];
        }
    }
    return 0;
}

/* The objective by its definition: half the sum of (R - M)^2 / ||R_i||^2, the centre aside. Unscales the model. */
static double objective_by_definition(const struct stage *s, const struct sample *sample)
{
    int half = sample->window / 2, area = sample->window * sample->window;
    double sum = 0, unit = ldexp(1, s->data.copies[0].exponent[0] + s->responses.exponent[0]);
    for (int point = 0; point < sample->width * sample->height; point++) {
        int x = point % sample->width, y = point / sample->width;
        const float *response = sample_at(sample, x, y);
        double norm = 0, miss = 0;
        for (int i = 0; i < area; i++) {
            int dx = i % sample->window - half, dy = i / sample->window - half;
            bool inside =
                x + dx >= 0 && x + dx < sample->width && y + dy >= 0 && y + dy < sample->height;
            double model = 0;
            norm += inside ? (double)response[i] * (double)response[i] : 0;
            for (size_t t = 0; inside && t < s->terms; t++) {
                size_t there = (size_t)(y + dy) * (size_t)sample->width + (size_t)(x + dx);
                model += (double)s->planes[t * s->points + (size_t)point] *
                         (double)s->planes[t * s->points + there] * kernel_of(s, t, dx, dy);
            }
            double difference = (double)response[i] - unit * model;
            miss += inside && (dx || dy) ? difference * difference : 0;
        }
        sum += miss / norm;
    }
    return sum / 2;
}

/* Half floats move an entry by 2^-12 of itself at most, so the root of the objective by the root of half the points times
 * that; float32 sums of 50 products by less than 1e-5. */
static void the_objective_is_that_of_the_planes_and_kernels(void)
{
    struct recipe recipe = {.noise = true, .scale = 3};
    struct sample sample = recipe_make(&recipe, 19, 13, 1, 7);
    struct stage s = stage_open(&opencl, &sample, 3);
    struct nacre_error error = {0};
    stage_begin(&opencl, &s);
    for (int i = 0; i < 6; i++) {
        double objective = 0;
        bench_succeed(s.method->ops->measure(s.method, 0, &objective, &error), &error);
        stage_read(&s);
        double expected = objective_by_definition(&s, &sample);
        double found = ldexp(objective, s.responses.exponent[0]);
        TEST_ASSERT_DOUBLE_WITHIN(sqrt((double)s.points / 2) * 0x1p-12 + 1e-5 * sqrt(expected),
                                  sqrt(expected), sqrt(found));
        bench_succeed(s.method->ops->step(s.method, 0, NULL, &error), &error);
    }
    stage_close(&s);
    sample_finish(&sample);
}

/* One point's equations in double, of what the device is given, and of entries from one ring around the centre to another
 * alone. Returns the squares of what the model misses. */
static double equations_of(const struct stage *s, int x, int y, int least, int most,
                           double *gradient, double *matrix)
{
    double squares = 0;
    const struct responses *r = &s->data.copies[0];
    size_t m = s->terms, here = (size_t)y * (size_t)r->width + (size_t)x;
    int half = r->window / 2;
    memset(gradient, 0, m * sizeof *gradient);
    memset(matrix, 0, m * m * sizeof *matrix);
    for (int i = 0; i < r->window * r->window; i++) {
        int u = i % r->window, v = i / r->window, xo = x + u - half, yo = y + v - half;
        int ring = abs(u - half) > abs(v - half) ? abs(u - half) : abs(v - half);
        double shaped[8], miss = 0;
        if (xo < 0 || xo >= r->width || yo < 0 || yo >= r->height || ring < least || ring > most) {
            continue;
        }
        size_t there = (size_t)yo * (size_t)r->width + (size_t)xo;
        double weight = (double)s->data.scales[0][i] *
                        ((double)s->data.weights[here] + (double)s->data.weights[there]);
        /* The method's copy is scaled, and its scales with it. */
        miss = (double)responses_value(r, 0, x, y, u, v);
        for (size_t t = 0; t < m; t++) {
            shaped[t] =
                kernel_of(s, t, u - half, v - half) * (double)s->planes[t * s->points + there];
            miss -= (double)s->planes[t * s->points + here] * shaped[t];
        }
        for (size_t t = 0; t < m; t++) {
            gradient[t] += weight * miss * shaped[t];
            for (size_t q = 0; q < m; q++) {
                matrix[t * m + q] += weight * shaped[t] * shaped[q];
            }
        }
        squares += weight * miss * miss;
    }
    return squares;
}

/* The step as terms.h describes it: ten sweeps on the point's equations, damped twice. */
static void descend_in_double(const double *gradient, const double *matrix, size_t m, double *u)
{
    double left[8], trace = 0;
    memcpy(left, gradient, m * sizeof *left);
    for (size_t t = 0; t < m; t++) {
        trace += matrix[t * m + t];
    }
    for (size_t i = 0; i < 10 * m; i++) {
        size_t t = i % m;
        double best = fmax(0, u[t] + left[t] / (2 * matrix[t * m + t] + 1e-6 * trace));
        double change = best - u[t];
        u[t] = best;
        for (size_t q = 0; q < m; q++) {
            left[q] -= (2 * matrix[t * m + q] + (q == t ? 1e-6 * trace : 0)) * change;
        }
    }
}

/* Sums of 48 products in float32 are good to 48 * 6e-8 = 3e-6 each; ten sweeps on three terms that overlap may enlarge
 * that by some ten times. As a normalised root of squares over all points: 1e-4 at most. */
static void a_step_is_that_of_double_precision(void)
{
    struct recipe recipe = {.noise = true, .scale = 1};
    struct sample sample = recipe_make(&recipe, 19, 13, 1, 7);
    struct stage s = stage_open(&opencl, &sample, 3);
    struct nacre_error error = {0};
    stage_begin(&opencl, &s);
    stage_read(&s);
    double *expected = malloc(s.terms * s.points * sizeof *expected), miss = 0, norm = 0;
    for (size_t point = 0; point < s.points; point++) {
        double gradient[8], matrix[64], u[8];
        (void)equations_of(&s, (int)(point % 19), (int)(point / 19), 1, 3, gradient, matrix);
        for (size_t t = 0; t < s.terms; t++) {
            u[t] = (double)s.planes[t * s.points + point];
        }
        descend_in_double(gradient, matrix, s.terms, u);
        for (size_t t = 0; t < s.terms; t++) {
            expected[t * s.points + point] = u[t];
        }
    }
    double before = 0, after = 0;
    bench_succeed(s.method->ops->step(s.method, 0, &before, &error), &error);
    bench_succeed(s.method->ops->measure(s.method, 0, &after, &error), &error);
    TEST_ASSERT_TRUE(after < before); /* so what is read is the step */
    stage_read(&s);
    for (size_t i = 0; i < s.terms * s.points; i++) {
        double difference = (double)s.planes[i] - expected[i];
        miss += difference * difference;
        norm += expected[i] * expected[i];
    }
    TEST_ASSERT_TRUE(sqrt(miss / norm) < 1e-4);
    free(expected);
    stage_close(&s);
    sample_finish(&sample);
}

/* The same light, falling off so slowly that much of it is far from the centre. */
static struct sample wide_sample(int width, int height, int window)
{
    struct recipe recipe = {.scale = 1};
    struct sample s = sample_new(width, height, 1, window, 5);
    int half = window / 2, area = window * window;
    for (int i = 0; i < width * height * area; i++) {
        int x = i / area % width, y = i / area / width;
        int dx = i % window - half, dy = i % area / window - half;
        bool inside = x + dx >= 0 && x + dx < width && y + dy >= 0 && y + dy < height;
        double sum = 0;
        for (int t = 0; t < 2 && inside; t++) {
            sum += recipe_plane(&recipe, t, x, y) * recipe_plane(&recipe, t, x + dx, y + dy) *
                   exp(-hypot(dx, dy) * (t ? 0.3 : 0.15));
        }
        s.responses[i] = (float)sum;
    }
    return s;
}

/* After eight steps with so many rows and columns within reach. */
static double objective_with(const struct sample *sample, int reach)
{
    struct stage s = stage_open(&opencl, sample, 3);
    struct nacre_error error = {0};
    double objective = 0;
    stage_begin(&opencl, &s);
    s.data.reach = reach;
    for (int i = 0; i < 8; i++) {
        bench_succeed(s.method->ops->step(s.method, 0, &objective, &error), &error);
    }
    stage_close(&s);
    return objective;
}

/* Between the last of eight steps on all entries come 2, 4, 6 and 8 on those within reach. As what is left falls as 1 / steps
 * at worst, 28 steps leave 8/28 of what eight do, if the 20 know of what lies beyond reach, where much of the light is here:
 * steps that forget its gradient, or carry it on the wrong way, raise the objective and are taken back. */
static void steps_within_reach_know_of_what_is_beyond(void)
{
    struct sample sample = wide_sample(27, 26, 25);
    TEST_ASSERT_TRUE(objective_with(&sample, 4) < 0.5 * objective_with(&sample, 12));
    sample_finish(&sample);
}

/* A stage on a wide sample after five steps, whose next ones see entries within reach alone: all normal matrices and gradients
 * are those of the model, which is read. */
static void begin_wide(struct stage *s)
{
    enum { REACH = 4, STEPS = 5 };
    struct nacre_error error = {0};
    stage_begin(&opencl, s);
    s->data.reach = REACH;
    for (int i = 0; i < STEPS; i++) {
        bench_succeed(s->method->ops->step(s->method, 0, NULL, &error), &error);
    }
    struct terms *m = (struct terms *)s->method;
    memcpy(s->numbers, m->channels[0].good, terms_number_count(m) * sizeof *s->numbers);
    bench_succeed(layout_read_factor(&m->layouts[0], m->sets[0].tracks[0].good, s->planes, &error),
                  &error);
}

/* Let the planes `moved`, with the kernels of the model, be what waits, and look at them as a burst does. */
static double look_at(struct stage *s, const float *moved)
{
    struct terms *m = (struct terms *)s->method;
    struct nacre_error error = {0};
    double objective = 0;
    memcpy(m->channels[0].next, s->numbers, terms_number_count(m) * sizeof *s->numbers);
    bench_succeed(terms_place_kernels(m, 0, s->numbers, &error), &error);
    bench_succeed(layout_write_factor(&m->layouts[0], m->sets[0].tracks[0].next, moved, &error),
                  &error);
    bench_succeed(terms_look_within(m, &m->sets[0], TERMS_STEP, &objective, &error), &error);
    return objective;
}

/* By what entries beyond reach have of the objective more than with the model: z^T A z - b^T z at each point, z what its values
 * moved by, as both ends move. */
static double change_beyond(const struct stage *s, const float *moved)
{
    double sum = 0;
    for (size_t point = 0; point < s->points; point++) {
        int width = s->responses.width, half = s->responses.window / 2;
        double gradient[8], matrix[64], z[8];
        (void)equations_of(s, (int)point % width, (int)point / width, s->data.reach + 1, half,
                           gradient, matrix);
        for (size_t t = 0; t < s->terms; t++) {
            size_t at = t * s->points + point;
            z[t] = (double)moved[at] - (double)s->planes[at];
        }
        for (size_t t = 0; t < s->terms; t++) {
            sum -= gradient[t] * z[t];
            for (size_t q = 0; q < s->terms; q++) {
                sum += z[t] * matrix[t * s->terms + q] * z[q];
            }
        }
    }
    return sum;
}

/* What entries within reach have of the objective, each pair met twice, with the planes and kernels that wait. */
static double objective_within(struct stage *s, const float *moved)
{
    const struct terms *m = (const struct terms *)s->method;
    double sum = 0;
    memcpy(s->planes, moved, s->terms * s->points * sizeof *moved);
    memcpy(s->numbers, m->channels[0].next, terms_number_count(m) * sizeof *s->numbers);
    for (size_t point = 0; point < s->points; point++) {
        int width = s->responses.width;
        double gradient[8], matrix[64];
        sum += equations_of(s, (int)point % width, (int)point / width, 1, s->data.reach, gradient,
                            matrix);
    }
    return sum / 4;
}

/* Planes that are a twentieth larger or smaller, by turns. Gradients are float32 sums of 600 products, of parts of either
 * sign: good to some 600 * 6e-8 of the squares that entries beyond reach have, a thousandth of what is compared. */
static void what_lies_beyond_reach_counts_in_the_objective(void)
{
    struct sample sample = wide_sample(27, 26, 25);
    struct stage s = stage_open(&opencl, &sample, 3);
    begin_wide(&s);
    size_t count = s.terms * s.points;
    float *moved = malloc(count * sizeof *moved);
    TEST_ASSERT_NOT_NULL(moved);
    for (size_t i = 0; i < count; i++) {
        moved[i] = s.planes[i] * (i / 3 % 2 ? 1.05F : 0.97F);
    }
    double told = look_at(&s, moved), beyond = change_beyond(&s, moved);
    double within = objective_within(&s, moved);
    TEST_ASSERT_TRUE(fabs(beyond) > 0.02 * within);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3 * fabs(beyond), within + beyond, told);
    free(moved);
    stage_close(&s);
    sample_finish(&sample);
}

/* Every entry wants 2, and kernels start as 5. Entries up to 5 rows and columns from the centre are looked at: numbers at
 * distances below 4 are those of entries there alone and become 2, those from 6 on belong to others, too, and stay. */
static void kernels_beyond_reach_stay(void)
{
    struct sample sample = wide_sample(9, 8, 25);
    struct stage s = stage_open(&opencl, &sample, 1);
    struct nacre_error error = {0};
    static float equations[625 * 2];
    stage_begin(&opencl, &s);
    const struct terms_grid *grid = &s.data.grid;
    for (int i = 0; i < 625; i++) {
        equations[2 * i] = 1;
        equations[2 * i + 1] = 2;
    }
    for (int k = 0; k < grid->count; k++) {
        s.numbers[k] = 5;
    }
    bench_succeed(terms_kernels_solve(grid, 1, true, 5, equations, s.numbers, &error), &error);
    for (int k = 1; k < grid->count; k++) {
        if (grid->radius[k] < 4) {
            TEST_ASSERT_FLOAT_WITHIN(1e-6F, 2, s.numbers[k]);
        } else if (grid->radius[k] >= 6) {
            TEST_ASSERT_EQUAL_FLOAT(5, s.numbers[k]);
        }
    }
    stage_close(&s);
    sample_finish(&sample);
}

/* One step of all channels. */
static void step_all(const struct stage *s)
{
    struct nacre_error error = {0};
    for (int c = 0; c < s->responses.channels; c++) {
        bench_succeed(s->method->ops->step(s->method, c, NULL, &error), &error);
    }
}

/* Bring the state of all channels from one to the other. Planes that channels share are in the first one's alone. */
static void transfer(const struct stage *from, const struct stage *to)
{
    struct nacre_error error = {0};
    for (int c = from->responses.channels - 1; c >= 0; c--) {
        size_t size = from->method->ops->state_size(from->method, c);
        size_t kernels = 2 * from->terms * (size_t)from->data.grid.count * sizeof(float);
        void *state = malloc(size);
        TEST_ASSERT_NOT_NULL(state);
        /* Three floats a point and term, and the curvature. */
        TEST_ASSERT_TRUE(c == 0 ? size > kernels + 12 * from->terms * from->points
                                : size == kernels);
        bench_succeed(from->method->ops->save(from->method, c, state, &error), &error);
        bench_succeed(to->method->ops->load(to->method, c, state, &error), &error);
        free(state);
    }
}

static void expect_nonsense_to_be_refused(const struct stage *s)
{
    struct nacre_error error = {0};
    size_t size = s->method->ops->state_size(s->method, 0);
    void *state = malloc(size);
    TEST_ASSERT_NOT_NULL(state);
    memset(state, 0xff, size);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, s->method->ops->load(s->method, 0, state, &error));
    free(state);
}

/* What is loaded goes on as what was saved, bit for bit. */
static void expect_to_go_on(int width, int height, int channels, int window, bool within)
{
    struct recipe recipe = {.noise = true, .scale = 1};
    struct sample sample = recipe_make(&recipe, width, height, channels, window);
    struct stage first = stage_open(&opencl, &sample, 2), second = stage_open(&opencl, &sample, 2);
    stage_begin(&opencl, &first);
    stage_begin(&opencl, &second);
    TEST_ASSERT_EQUAL_INT(within, first.data.reach < window / 2);
    for (int i = 0; i < 9; i++) { /* normal matrices are of different steps by then */
        step_all(&first);
    }
    transfer(&first, &second);
    for (int i = 0; i < 8; i++) {
        step_all(&first);
        step_all(&second);
    }
    stage_read(&first);
    stage_read(&second);
    TEST_ASSERT_EQUAL_MEMORY(first.planes, second.planes,
                             first.terms * first.points * sizeof *first.planes);
    expect_nonsense_to_be_refused(&second);
    stage_close(&first);
    stage_close(&second);
    sample_finish(&sample);
}

static void a_saved_state_goes_on(void)
{
    expect_to_go_on(19, 13, 3, 7, false);
    expect_to_go_on(27, 26, 1, 25, true); /* most steps are on the middle of the window */
}

static void tests(void)
{
    RUN_TEST(the_objective_is_that_of_the_planes_and_kernels);
    RUN_TEST(a_step_is_that_of_double_precision);
    RUN_TEST(steps_within_reach_know_of_what_is_beyond);
    RUN_TEST(what_lies_beyond_reach_counts_in_the_objective);
    RUN_TEST(kernels_beyond_reach_stay);
    RUN_TEST(a_saved_state_goes_on);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
