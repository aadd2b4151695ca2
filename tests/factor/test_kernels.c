/* Responses in the working layout, and the kernels of clusters. */
#include "sample.h"

#include "factor/fill.h"
#include "factor/kernels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

void setUp(void)
{
}

void tearDown(void)
{
}

static void compute(const struct responses *responses, const uint32_t *ids, int clusters,
                    enum kernels_kind kind, double epsilon, float *kernels)
{
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_MESSAGE(
        NACRE_OK, kernels_compute(responses, ids, clusters, kind, epsilon, kernels, &error),
        error.text);
}

static void responses_come_back_from_the_layout_bit_for_bit(void)
{
    struct sample sample = sample_new(19, 6, 3, 7, 1);
    float window[49];
    sample_at(&sample, 3, 2)[10] = NAN;
    sample_at(&sample, 3, 2)[11] = INFINITY;
    for (int lanes = 4; lanes <= 16; lanes *= 2) {
        struct responses r = sample_load(&sample, lanes);
        for (int i = 0; i < 19 * 6 * 3; i++) {
            int x = i / 3 % 19, y = i / 57, c = i % 3;
            const float *expected = sample_at(&sample, x, y) + c * 49;
            responses_get(&r, c, x, y, window);
            for (int j = 0; j < 49; j++) {
                int xo = x + j % 7 - 3, yo = y + j / 7 - 3;
                int inside = xo >= 0 && xo < 19 && yo >= 0 && yo < 6 && isfinite(expected[j]);
                TEST_ASSERT_EQUAL_INT(!inside, isnan(window[j]) != 0);
                if (inside) {
                    TEST_ASSERT_EQUAL_FLOAT(expected[j], ldexpf(window[j], r.exponent[c]));
                }
            }
        }
        TEST_ASSERT_TRUE(r.mask_needed);
        TEST_ASSERT_EQUAL_UINT64(114, r.measured_count);
        responses_finish(&r);
    }
    sample_finish(&sample);
}

static void responses_are_scaled_by_a_power_of_two_to_at_most_1(void)
{
    static const float scales[] = {1e-30F, 1e-5F, 1, 1e5F, 1e30F};
    for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
        struct sample sample = sample_new(9, 5, 1, 5, 1);
        sample_scale(&sample, scales[i]);
        struct responses r = sample_load(&sample, 8);
        float largest = 0;
        for (size_t j = 0; j < r.size; j++) {
            largest = fmaxf(largest, r.values[0][j]);
        }
        TEST_ASSERT_TRUE(largest >= 0.5F && largest <= 1);
        TEST_ASSERT_FALSE(r.mask_needed);
        responses_finish(&r);
        sample_finish(&sample);
    }
}

/* Independent double sums over the sample's own array. */
static void average_kernels_are_means_over_measured_entries_inside_the_sample(void)
{
    struct sample sample = sample_new(11, 9, 3, 5, 2);
    uint32_t ids[99];
    float kernels[2 * 3 * 25];
    for (int i = 0; i < 99; i++) {
        ids[i] = (uint32_t)(i % 3 == 0);
        sample_at(&sample, i % 11, i / 11)[i % 75] = NAN;
    }
    struct responses r = sample_load(&sample, 8);
    compute(&r, ids, 2, KERNELS_AVERAGE, 0, kernels);
    for (int j = 0; j < 2 * 3 * 25; j++) {
        double sum = 0;
        int count = 0;
        for (int i = 0; i < 99; i++) {
            int xo = i % 11 + j % 5 - 2, yo = i / 11 + j % 25 / 5 - 2;
            double value = (double)sample_at(&sample, i % 11, i / 11)[j % 75];
            if ((int)ids[i] == j / 75 && !isnan(value) && xo >= 0 && xo < 11 && yo >= 0 && yo < 9) {
                sum += value;
                count++;
            }
        }
        /* One rounding to float. */
        TEST_ASSERT_DOUBLE_WITHIN(1e-7 * sum / count, sum / count,
                                  ldexp((double)kernels[j], r.exponent[j / 25 % 3]));
    }
    responses_finish(&r);
    sample_finish(&sample);
}

static void maximum_kernels_bound_every_measured_entry_and_touch_one(void)
{
    struct sample sample = sample_new(8, 8, 1, 3, 2);
    uint32_t ids[64] = {0};
    float kernel[9], window[9];
    int touched[9] = {0};
    struct responses r = sample_load(&sample, 8);
    compute(&r, ids, 1, KERNELS_MAXIMUM, 0, kernel);
    for (int i = 0; i < 64; i++) {
        responses_get(&r, 0, i % 8, i / 8, window);
        for (int j = 0; j < 9; j++) {
            TEST_ASSERT_TRUE(isnan(window[j]) || window[j] <= kernel[j]);
            touched[j] |= window[j] == kernel[j];
        }
    }
    for (int j = 0; j < 9; j++) {
        TEST_ASSERT_TRUE(touched[j]);
    }
    responses_finish(&r);
    sample_finish(&sample);
}

static void epsilon_is_relative_to_each_kernels_maximum(void)
{
    struct sample sample = sample_new(8, 8, 1, 3, 2);
    uint32_t ids[64] = {0};
    float plain[9], raised[9];
    struct responses r = sample_load(&sample, 8);
    compute(&r, ids, 1, KERNELS_AVERAGE, 0, plain);
    compute(&r, ids, 1, KERNELS_AVERAGE, 0.25, raised);
    for (int j = 0; j < 9; j++) {
        TEST_ASSERT_FLOAT_WITHIN(1e-6F, plain[j] + 0.25F * plain[4], raised[j]);
    }
    responses_finish(&r);
    sample_finish(&sample);
}

/* Cluster 1 is empty, cluster 2 dark: both take the mean of all points. */
static void empty_and_dark_clusters_take_the_kernel_of_all_points(void)
{
    struct sample sample = sample_new(8, 8, 1, 3, 2);
    uint32_t ids[64], none[64] = {0};
    float kernels[3 * 9], all[9];
    for (int i = 0; i < 64; i++) {
        ids[i] = i < 8 ? 2 : 0;
        for (int j = 0; i < 8 && j < 9; j++) {
            sample_at(&sample, i % 8, i / 8)[j] = 0;
        }
    }
    struct responses r = sample_load(&sample, 8);
    compute(&r, ids, 3, KERNELS_AVERAGE, 1e-5, kernels);
    compute(&r, none, 1, KERNELS_AVERAGE, 1e-5, all);
    TEST_ASSERT_EQUAL_MEMORY(all, kernels + 9, sizeof all);
    TEST_ASSERT_EQUAL_MEMORY(all, kernels + 18, sizeof all);
    TEST_ASSERT_TRUE(all[4] < kernels[4]);
    responses_finish(&r);
    sample_finish(&sample);
}

static void a_dark_sample_has_kernels_of_one(void)
{
    struct sample sample = sample_new(8, 8, 1, 3, 2);
    uint32_t ids[64] = {0};
    float kernel[9];
    sample_scale(&sample, 0);
    struct responses r = sample_load(&sample, 8);
    compute(&r, ids, 1, KERNELS_AVERAGE, 0, kernel);
    for (int j = 0; j < 9; j++) {
        TEST_ASSERT_EQUAL_FLOAT(1, kernel[j]);
    }
    responses_finish(&r);
    sample_finish(&sample);
}

static void labels_spread_from_known_points_to_all_others(void)
{
    struct nacre_error error = {0};
    uint8_t known[35] = {0};
    uint32_t ids[35];
    memset(ids, 0xff, sizeof ids);
    known[0] = known[34] = 1;
    ids[0] = 3;
    ids[34] = 5;
    TEST_ASSERT_EQUAL(NACRE_OK, fill_labels(7, 5, known, ids, &error));
    for (int i = 0; i < 35; i++) {
        int from_first = i % 7 > i / 7 ? i % 7 : i / 7;
        int from_last = 6 - i % 7 > 4 - i / 7 ? 6 - i % 7 : 4 - i / 7;
        if (from_first != from_last) { /* at the same distance either will do */
            TEST_ASSERT_EQUAL_UINT32(from_first < from_last ? 3 : 5, ids[i]);
        }
    }
}

static void planes_spread_within_their_cluster(void)
{
    struct nacre_error error = {0};
    static const uint8_t known[5] = {1, 0, 0, 0, 1};
    static const uint32_t ids[5] = {0, 0, 0, 1, 1};
    float planes[10] = {2, 0, 0, 0, 4, 20, 0, 0, 0, 40};
    static const float expected[10] = {2, 2, 2, 4, 4, 20, 20, 20, 40, 40};
    TEST_ASSERT_EQUAL(NACRE_OK, fill_planes(5, 1, known, ids, planes, 2, 5, &error));
    for (int i = 0; i < 10; i++) {
        TEST_ASSERT_EQUAL_FLOAT(expected[i], planes[i]);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(responses_come_back_from_the_layout_bit_for_bit);
    RUN_TEST(responses_are_scaled_by_a_power_of_two_to_at_most_1);
    RUN_TEST(average_kernels_are_means_over_measured_entries_inside_the_sample);
    RUN_TEST(maximum_kernels_bound_every_measured_entry_and_touch_one);
    RUN_TEST(epsilon_is_relative_to_each_kernels_maximum);
    RUN_TEST(empty_and_dark_clusters_take_the_kernel_of_all_points);
    RUN_TEST(a_dark_sample_has_kernels_of_one);
    RUN_TEST(labels_spread_from_known_points_to_all_others);
    RUN_TEST(planes_spread_within_their_cluster);
    return UNITY_END();
}
