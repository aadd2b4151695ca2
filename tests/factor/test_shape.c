/* Choosing planes and kernels at equal bytes: what is chosen is what fits better when either is forced. */
#include "bench.h"
#include "device.h"
#include "recipe.h"

#include "factor/layout.h"
#include "factor/shape.h"

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

/* Light of as many terms as `kernels`: those of another channel, too, where not `coloured`. */
struct light {
    int terms;
    double stretch; /* farther along x than along y by this */
    bool coloured;  /* each channel has terms of its own */
};

/* Waves in different directions, between 0.1 and 1. */
static double plane_of(int term, int x, int y)
{
    double angle = 0.9 * term, along = x * cos(angle) + y * sin(angle);
    return 0.55 + 0.45 * sin((0.5 + 0.13 * term) * along + 2 * term);
}

static double entry_of(const struct light *light, int channel, int x, int y, int dx, int dy)
{
    double distance = hypot(dx / light->stretch, dy), sum = distance == 0 ? 2 : 0;
    for (int t = 0; t < light->terms; t++) {
        int plane = light->coloured ? channel * light->terms + t : t;
        double reach = (0.5 + 0.6 * t) * (1 + 0.2 * channel);
        sum += plane_of(plane, x, y) * plane_of(plane, x + dx, y + dy) * exp(-distance * reach);
    }
    return sum;
}

enum { WINDOW = 7, AREA = WINDOW * WINDOW };

static struct sample make(const struct light *light, int width, int height, int channels)
{
    struct sample s = sample_new(width, height, channels, WINDOW, 5);
    for (int i = 0; i < width * height * channels * AREA; i++) {
        int at = i % AREA, c = i / AREA % channels, point = i / AREA / channels;
        int x = point % width, y = point / width;
        int dx = at % WINDOW - WINDOW / 2, dy = at / WINDOW - WINDOW / 2;
        bool inside = x + dx >= 0 && x + dx < width && y + dy >= 0 && y + dy < height;
        s.responses[i] = inside ? (float)entry_of(light, c, x, y, dx, dy) : 0;
    }
    return s;
}

/* What became of a fit. */
struct outcome {
    double error; /* off the centre, which all shapes have alike */
    size_t bytes;
    bool full, separate;
};

static struct outcome fit(const struct sample *sample, int terms, enum factor_kernels kernels,
                          enum factor_planes planes)
{
    struct factor_options options = recipe_options(terms, 40);
    struct factor_summary summary;
    options.kernels = kernels;
    options.planes = planes;
    struct nacre_material m = recipe_fit(&opencl, sample, &options, &summary);
    struct outcome outcome = {summary.error.without_centre.mean, nacre_material_size(&m),
                              m.radii == 0, m.channels > 1 && m.factor_channels > 1};
    TEST_ASSERT_EQUAL_INT(terms, m.terms);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    return outcome;
}

/* 20 x 16 points of one channel: three terms with radial kernels of 11 numbers take 3 (320 + 44) bytes, two with full ones of
 * 49 take 2 (320 + 196), less. */
static void expect_kernels(const struct light *light, bool full)
{
    struct sample sample = make(light, 20, 16, 1);
    struct outcome of_radial = fit(&sample, 3, FACTOR_KERNELS_RADIAL, FACTOR_PLANES_SHARED);
    struct outcome of_full = fit(&sample, 2, FACTOR_KERNELS_FULL, FACTOR_PLANES_SHARED);
    struct outcome chosen = fit(&sample, 3, FACTOR_KERNELS_AUTO, FACTOR_PLANES_AUTO);
    TEST_ASSERT_TRUE(of_radial.full == false && of_full.full == true);
    TEST_ASSERT_TRUE(of_full.bytes <= of_radial.bytes);
    TEST_ASSERT_EQUAL_INT(full, of_full.error < of_radial.error);
    TEST_ASSERT_EQUAL_INT(full, chosen.full);
    TEST_ASSERT_FALSE(chosen.separate);
    sample_finish(&sample);
}

/* No sum of radial kernels is longer one way. */
static void light_that_goes_farther_one_way_wants_full_kernels(void)
{
    static const struct light light = {.terms = 2, .stretch = 2};
    expect_kernels(&light, true);
}

/* Full kernels gain nothing where light goes as far every way, and cost a term that is needed. */
static void light_that_goes_as_far_every_way_wants_radial_kernels(void)
{
    static const struct light light = {.terms = 3, .stretch = 1};
    expect_kernels(&light, false);
}

/* 12 x 10 points of three channels: two terms with shared planes take 2 (120 + 132) bytes, one with planes of each channel's
 * own 360 + 132, less. */
static void expect_planes(const struct light *light, bool separate)
{
    struct sample sample = make(light, 12, 10, 3);
    struct outcome shared = fit(&sample, 2, FACTOR_KERNELS_RADIAL, FACTOR_PLANES_SHARED);
    struct outcome own = fit(&sample, 1, FACTOR_KERNELS_RADIAL, FACTOR_PLANES_SEPARATE);
    struct outcome chosen = fit(&sample, 2, FACTOR_KERNELS_AUTO, FACTOR_PLANES_AUTO);
    TEST_ASSERT_TRUE(shared.separate == false && own.separate == true);
    TEST_ASSERT_TRUE(own.bytes <= shared.bytes);
    TEST_ASSERT_EQUAL_INT(separate, own.error < shared.error);
    TEST_ASSERT_EQUAL_INT(separate, chosen.separate);
    TEST_ASSERT_FALSE(chosen.full);
    sample_finish(&sample);
}

/* Three planes, one for each channel: two shared ones cannot be all of them. */
static void channels_that_differ_want_planes_of_their_own(void)
{
    static const struct light light = {.terms = 1, .stretch = 1, .coloured = true};
    expect_planes(&light, true);
}

/* Two planes in all channels: one of each channel's own cannot be both. */
static void channels_that_are_alike_share_planes(void)
{
    static const struct light light = {.terms = 2, .stretch = 1};
    expect_planes(&light, false);
}

/* What is said of three terms. */
static struct shape choose(const struct sample *sample, const struct factor_options *options)
{
    struct responses responses = sample_load(sample, layout_lanes(&opencl));
    struct features features;
    struct shape shape;
    struct nacre_error error = {0};
    bench_succeed(features_new(&responses, &features, &error), &error);
    bench_succeed(shape_choose(&responses, &features, options, &opencl, 3, NULL, &shape, &error),
                  &error);
    features_finish(&features);
    responses_finish(&responses);
    return shape;
}

/* Of a sample larger than the piece that is fitted, that piece is looked at where points differ: at the right end here, all
 * else is one material. */
static void the_piece_is_where_points_differ(void)
{
    static const struct light plain = {.terms = 1, .stretch = 1}, far = {.terms = 2, .stretch = 2};
    struct sample sample = make(&plain, 88, 12, 1);
    for (int i = 0; i < 88 * 12 * AREA; i++) {
        int x = i / AREA % 88, y = i / AREA / 88;
        int dx = i % AREA % WINDOW - WINDOW / 2, dy = i % AREA / WINDOW - WINDOW / 2;
        bool inside = x + dx >= 0 && x + dx < 88 && y + dy >= 0 && y + dy < 12;
        double value = x >= 52 && x + dx >= 52 ? entry_of(&far, 0, x, y, dx, dy)
                       : x < 52 && x + dx < 52
                           ? 2 * (dx == 0 && dy == 0) + exp(-0.5 * hypot(dx, dy))
                           : 0;
        sample.responses[i] = inside ? (float)value : 0;
    }
    struct factor_options options = recipe_options(3, 5);
    options.kernels = FACTOR_KERNELS_AUTO;
    struct shape shape = choose(&sample, &options);
    TEST_ASSERT_TRUE(shape.full);
    /* 3 (1056 + 44) / (1056 + 196) = 2.6 */
    TEST_ASSERT_EQUAL_INT(2, shape.terms);
    sample_finish(&sample);
}

/* What is given is not chosen, and with nothing to choose nothing is fitted. */
static void what_is_given_stays(void)
{
    static const struct light light = {.terms = 2, .stretch = 2};
    struct sample sample = make(&light, 12, 10, 1);
    struct factor_options options = recipe_options(3, 5);
    options.kernels = FACTOR_KERNELS_RADIAL;
    options.planes = FACTOR_PLANES_AUTO; /* of one channel: the same either way */
    struct shape shape = choose(&sample, &options);
    TEST_ASSERT_FALSE(shape.full || shape.separate);
    TEST_ASSERT_EQUAL_INT(3, shape.terms);
    options.kernels = FACTOR_KERNELS_FULL;
    shape = choose(&sample, &options);
    TEST_ASSERT_TRUE(shape.full);
    TEST_ASSERT_EQUAL_INT(3, shape.terms);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(light_that_goes_farther_one_way_wants_full_kernels);
    RUN_TEST(light_that_goes_as_far_every_way_wants_radial_kernels);
    RUN_TEST(channels_that_differ_want_planes_of_their_own);
    RUN_TEST(channels_that_are_alike_share_planes);
    RUN_TEST(the_piece_is_where_points_differ);
    RUN_TEST(what_is_given_stays);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
