/* Tests of the virtual sensor: its distributions, noise, pedestal, quantisation and saturation. */
#include "rig/virtual/pixels.h"
#include "rig/virtual/sensor.h"

#include "unity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { COUNT = 300000 };

/* As omp.h has it; clang-tidy has no such header. */
extern void omp_set_num_threads(int count);

static float *signal_;
static uint16_t *raw;

void setUp(void)
{
    signal_ = calloc(COUNT, sizeof *signal_);
    raw = calloc(COUNT, sizeof *raw);
    TEST_ASSERT_NOT_NULL(signal_);
    TEST_ASSERT_NOT_NULL(raw);
}

void tearDown(void)
{
    free(signal_);
    free(raw);
}

static const struct station_camera exact = {.bits = 12, .pedestal = 100};

static void expose(const struct station_camera *camera, double seconds, uint64_t key, size_t count,
                   uint16_t *out)
{
    const struct sensor_exposure exposure = {camera, signal_, seconds, 0, key};
    sensor_expose(&exposure, count, out);
}

static void fill(float value)
{
    for (int i = 0; i < COUNT; i++) {
        signal_[i] = value;
    }
}

static void statistics(double *mean, double *variance)
{
    double sum = 0, squares = 0;
    for (int i = 0; i < COUNT; i++) {
        sum += raw[i];
    }
    *mean = sum / COUNT;
    for (int i = 0; i < COUNT; i++) {
        squares += (raw[i] - *mean) * (raw[i] - *mean);
    }
    *variance = squares / (COUNT - 1);
}

static void normal_quantile_inverts_the_distribution(void)
{
    static const double probabilities[] = {1e-10, 1e-9, 1e-5, 0.001, 0.0749, 0.0751,
                                           0.3,   0.5,  0.7,  0.93,  0.99999};
    for (size_t i = 0; i < sizeof probabilities / sizeof *probabilities; i++) {
        double z = sensor_normal(probabilities[i]);
        /* The algorithm is good to 1.2e-7 of z; the distribution's relative slope is at most |z| + 1. */
        TEST_ASSERT_DOUBLE_WITHIN(probabilities[i] * 1.2e-7 * (z * z + 2), probabilities[i],
                                  0.5 * erfc(-z * sqrt(0.5)));
    }
}

static void poisson_quantile_inverts_the_distribution(void)
{
    static const double means[] = {0, 1e-6, 0.3, 4, 50};
    for (size_t m = 0; m < sizeof means / sizeof *means; m++) {
        for (int i = 0; i < 270; i++) {
            double p = 0.0005 + 0.0037 * i;
            double k = sensor_poisson(means[m], p);
            double below = 0, upto = 0;
            for (int j = 0; j <= (int)k; j++) {
                double term = exp(-means[m] + (j > 0 ? j * log(means[m]) : 0) - lgamma(j + 1.));
                below = upto;
                upto += term;
            }
            /* The sums round differently. */
            TEST_ASSERT_TRUE(p <= upto + 1e-12 && (k == 0 || p > below - 1e-12));
        }
    }
}

static void poisson_quantile_ends_for_every_uniform(void)
{
    TEST_ASSERT_TRUE(sensor_poisson(50, 1 - 0x1p-33) < 110);
    TEST_ASSERT_TRUE(sensor_poisson(1e-9, 1 - 0x1p-33) < 5);
    TEST_ASSERT_TRUE(sensor_poisson(50, 0x1p-33) < 20);
}

static void sensor_without_noise_quantises_to_the_nearest_value(void)
{
    for (int i = 0; i < COUNT; i++) {
        signal_[i] = (float)i * 0.125F;
    }
    expose(&exact, 0.5, 1, COUNT, raw);
    for (int i = 0; i < COUNT; i++) {
        int expected = (int)floor(100 + i * 0.0625 + 0.5);
        TEST_ASSERT_EQUAL_INT(expected < 4095 ? expected : 4095, raw[i]);
    }
}

static void sensor_saturates_at_the_top_of_its_bits(void)
{
    struct station_camera camera = {.bits = 8, .pedestal = 10, .read_noise = 3, .electrons = 5};
    fill(1e6F);
    expose(&camera, 1, 1, COUNT, raw);
    for (int i = 0; i < COUNT; i++) {
        TEST_ASSERT_EQUAL_INT(255, raw[i]);
    }
    camera.bits = 16;
    fill(1e9F);
    expose(&camera, 1, 1, COUNT, raw);
    TEST_ASSERT_EQUAL_INT(65535, raw[0]);
}

static void value_below_zero_is_cut_off(void)
{
    const struct station_camera camera = {.bits = 10, .pedestal = 0, .read_noise = 50};
    size_t zeros = 0;
    expose(&camera, 1, 1, COUNT, raw);
    for (int i = 0; i < COUNT; i++) {
        zeros += raw[i] == 0;
    }
    /* A half and what rounds down: probability 0.504, standard deviation 0.001. */
    TEST_ASSERT_DOUBLE_WITHIN(0.005, 0.504, (double)zeros / COUNT);
}

/* Tolerances below are 5 standard deviations of the estimate: of a mean s / sqrt(n), of a variance s^2 sqrt(2 / n).
 * Quantisation adds 1/12 to a variance. */
static void check_statistics(double mean, double variance)
{
    double found_mean, found_variance;
    statistics(&found_mean, &found_variance);
    TEST_ASSERT_DOUBLE_WITHIN(5 * sqrt(variance / COUNT), mean, found_mean);
    TEST_ASSERT_DOUBLE_WITHIN(5 * variance * sqrt(2. / COUNT), variance, found_variance);
}

static void black_frame_is_pedestal_and_read_noise(void)
{
    const struct station_camera camera = {
        .bits = 12, .pedestal = 100.25, .read_noise = 2.5, .electrons = 7};
    expose(&camera, 1, 3, COUNT, raw);
    check_statistics(100.25, 2.5 * 2.5 + 1. / 12);
}

static void shot_noise_has_the_variance_of_the_electrons(void)
{
    const struct station_camera camera = {.bits = 12, .pedestal = 100, .electrons = 5};
    fill(2000);
    expose(&camera, 0.5, 4, COUNT, raw); /* 1000 raw units are 5000 electrons */
    check_statistics(1100, 1000. / 5 + 1. / 12);
}

static void few_electrons_are_poisson_with_read_noise_added(void)
{
    const struct station_camera camera = {
        .bits = 12, .pedestal = 100, .read_noise = 2, .electrons = 0.25};
    fill(48); /* 12 electrons of 4 raw units each */
    expose(&camera, 1, 5, COUNT, raw);
    /* The fourth moment of a Poisson variate of mean 12 makes the variance of the variance a factor 1 + 1/24 larger,
     * within the 5 standard deviations. */
    check_statistics(148, 48. * 4 + 4 + 1. / 12);
}

static void noise_is_continuous_where_poisson_turns_normal(void)
{
    struct station_camera camera = {.bits = 12, .pedestal = 100, .electrons = 1};
    fill(49.99F);
    expose(&camera, 1, 6, COUNT, raw);
    check_statistics(149.99, 49.99); /* whole electrons are whole raw units: nothing is rounded */
    fill(50.01F);
    expose(&camera, 1, 6, COUNT, raw);
    check_statistics(150.01, 50.01 + 1. / 12);
}

static void frame_does_not_depend_on_the_number_of_threads(void)
{
    const struct station_camera camera = {
        .bits = 12, .pedestal = 100, .read_noise = 2, .electrons = 3};
    uint16_t *other = malloc(COUNT * sizeof *other);
    TEST_ASSERT_NOT_NULL(other);
    for (int i = 0; i < COUNT; i++) {
        signal_[i] = (float)(i % 1000);
    }
    omp_set_num_threads(1);
    expose(&camera, 1, 7, COUNT, raw);
    omp_set_num_threads(3);
    expose(&camera, 1, 7, COUNT, other);
    TEST_ASSERT_EQUAL_MEMORY(raw, other, COUNT * sizeof *raw);
    expose(&camera, 1, 7, 1000, other); /* nor on how many pixels there are */
    TEST_ASSERT_EQUAL_MEMORY(raw, other, 1000 * sizeof *raw);
    free(other);
}

/* Noise of another key, and of the same key shifted by a pixel, is uncorrelated. */
static void keys_give_independent_noise(void)
{
    const struct station_camera camera = {.bits = 12, .pedestal = 500, .read_noise = 20};
    uint16_t *other = malloc(COUNT * sizeof *other);
    double same = 0, shifted = 0;
    TEST_ASSERT_NOT_NULL(other);
    expose(&camera, 1, sensor_key(1, 2), COUNT, raw);
    expose(&camera, 1, sensor_key(1, 3), COUNT, other);
    for (int i = 0; i + 1 < COUNT; i++) {
        same += (raw[i] - 500.) * (other[i] - 500.);
        shifted += (raw[i] - 500.) * (raw[i + 1] - 500.);
    }
    /* 5 standard deviations of a sample correlation, 1 / sqrt(n). */
    TEST_ASSERT_DOUBLE_WITHIN(5 / sqrt(COUNT), 0, same / (400. * COUNT));
    TEST_ASSERT_DOUBLE_WITHIN(5 / sqrt(COUNT), 0, shifted / (400. * COUNT));
    free(other);
}

/* Dark current is light that was not there: 300 units a second over half a second, with their shot noise. */
static void dark_current_adds_its_units_and_their_shot_noise(void)
{
    const struct station_camera camera = {.bits = 12, .pedestal = 100, .electrons = 2};
    struct sensor_exposure exposure = {&camera, signal_, 0.5, 150, 8};
    fill(100);
    sensor_expose(&exposure, COUNT, raw);
    check_statistics(100 + 50 + 150, 200. / 2 + 1. / 12);
}

static void one_pixel_is_exposed_as_among_the_others(void)
{
    const struct station_camera camera = {
        .bits = 12, .pedestal = 100, .read_noise = 2, .electrons = 3};
    struct sensor_exposure exposure = {&camera, signal_, 1, 20, 9};
    uint16_t *other = calloc(COUNT, sizeof *other);
    TEST_ASSERT_NOT_NULL(other);
    fill(30);
    sensor_expose(&exposure, COUNT, raw);
    for (size_t i = 0; i < COUNT; i += 997) {
        sensor_expose_one(&exposure, i, other);
        TEST_ASSERT_EQUAL_UINT16(raw[i], other[i]);
    }
    free(other);
}

/* Pixels are drawn hot, dead and more or less sensitive by themselves, at the rates and with the moments of the file. */
static void flaws_of_pixels_are_independent_of_each_other(void)
{
    const struct virtual_settings settings = {
        .seed = 5,
        .camera = {.nonuniformity = 0.02, .hot_pixels = 0.1, .hot_per_s = 100, .dead_pixels = 0.1}};
    struct hot_pixels hot = {0};
    struct nacre_error error;
    double dead = 0, hot_and_dead = 0, hot_sum = 0, hot_deviations = 0;
    double deviations = 0, squares = 0, dead_deviations = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, hot_pixels_init(&settings, COUNT, &hot, &error));
    for (size_t i = 0; i < COUNT; i++) {
        double deviation = (pixels_sensitivity(&settings, i) - 1) / 0.02;
        bool is_dead = pixels_is_dead(&settings, i);
        deviations += deviation;
        squares += deviation * deviation;
        dead += is_dead;
        dead_deviations += is_dead ? deviation : 0;
    }
    for (size_t i = 0; i < hot.count; i++) {
        hot_sum += (double)hot.per_s[i];
        hot_and_dead += pixels_is_dead(&settings, hot.pixels[i]);
        hot_deviations += (pixels_sensitivity(&settings, hot.pixels[i]) - 1) / 0.02;
    }
    /* 5 standard deviations: of a share p, sqrt(p (1 - p) / n); of sums over a tenth of the pixels, their root. */
    double tenth = COUNT / 10.;
    TEST_ASSERT_DOUBLE_WITHIN(5 * sqrt(0.09 / COUNT), 0.1, (double)hot.count / COUNT);
    TEST_ASSERT_DOUBLE_WITHIN(5 * sqrt(0.09 / COUNT), 0.1, dead / COUNT);
    TEST_ASSERT_DOUBLE_WITHIN(5 * sqrt(0.0099 / COUNT), 0.01, hot_and_dead / COUNT);
    TEST_ASSERT_DOUBLE_WITHIN(5 / sqrt(COUNT), 0, deviations / COUNT);
    TEST_ASSERT_DOUBLE_WITHIN(5 * sqrt(2. / COUNT), 1, squares / COUNT);
    TEST_ASSERT_DOUBLE_WITHIN(5 / sqrt(tenth), 0, dead_deviations / tenth);
    TEST_ASSERT_DOUBLE_WITHIN(5 / sqrt(tenth), 0, hot_deviations / tenth);
    /* An exponential variate's deviation is its mean. */
    TEST_ASSERT_DOUBLE_WITHIN(5 * 100 / sqrt(tenth), 100, hot_sum / (double)hot.count);
    hot_pixels_finish(&hot);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(normal_quantile_inverts_the_distribution);
    RUN_TEST(poisson_quantile_inverts_the_distribution);
    RUN_TEST(poisson_quantile_ends_for_every_uniform);
    RUN_TEST(sensor_without_noise_quantises_to_the_nearest_value);
    RUN_TEST(sensor_saturates_at_the_top_of_its_bits);
    RUN_TEST(value_below_zero_is_cut_off);
    RUN_TEST(black_frame_is_pedestal_and_read_noise);
    RUN_TEST(shot_noise_has_the_variance_of_the_electrons);
    RUN_TEST(few_electrons_are_poisson_with_read_noise_added);
    RUN_TEST(noise_is_continuous_where_poisson_turns_normal);
    RUN_TEST(frame_does_not_depend_on_the_number_of_threads);
    RUN_TEST(keys_give_independent_noise);
    RUN_TEST(dark_current_adds_its_units_and_their_shot_noise);
    RUN_TEST(one_pixel_is_exposed_as_among_the_others);
    RUN_TEST(flaws_of_pixels_are_independent_of_each_other);
    return UNITY_END();
}
