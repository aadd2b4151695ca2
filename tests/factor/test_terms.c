/* The model with a kernel per term: its steps against double precision, its samples of known kinds, its file. */
#include "bench.h"

#include "factor/factorize.h"
#include "factor/layout.h"
#include "factor/terms.h"
#include "factor/terms_kernels.h"
#include "factor/terms_noise.h"

#include "nacre/exr_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

static struct opencl opencl;
static char folder[] = "/tmp/nacre-terms-XXXXXX";

void setUp(void)
{
}

void tearDown(void)
{
}

/* How a made response is: two reciprocal terms, times a gain at both ends. */
struct recipe {
    bool homogeneous, checks, noise;
    double slope; /* of the gain's logarithm along x, over the sample */
    bool one_way; /* light goes farther to the right than to the left */
    double scale;
};

static double plane_of(const struct recipe *recipe, int term, int x, int y)
{
    if (recipe->homogeneous) {
        return 1;
    }
    if (recipe->checks) {
        return (x / 4 + y / 4) % 2 == term ? 1 : 0.25;
    }
    return term == 0 ? 0.6 + 0.4 * cos(0.5 * x) : 0.6 + 0.4 * sin(0.4 * y);
}

static double entry_of(const struct recipe *recipe, int width, int channel, int x, int y, int dx,
                       int dy)
{
    double distance = hypot(dx, dy), sum = distance == 0 ? 2 : 0;
    for (int t = 0; t < 2; t++) {
        sum += plane_of(recipe, t, x, y) * plane_of(recipe, t, x + dx, y + dy) *
               exp(-distance * (t ? 1.5 : 0.7) * (1 + 0.3 * channel));
    }
    sum *= exp(-recipe->slope * dx / width);
    return recipe->scale * sum * (recipe->one_way && dx > 0 && dy % 2 == 0 ? 2 : 1);
}

static struct sample make(const struct recipe *recipe, int width, int height, int channels,
                          int window)
{
    struct sample s = sample_new(width, height, channels, window, 5);
    int half = window / 2;
    for (int i = 0; i < width * height * channels * window * window; i++) {
        int at = i % (window * window), c = i / (window * window) % channels;
        int point = i / (window * window) / channels, x = point % width, y = point / width;
        int dx = at % window - half, dy = at / window - half;
        bool inside = x + dx >= 0 && x + dx < width && y + dy >= 0 && y + dy < height;
        double noise = recipe->noise ? 0.05 * sin(12.9898 * i) : 0;
        s.responses[i] =
            inside ? (float)(entry_of(recipe, width, c, x, y, dx, dy) * (1 + noise)) : 0;
    }
    return s;
}

static struct factor_options options_of(int terms, int iterations)
{
    struct factor_options options = factor_options_default();
    options.model = FACTOR_MODEL_TERMS;
    options.terms = terms;
    options.clusters = 0;
    options.iterations = iterations;
    options.tolerance = 0;
    return options;
}

static struct nacre_material fit(const struct sample *sample, const struct factor_options *options,
                                 struct factor_summary *summary)
{
    struct responses responses = sample_load(sample, layout_lanes(&opencl));
    struct nacre_material material = {0};
    struct nacre_error error = {0};
    bench_succeed(
        factorize_responses(&responses, 0.5, options, &opencl, NULL, &material, summary, &error),
        &error);
    responses_finish(&responses);
    return material;
}

/* Objectives are summed in double of float32 residuals: 1e-6 is what the contract allows. */
static void check_history(const struct nacre_material *m)
{
    TEST_ASSERT_TRUE(m->history_count > 0);
    for (size_t i = 1; i < m->history_count; i++) {
        TEST_ASSERT_TRUE((double)m->history_objective[i] <=
                         (1 + 1e-6) * (double)m->history_objective[i - 1]);
    }
}

/* Fit a recipe and return the mean relative error of the material as stored. */
static double error_of(const struct recipe *recipe, const struct factor_options *options,
                       int channels)
{
    struct sample sample = make(recipe, 20, 16, channels, 7);
    struct factor_summary summary;
    struct nacre_material m = fit(&sample, options, &summary);
    double error = summary.error.whole.mean;
    check_history(&m);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
    return error;
}

/* What is fitted are half floats: each entry, and the centre, is off by 2^-12 of itself at most. The planes are constant,
 * which eight bits hold exactly. */
static void one_term_suffices_for_a_homogeneous_sample(void)
{
    struct recipe recipe = {.homogeneous = true, .scale = 1};
    struct factor_options options = options_of(1, 10);
    /* Both of the recipe's terms have the same planes: one kernel is their sum. */
    TEST_ASSERT_DOUBLE_WITHIN(0x1p-11, 0, error_of(&recipe, &options, 3));
    options.full_kernels = true;
    TEST_ASSERT_DOUBLE_WITHIN(0x1p-11, 0, error_of(&recipe, &options, 1));
}

/* Eight bits in the square root move a plane by at most a 255th of itself where it is 1, and both ends by twice that; the
 * centre's logarithm, here over less than a factor of 4, by log(4) / 254 / 2. */
static void planes_of_two_kinds_are_found(void)
{
    struct recipe recipe = {.checks = true, .scale = 1};
    struct factor_options options = options_of(2, 60);
    TEST_ASSERT_TRUE(error_of(&recipe, &options, 1) < 0.01);
    TEST_ASSERT_TRUE(error_of(&recipe, &options, 3) < 0.01);
    options.separate_planes = true;
    TEST_ASSERT_TRUE(error_of(&recipe, &options, 3) < 0.01);
    options.weight = FACTOR_WEIGHT_KERNEL;
    TEST_ASSERT_TRUE(error_of(&recipe, &options, 1) < 0.01);
}

/* The data's scale moves no digit but by the power of two nearest to it: 1e-8 and 1e8 are none, so that roundings
 * differ; half of the error of one unit in float32's last digit a step would be 60 * 6e-8. */
static void scale_does_not_matter(void)
{
    struct recipe recipe = {.noise = true, .scale = 1};
    struct factor_options options = options_of(2, 20);
    double plain = error_of(&recipe, &options, 1);
    recipe.scale = 0x1p-30;
    TEST_ASSERT_DOUBLE_WITHIN(1e-3 * plain, plain, error_of(&recipe, &options, 1));
    recipe.scale = 0x1p30;
    TEST_ASSERT_DOUBLE_WITHIN(1e-3 * plain, plain, error_of(&recipe, &options, 1));
}

static void more_terms_than_the_data_supports_do_no_harm(void)
{
    struct recipe recipe = {.homogeneous = true, .scale = 1};
    struct factor_options options = options_of(12, 30);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0, error_of(&recipe, &options, 1));
}

/* A gain of exp(0.4) over the sample makes neighbours differ by 2 %, and points 3 apart by 6 %. Divided out, what is left
 * is the planes' eight bits, as above; not divided out, it would be all of 2 %. */
static void a_gain_at_both_ends_is_found(void)
{
    struct recipe recipe = {.slope = 0.4, .scale = 1};
    struct factor_options options = options_of(2, 60);
    struct sample sample = make(&recipe, 20, 16, 1, 7);
    struct factor_summary summary;
    struct nacre_material m = fit(&sample, &options, &summary);
    TEST_ASSERT_NOT_NULL(m.gain);
    TEST_ASSERT_TRUE(summary.error.whole.mean < 0.01);
    /* R(x_i, x_o) has exp(-slope (x_o - x_i) / width): gain(x) = exp(-slope x / width) up to a constant. Cosines up to
     * the fourth bend a straight line by about 2 % of its rise. */
    double ratio = log((double)m.gain[2] / (double)m.gain[17]);
    TEST_ASSERT_DOUBLE_WITHIN(0.03, -0.4 * (2 - 17) / 20.0, ratio * (ratio > 0 ? 1 : -1));
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void what_is_not_reciprocal_gets_planes_for_both_ends(void)
{
    struct recipe recipe = {.one_way = true, .scale = 1};
    struct factor_options options = options_of(3, 40);
    struct sample sample = make(&recipe, 20, 16, 1, 7);
    struct factor_summary summary;
    struct nacre_material m = fit(&sample, &options, &summary);
    TEST_ASSERT_NULL(m.gain);
    TEST_ASSERT_NOT_NULL(m.h);
    check_history(&m);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    options.full_kernels =
        true; /* and a kernel that is not even fits it: eight bits are what is left */
    m = fit(&sample, &options, &summary);
    TEST_ASSERT_TRUE(summary.error.whole.mean < 0.01);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void holes_are_filled(void)
{
    struct recipe recipe = {.noise = true, .scale = 1};
    struct factor_options options = options_of(3, 20);
    struct sample sample = make(&recipe, 20, 16, 3, 7);
    struct factor_summary summary;
    sample_punch_holes(&sample);
    struct nacre_material m = fit(&sample, &options, &summary);
    check_history(&m);
    TEST_ASSERT_TRUE(summary.error.not_measured > 0);
    TEST_ASSERT_TRUE(summary.error.whole.mean < 0.1);
    for (int i = 0; i < m.width * m.height * m.channels; i++) {
        TEST_ASSERT_TRUE(m.centre[i] > 0);
    }
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static int compare_floats(const void *a, const void *b)
{
    float left = *(const float *)a, right = *(const float *)b;
    return (left > right) - (left < right);
}

static int distinct(const float *values, size_t count)
{
    float *sorted = malloc(count * sizeof *sorted);
    int found = 1;
    TEST_ASSERT_NOT_NULL(sorted);
    memcpy(sorted, values, count * sizeof *sorted);
    qsort(sorted, count, sizeof *sorted, compare_floats);
    for (size_t i = 1; i < count; i++) {
        found += sorted[i] != sorted[i - 1];
    }
    free(sorted);
    return found;
}

/* Values are told by formulas and not listed, a kilobyte a part. */
static void expect_formulas(const char *path)
{
    static const char *const parts[][2] = {
        {"F", "nacre.roots"}, {"centre", "nacre.logarithms"}, {"albedo", "nacre.logarithms"}};
    struct exr_file file = {0};
    struct nacre_error error = {0};
    bench_succeed(exr_file_read(path, &file, &error), &error);
    for (size_t i = 0; i < 3; i++) {
        const struct exr_part *part = exr_file_find_part(&file, parts[i][0]);
        TEST_ASSERT_NOT_NULL(part);
        TEST_ASSERT_NOT_NULL_MESSAGE(exr_part_find(part, parts[i][1], EXR_FLOATS), parts[i][0]);
        TEST_ASSERT_NULL(exr_part_find(part, "nacre.values", EXR_FLOATS));
    }
    exr_file_finish(&file);
}

/* What is read back is what was written, bit for bit, and planes have no more values than their bits say. */
static void files_hold_planes_of_few_values(void)
{
    const int bits[] = {8, 6, 3};
    struct recipe recipe = {.noise = true, .slope = 0.4, .scale = 1};
    struct sample sample = make(&recipe, 20, 16, 3, 7);
    char path[64];
    (void)snprintf(path, sizeof path, "%s/m.exr", folder);
    for (int i = 0; i < 3; i++) {
        struct factor_options options = options_of(3, 8);
        struct factor_summary summary;
        struct nacre_error error = {0};
        struct nacre_material back, m;
        options.bits = bits[i];
        options.reciprocity = i == 0 ? TERMS_GAINED : TERMS_RECIPROCAL;
        m = fit(&sample, &options, &summary);
        bench_succeed(nacre_material_write(path, &m, &error), &error);
        bench_succeed(nacre_material_read(path, &back, &error), &error);
        size_t points = 20 * 16, area = 49;
        TEST_ASSERT_EQUAL_MEMORY(m.f, back.f, 3 * points * sizeof(float));
        TEST_ASSERT_EQUAL_MEMORY(m.centre, back.centre, 3 * points * sizeof(float));
        TEST_ASSERT_EQUAL_MEMORY(m.kernels, back.kernels, 9 * area * sizeof(float));
        TEST_ASSERT_EQUAL_MEMORY(m.albedo, back.albedo, 3 * points * sizeof(float));
        TEST_ASSERT_TRUE(distinct(m.albedo, 3 * points) <= 64);
        TEST_ASSERT_EQUAL_INT(i == 0, back.gain != NULL);
        TEST_ASSERT_EQUAL_INT(i == 0, back.h != NULL);
        for (size_t t = 0; i > 0 && t < 3; t++) {
            TEST_ASSERT_TRUE(distinct(m.f + t * points, points) <= 1 << bits[i]);
            TEST_ASSERT_TRUE(distinct(m.centre + t * points, points) <= 256);
        }
        /* Planes and gain at their bits, the centre at 8, 3 x 3 profiles of floats. */
        size_t planes = 3 + (i == 0 ? 1 : 0);
        TEST_ASSERT_EQUAL_INT((points * (planes * (size_t)bits[i] + 3 * 8) + 7) / 8 +
                                  9 * (size_t)m.radii * sizeof(float),
                              nacre_material_size(&m));
        expect_formulas(path);
        factor_summary_finish(&summary);
        nacre_material_finish(&m);
        nacre_material_finish(&back);
    }
    (void)unlink(path);
    sample_finish(&sample);
}

/* Change one thing in a good file, and expect the reading to be refused with a word. */
static void expect_refused(const char *path, int what, const char *word)
{
    struct exr_file file;
    struct nacre_error error = {0};
    struct nacre_material m;
    char changed[80];
    bench_succeed(exr_file_read(path, &file, &error), &error);
    (void)snprintf(changed, sizeof changed, "%s/changed.exr", folder);
    for (size_t i = 0; i < file.parts[0].attribute_count; i++) {
        struct exr_attribute *a = &file.parts[0].attributes[i];
        if (what == 0 && strcmp(a->name, "nacre.radii") == 0) {
            a->floats[2] = a->floats[1];
        }
        if (what == 1 && strcmp(a->name, "nacre.radii") == 0) {
            a->count--;
        }
    }
    for (size_t p = 0; p < file.part_count && what >= 4; p++) {
        for (size_t i = 0; i < file.parts[p].attribute_count; i++) {
            struct exr_attribute *a = &file.parts[p].attributes[i];
            bool roots = strcmp(a->name, "nacre.roots") == 0;
            bool logarithms = strcmp(a->name, "nacre.logarithms") == 0;
            if (what == 4 && roots) {
                a->floats[1] = 1e9F; /* so many numbers */
            }
            if (what == 5 && roots) {
                a->count--;
            }
            if (what == 6 && logarithms) {
                a->floats[0] = 0; /* the least value */
            }
            if (what == 7 && logarithms) {
                a->floats[1] = NAN;
            }
        }
    }
    if (what == 2) {
        exr_file_find_part(&file, "F")->planes[0].values[5] = 1000 * 0x1p-24F;
    }
    if (what == 3) {
        exr_file_find_part(&file, "gain")->planes[0].values[5] = 0;
    }
    bench_succeed(exr_file_write(changed, &file, EXR_ZIP, &error), &error);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, nacre_material_read(changed, &m, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, word), error.text);
    exr_file_finish(&file);
    (void)unlink(changed);
}

static void damaged_files_are_refused(void)
{
    struct recipe recipe = {.noise = true, .slope = 0.4, .scale = 1};
    struct sample sample = make(&recipe, 20, 16, 1, 7);
    struct factor_options options = options_of(2, 3);
    struct factor_summary summary;
    struct nacre_error error = {0};
    char path[64];
    (void)snprintf(path, sizeof path, "%s/m.exr", folder);
    options.reciprocity = TERMS_GAINED;
    struct nacre_material m = fit(&sample, &options, &summary);
    bench_succeed(nacre_material_write(path, &m, &error), &error);
    expect_refused(path, 0, "nacre.radii");
    expect_refused(path, 1, "part kernel");
    expect_refused(path, 2, "no number of");
    expect_refused(path, 4, "nacre.roots");
    expect_refused(path, 5, "nacre.roots");
    expect_refused(path, 6, "nacre.logarithms");
    expect_refused(path, 7, "nacre.logarithms");
    expect_refused(path, 3, "part gain");
    (void)unlink(path);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void what_does_not_belong_together_is_refused(void)
{
    struct recipe recipe = {.scale = 1};
    struct sample sample = make(&recipe, 8, 8, 1, 5);
    struct responses responses = sample_load(&sample, layout_lanes(&opencl));
    struct factor_summary summary;
    struct nacre_material m;
    for (int i = 0; i < 3; i++) {
        struct factor_options options = options_of(i == 2 ? TERMS_MOST + 1 : 2, 5);
        struct nacre_error error = {0};
        options.clusters = i == 0 ? 3 : 0;
        options.method = i == 1 ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS;
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, factorize_responses(&responses, 0.5, &options, &opencl,
                                                                NULL, &m, &summary, &error));
        TEST_ASSERT_NOT_NULL(strstr(error.text, "--model clusters"));
    }
    responses_finish(&responses);
    sample_finish(&sample);
}

/* The method itself on a sample, and what it holds. */
struct stage {
    struct responses responses;
    struct terms_data data;
    struct problem problem;
    struct method *method;
    uint32_t *kinds;
    float *kernels, *planes, *numbers;
    size_t points, terms;
};

static struct stage open_stage(const struct sample *sample, int terms)
{
    struct stage s = {.points = (size_t)sample->width * (size_t)sample->height,
                      .terms = (size_t)terms};
    s.responses = sample_load(sample, layout_lanes(&opencl));
    s.kinds = calloc(s.points, sizeof *s.kinds);
    s.kernels = calloc((size_t)sample->window * (size_t)sample->window, sizeof *s.kernels);
    for (size_t i = 0; i < s.points; i++) {
        s.kinds[i] = (uint32_t)(i % s.terms);
    }
    return s;
}

static void begin_stage(struct stage *s)
{
    const struct terms_options options = {.reciprocity = TERMS_RECIPROCAL, .bits = 8};
    struct nacre_error error = {0};
    bench_succeed(terms_data_begin(&s->data, &s->responses, &options, 1e-5, &error), &error);
    s->problem = (struct problem){.responses = &s->responses,
                                  .ids = s->kinds,
                                  .kernels = s->kernels,
                                  .clusters = 1,
                                  .terms = (int)s->terms,
                                  .seed = 3,
                                  .data = &s->data,
                                  .kinds = s->kinds};
    bench_succeed(terms_new(&opencl, &s->problem, &s->method, &error), &error);
    s->planes = malloc((s->terms * s->points + 1) * sizeof *s->planes);
    s->numbers = malloc((s->terms * (size_t)s->data.grid.count + 1) * sizeof *s->numbers);
}

static void read_stage(struct stage *s)
{
    struct nacre_error error = {0};
    bench_succeed(s->method->ops->read(s->method, 0, s->planes, NULL, &error), &error);
    bench_succeed(s->method->ops->read_kernels(s->method, 0, s->numbers, &error), &error);
}

static void close_stage(struct stage *s)
{
    method_free(s->method);
    terms_data_finish(&s->data);
    responses_finish(&s->responses);
    free(s->kinds);
    free(s->kernels);
    free(s->planes);
    free(s->numbers);
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
    struct sample sample = make(&recipe, 19, 13, 1, 7);
    struct stage s = open_stage(&sample, 3);
    struct nacre_error error = {0};
    begin_stage(&s);
    for (int i = 0; i < 6; i++) {
        double objective = 0;
        bench_succeed(s.method->ops->measure(s.method, 0, &objective, &error), &error);
        read_stage(&s);
        double expected = objective_by_definition(&s, &sample);
        double found = ldexp(objective, s.responses.exponent[0]);
        TEST_ASSERT_DOUBLE_WITHIN(sqrt((double)s.points / 2) * 0x1p-12 + 1e-5 * sqrt(expected),
                                  sqrt(expected), sqrt(found));
        bench_succeed(s.method->ops->step(s.method, 0, NULL, &error), &error);
    }
    close_stage(&s);
    sample_finish(&sample);
}

/* One point's equations in double, of what the device is given. */
static void equations_of(const struct stage *s, int x, int y, double *gradient, double *matrix)
{
    const struct responses *r = &s->data.copies[0];
    size_t m = s->terms, here = (size_t)y * (size_t)r->width + (size_t)x;
    int half = r->window / 2;
    memset(gradient, 0, m * sizeof *gradient);
    memset(matrix, 0, m * m * sizeof *matrix);
    for (int i = 0; i < r->window * r->window; i++) {
        int u = i % r->window, v = i / r->window, xo = x + u - half, yo = y + v - half;
        double shaped[8], miss = 0;
        if (xo < 0 || xo >= r->width || yo < 0 || yo >= r->height || (u == half && v == half)) {
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
    }
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
    struct sample sample = make(&recipe, 19, 13, 1, 7);
    struct stage s = open_stage(&sample, 3);
    struct nacre_error error = {0};
    begin_stage(&s);
    read_stage(&s);
    double *expected = malloc(s.terms * s.points * sizeof *expected), miss = 0, norm = 0;
    for (size_t point = 0; point < s.points; point++) {
        double gradient[8], matrix[64], u[8];
        equations_of(&s, (int)(point % 19), (int)(point / 19), gradient, matrix);
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
    read_stage(&s);
    for (size_t i = 0; i < s.terms * s.points; i++) {
        double difference = (double)s.planes[i] - expected[i];
        miss += difference * difference;
        norm += expected[i] * expected[i];
    }
    TEST_ASSERT_TRUE(sqrt(miss / norm) < 1e-4);
    free(expected);
    close_stage(&s);
    sample_finish(&sample);
}

/* The same light, falling off so slowly that much of it is far from the centre. */
static struct sample make_wide(int width, int height, int window)
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
            sum += plane_of(&recipe, t, x, y) * plane_of(&recipe, t, x + dx, y + dy) *
                   exp(-hypot(dx, dy) * (t ? 0.3 : 0.15));
        }
        s.responses[i] = (float)sum;
    }
    return s;
}

/* After eight steps with so many rows and columns within reach. */
static double objective_with(const struct sample *sample, int reach)
{
    struct stage s = open_stage(sample, 3);
    struct nacre_error error = {0};
    double objective = 0;
    begin_stage(&s);
    s.data.reach = reach;
    for (int i = 0; i < 8; i++) {
        bench_succeed(s.method->ops->step(s.method, 0, &objective, &error), &error);
    }
    close_stage(&s);
    return objective;
}

/* Between the last of eight steps on all entries come 2, 4, 6 and 8 on those within reach. As what is left falls as 1 / steps
 * at worst, 28 steps leave 8/28 of what eight do, if the 20 know of what lies beyond reach, where much of the light is here:
 * steps that forget its gradient, or carry it on the wrong way, raise the objective and are taken back. */
static void steps_within_reach_know_of_what_is_beyond(void)
{
    struct sample sample = make_wide(27, 26, 25);
    TEST_ASSERT_TRUE(objective_with(&sample, 4) < 0.5 * objective_with(&sample, 12));
    sample_finish(&sample);
}

/* Every entry wants 2, and kernels start as 5. Entries up to 5 rows and columns from the centre are looked at: numbers at
 * distances below 4 are those of entries there alone and become 2, those from 6 on belong to others, too, and stay. */
static void kernels_beyond_reach_stay(void)
{
    struct sample sample = make_wide(9, 8, 25);
    struct stage s = open_stage(&sample, 1);
    struct nacre_error error = {0};
    static float equations[625 * 2];
    begin_stage(&s);
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
    close_stage(&s);
    sample_finish(&sample);
}

/* What is loaded goes on as what was saved, bit for bit. */
static void expect_to_go_on(int width, int height, int window, bool within)
{
    struct recipe recipe = {.noise = true, .scale = 1};
    struct sample sample = make(&recipe, width, height, 1, window);
    struct stage first = open_stage(&sample, 2), second = open_stage(&sample, 2);
    struct nacre_error error = {0};
    begin_stage(&first);
    begin_stage(&second);
    TEST_ASSERT_EQUAL_INT(within, first.data.reach < window / 2);
    for (int i = 0; i < 9; i++) { /* normal matrices are of different steps by then */
        bench_succeed(first.method->ops->step(first.method, 0, NULL, &error), &error);
    }
    void *state = malloc(first.method->ops->state_size(first.method));
    bench_succeed(first.method->ops->save(first.method, 0, state, &error), &error);
    bench_succeed(second.method->ops->load(second.method, 0, state, &error), &error);
    for (int i = 0; i < 8; i++) {
        bench_succeed(first.method->ops->step(first.method, 0, NULL, &error), &error);
        bench_succeed(second.method->ops->step(second.method, 0, NULL, &error), &error);
    }
    read_stage(&first);
    read_stage(&second);
    TEST_ASSERT_EQUAL_MEMORY(first.planes, second.planes,
                             first.terms * first.points * sizeof *first.planes);
    memset(state, 0xff, first.method->ops->state_size(first.method));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, second.method->ops->load(second.method, 0, state, &error));
    free(state);
    close_stage(&first);
    close_stage(&second);
    sample_finish(&sample);
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
    struct stage s = open_stage(sample, terms);
    struct nacre_error error = {0};
    begin_stage(&s);
    for (int i = 0; i < 12; i++) {
        bench_succeed(s.method->ops->step(s.method, 0, NULL, &error), &error);
    }
    read_stage(&s);
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
    close_stage(&s);
    return gain;
}

/* One term fits a homogeneous sample but for kernels' lines between distances, of which this window has few: to some 0.1 %
 * of an entry; planes that follow what differs move by its 2 %. So 5 % of the gain, a square, and no more. */
static void fitting_noise_gains_its_projection(void)
{
    struct recipe recipe = {.homogeneous = true, .scale = 3};
    struct sample sample = make(&recipe, 19, 13, 1, 7);
    double expected = 0;
    TEST_ASSERT_TRUE(gain_of(&sample, 1, NULL) < 1e-9); /* squares of 2^-24, 247 points */
    part_pairs(&sample, 0.01);
    double gain = gain_of(&sample, 1, &expected);
    TEST_ASSERT_TRUE(expected > 1e-4);
    TEST_ASSERT_DOUBLE_WITHIN(0.05 * expected, expected, gain);
    TEST_ASSERT_TRUE(gain_of(&sample, 3, NULL) > gain);
    sample_finish(&sample);
}

static void a_saved_state_goes_on(void)
{
    expect_to_go_on(19, 13, 7, false);
    expect_to_go_on(27, 26, 25, true); /* most steps are on the middle of the window */
}

int main(void)
{
    struct nacre_error error = {0};
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK || !mkdtemp(folder)) {
        (void)fprintf(stderr, "%s\n", error.text);
        return 1;
    }
    UNITY_BEGIN();
    RUN_TEST(one_term_suffices_for_a_homogeneous_sample);
    RUN_TEST(planes_of_two_kinds_are_found);
    RUN_TEST(scale_does_not_matter);
    RUN_TEST(more_terms_than_the_data_supports_do_no_harm);
    RUN_TEST(a_gain_at_both_ends_is_found);
    RUN_TEST(what_is_not_reciprocal_gets_planes_for_both_ends);
    RUN_TEST(holes_are_filled);
    RUN_TEST(files_hold_planes_of_few_values);
    RUN_TEST(damaged_files_are_refused);
    RUN_TEST(what_does_not_belong_together_is_refused);
    RUN_TEST(the_objective_is_that_of_the_planes_and_kernels);
    RUN_TEST(a_step_is_that_of_double_precision);
    RUN_TEST(steps_within_reach_know_of_what_is_beyond);
    RUN_TEST(kernels_beyond_reach_stay);
    RUN_TEST(a_saved_state_goes_on);
    RUN_TEST(fitting_noise_gains_its_projection);
    (void)rmdir(folder);
    opencl_close(&opencl);
    return UNITY_END();
}
