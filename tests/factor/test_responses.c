/* Responses in the working layout: what comes back, what is masked, how half floats round. */
#include "sample.h"

#include "factor/window.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <unity.h>

void setUp(void)
{
}

void tearDown(void)
{
}

/* Entry (u, v) of the response of (x, y) as it should come back: NaN outside the sample. */
static float expected_at(const struct sample *s, int x, int y, int channel, int u, int v)
{
    int xo = x + u - s->window / 2, yo = y + v - s->window / 2;
    bool inside = xo >= 0 && xo < s->width && yo >= 0 && yo < s->height;
    return inside ? sample_at(s, x, y)[(channel * s->window + v) * s->window + u] : (float)NAN;
}

/* The greatest difference of what responses_read gives, relative to the value or, below `floor` of the channel's largest
 * value, to that. NaN must stand where it should. */
static double worst_error(const struct sample *s, const struct responses *r, double floor)
{
    float *response =
        malloc((size_t)s->channels * (size_t)(s->window * s->window) * sizeof *response);
    double worst = 0;
    TEST_ASSERT_NOT_NULL(response);
    for (int i = 0; i < s->width * s->height; i++) {
        responses_read(r, i % s->width, i / s->width, response);
        for (int j = 0; j < s->channels * s->window * s->window; j++) {
            int c = j / s->window / s->window;
            float expected = expected_at(s, i % s->width, i / s->width, c, j % s->window,
                                         j / s->window % s->window);
            TEST_ASSERT_EQUAL_INT(isnan(expected), isnan(response[j]));
            if (!isnan(expected)) {
                double unit = fmax(fabs((double)expected), floor);
                worst = fmax(worst, fabs((double)response[j] - (double)expected) / unit);
            }
        }
    }
    free(response);
    return worst;
}

static double largest_of(const struct sample *s)
{
    double largest = 0;
    size_t area = (size_t)s->window * (size_t)s->window;
    for (size_t i = 0; i < (size_t)s->width * (size_t)s->height * area; i++) {
        double magnitude = fabs((double)s->responses[i]);
        largest = magnitude > largest ? magnitude : largest; /* passes over NaN */
    }
    return largest;
}

static void floats_come_back_as_they_are(void)
{
    static const int sizes[][4] = {/* width, height, channels, window */
                                   {1, 1, 1, 1},
                                   {1, 3, 3, 7},
                                   {17, 5, 1, 5},
                                   {9, 8, 3, 11}};
    static const int exponents[] = {0, -120, 100};
    for (size_t i = 0; i < 4 * 3; i++) {
        const int *size = sizes[i / 3];
        struct sample sample = sample_new(size[0], size[1], size[2], size[3], 5);
        sample_scale(&sample, ldexpf(1, exponents[i % 3]));
        for (int lanes = 4; lanes <= 16; lanes *= 2) {
            struct responses r = sample_load(&sample, lanes);
            TEST_ASSERT_TRUE(worst_error(&sample, &r, DBL_MIN) == 0);
            TEST_ASSERT_EQUAL_INT(0, r.mask_needed);
            TEST_ASSERT_NULL(r.mask[0]);
            responses_finish(&r);
        }
        sample_finish(&sample);
    }
}

static void what_was_not_measured_comes_back_as_nan(void)
{
    struct sample sample = sample_new(19, 12, 3, 7, 5);
    sample_punch_holes(&sample);
    struct responses floats = sample_load(&sample, 8), halves = sample_load_half(&sample, 8);
    TEST_ASSERT_TRUE(worst_error(&sample, &floats, DBL_MIN) == 0);
    TEST_ASSERT_TRUE(worst_error(&sample, &halves, DBL_MIN) <= 0x1p-11);
    TEST_ASSERT_EQUAL_INT(1, halves.mask_needed);
    TEST_ASSERT_EQUAL_UINT64(19 * 11 - 1, halves.measured_count); /* without a row and a point */
    responses_finish(&floats);
    responses_finish(&halves);
    sample_finish(&sample);
}

static void a_point_that_was_never_put_is_not_measured(void)
{
    struct nacre_scan_info info = {
        .width = 5, .height = 4, .window = 3, .channels = 1, .pitch_mm = 1};
    struct nacre_error error = {0};
    struct responses r;
    float response[9] = {1, 1, 1, 1, 2, 1, 1, 1, 1};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, responses_begin(&r, &info, 4, true, &error));
    for (int i = 0; i < 19; i++) {
        responses_put(&r, i % 5, i / 5, response);
    }
    responses_scale(&r);
    TEST_ASSERT_EQUAL_INT(1, r.mask_needed);
    TEST_ASSERT_EQUAL_UINT64(19, r.measured_count);
    TEST_ASSERT_TRUE(isnan(responses_sum(&r, 0, 4, 3)));
    TEST_ASSERT_TRUE(responses_sum(&r, 0, 1, 1) == ldexp(10, -r.exponent[0]));
    TEST_ASSERT_TRUE(responses_sum(&r, 0, 0, 0) == ldexp(5, -r.exponent[0]));
    responses_finish(&r);
}

/* Points that differ by 1300 in brightness, with tails of 1e-5 of their own maximum: the dimmest entry is 7.7e-9 of the
 * largest, and half floats are normal down to 2^-29 = 1.9e-9 of it, where they round by 2^-11 at most. What lies below
 * is rounded by half of 2^-39 of the largest, at most 2^15 there. */
static void half_floats_stay_normal_in_the_tails_of_dark_points(void)
{
    struct sample sample = sample_new(23, 9, 1, 25, 5);
    for (size_t i = 0; i < 23 * 9 * 625; i++) {
        int dx = (int)(i % 25) - 12, dy = (int)(i / 25 % 25) - 12;
        float tail = powf(1e-5F, hypotf((float)dx, (float)dy) / 17);
        sample.responses[i] = tail / (i / 625 % 2 ? 1300 : 1) * (1 + 1e-3F * (float)(i % 7));
    }
    struct responses r = sample_load_half(&sample, 8);
    TEST_ASSERT_TRUE(worst_error(&sample, &r, DBL_MIN) <= 0x1p-11);
    TEST_ASSERT_TRUE(worst_error(&sample, &r, DBL_MIN) > 0x1p-13); /* they are rounded */
    responses_finish(&r);
    for (size_t i = 0; i < 23 * 9 * 625; i++) {
        sample.responses[i] *= i == 312 ? 3e4F : 1;
    }
    r = sample_load_half(&sample, 8);
    double largest = largest_of(&sample);
    TEST_ASSERT_TRUE(worst_error(&sample, &r, DBL_MIN) > 0x1p-9);
    TEST_ASSERT_TRUE(worst_error(&sample, &r, 0x1p-28 * largest) <= 0x1p-11 * (1 + 0x1p-11));
    responses_finish(&r);
    sample_finish(&sample);
}

/* What a half float holds, scaled by a power of two, is held again. */
static void scans_of_half_floats_lose_nothing(void)
{
    struct sample sample = sample_new(13, 9, 3, 7, 5);
    for (size_t i = 0; i < (size_t)(13 * 9 * 3 * 49); i++) {
        int exponent = 0;
        float fraction = frexpf(sample.responses[i], &exponent);
        sample.responses[i] = ldexpf(rintf(fraction * 2048), exponent - 11);
    }
    struct responses r = sample_load_half(&sample, 16);
    TEST_ASSERT_TRUE(worst_error(&sample, &r, DBL_MIN) == 0);
    responses_finish(&r);
    sample_finish(&sample);
}

static void scaling_brings_the_largest_near_its_bound(void)
{
    for (int exponent = -140; exponent <= 120; exponent += 20) {
        struct sample sample = sample_new(8, 5, 1, 5, 5);
        sample_scale(&sample, ldexpf(1, exponent));
        double largest = largest_of(&sample);
        struct responses floats = sample_load(&sample, 8), halves = sample_load_half(&sample, 8);
        double scaled = ldexp(largest, -floats.exponent[0]);
        TEST_ASSERT_TRUE(scaled >= 0.5 && scaled <= 1);
        scaled = ldexp(largest, -halves.exponent[0]);
        TEST_ASSERT_TRUE(scaled >= 0x1p14 && scaled <= 0x1p15);
        responses_finish(&floats);
        responses_finish(&halves);
        sample_finish(&sample);
    }
}

static void darkness_stays_dark(void)
{
    struct sample sample = sample_new(5, 4, 1, 3, 5);
    sample_scale(&sample, 0);
    struct responses r = sample_load_half(&sample, 8);
    TEST_ASSERT_TRUE(worst_error(&sample, &r, DBL_MIN) == 0);
    TEST_ASSERT_EQUAL_UINT64(20, r.measured_count);
    responses_finish(&r);
    sample_finish(&sample);
}

static void half_floats_take_half_the_memory(void)
{
    struct nacre_scan_info info = {.width = 212, .height = 154, .window = 49, .channels = 3};
    size_t floats = responses_bytes(&info, 8, false), halves = responses_bytes(&info, 8, true);
    size_t entries = (size_t)212 * 154 * 49 * 49 * 3;
    /* Masks take 2 bytes a vector of 8; width 212 is filled up to 216; leads and zeros are a few rows. */
    TEST_ASSERT_TRUE(floats >= 4 * entries && floats <= 4.25 * 1.03 * (double)entries);
    TEST_ASSERT_TRUE(halves >= 2 * entries && halves <= 2.25 * 1.03 * (double)entries);
    info.width = 1 << 30;
    info.height = 1 << 30;
    TEST_ASSERT_EQUAL_UINT64(SIZE_MAX, responses_bytes(&info, 8, true));
}

/* The middle of a response is what stands there, and what it leaves out is the sum of squares of the rest that lies inside
 * the sample and was measured, here in double over the entries one by one: other orders of summing some hundred squares
 * differ by less than 1e-12 of it. */
static void the_middle_of_a_window_leaves_out_the_rest(void)
{
    struct sample sample = sample_new(9, 8, 3, 11, 5);
    sample_punch_holes(&sample);
    for (int to = 1; to <= sample.window; to += 2) {
        const struct window_cut cut = {9, 8, 3, sample.window, to};
        float middle[3 * 11 * 11];
        for (int i = 0; i < 9 * 8; i++) {
            double rest = 0;
            double left = window_cut(&cut, i % 9, i / 9, sample_at(&sample, i % 9, i / 9), middle);
            for (int j = 0; j < 3 * 11 * 11; j++) {
                int c = j / 121, u = j % 11, v = j / 11 % 11, border = (11 - to) / 2;
                bool kept = u >= border && u < 11 - border && v >= border && v < 11 - border;
                float value = sample_at(&sample, i % 9, i / 9)[j];
                if (kept) {
                    float found = middle[(c * to + v - border) * to + u - border];
                    TEST_ASSERT_EQUAL_MEMORY(&value, &found, sizeof value);
                } else if (!isnan(expected_at(&sample, i % 9, i / 9, c, u, v))) {
                    rest += (double)value * (double)value;
                }
            }
            TEST_ASSERT_DOUBLE_WITHIN(1e-12 * rest, rest, left);
        }
    }
    sample_finish(&sample);
}

/* Made of the larger ones or of the middles themselves, responses are the same. */
static void shrunk_responses_are_those_of_the_middle(void)
{
    struct sample sample = sample_new(9, 8, 3, 11, 5), small = sample_new(9, 8, 3, 5, 5);
    const struct window_cut cut = {9, 8, 3, 11, 5};
    struct nacre_error error = {""};
    struct responses shrunk;
    sample_punch_holes(&sample);
    for (int i = 0; i < 9 * 8; i++) {
        (void)window_cut(&cut, i % 9, i / 9, sample_at(&sample, i % 9, i / 9),
                         sample_at(&small, i % 9, i / 9));
    }
    struct responses large = sample_load(&sample, 8);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, responses_shrink(&shrunk, &large, 5, &error),
                                  error.text);
    TEST_ASSERT_TRUE(worst_error(&small, &shrunk, DBL_MIN) == 0);
    TEST_ASSERT_NOT_NULL(shrunk.beyond);
    TEST_ASSERT_TRUE(shrunk.beyond[40] > 0);
    responses_finish(&shrunk);
    responses_finish(&large);
    sample_finish(&small);
    sample_finish(&sample);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(floats_come_back_as_they_are);
    RUN_TEST(what_was_not_measured_comes_back_as_nan);
    RUN_TEST(a_point_that_was_never_put_is_not_measured);
    RUN_TEST(half_floats_stay_normal_in_the_tails_of_dark_points);
    RUN_TEST(scans_of_half_floats_lose_nothing);
    RUN_TEST(scaling_brings_the_largest_near_its_bound);
    RUN_TEST(darkness_stays_dark);
    RUN_TEST(half_floats_take_half_the_memory);
    RUN_TEST(the_middle_of_a_window_leaves_out_the_rest);
    RUN_TEST(shrunk_responses_are_those_of_the_middle);
    return UNITY_END();
}
