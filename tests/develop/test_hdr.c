/* Merging exposures: against a double reference, for bias and for the foretold variance. */
#include "made.h"
#include "rig/develop/hdr.h"
#include "unity.h"

#include <math.h>
#include <stdlib.h>

enum { PIXELS = 20000, EXPOSURES = 4, BITS = 10 };

static struct noise_model noise;
static double seconds[EXPOSURES];
static struct exposure exposures[EXPOSURES];
static struct pattern_frames frames;
static float radiance[PIXELS], variance[PIXELS];

void setUp(void)
{
    noise = (struct noise_model){16, 1.2, 15};
    frames = (struct pattern_frames){
        .width = PIXELS / 4, .height = 4, .bits = BITS, .count = EXPOSURES, .exposures = exposures};
    for (int e = 0; e < EXPOSURES; e++) {
        seconds[e] = 2 / pow(4, EXPOSURES - 1 - e);
        exposures[e].exposure_ns = (int64_t)(seconds[e] * 1e9);
        exposures[e].raw = calloc(PIXELS, sizeof *exposures[e].raw);
    }
}

void tearDown(void)
{
    for (int e = 0; e < EXPOSURES; e++) {
        free(exposures[e].raw);
    }
}

static uint16_t quantised(double value)
{
    return (uint16_t)fmin(fmax(floor(value + 0.5), 0), (1 << BITS) - 1);
}

/* All pixels see the same light, each with its own noise. */
static void expose(double light)
{
    struct made_random random = {(uint64_t)(light * 1000)};
    for (int e = 0; e < EXPOSURES; e++) {
        for (int i = 0; i < PIXELS; i++) {
            double electrons = made_poisson(&random, light * seconds[e] * noise.electrons);
            exposures[e].raw[i] = quantised(electrons / noise.electrons + noise.pedestal +
                                            noise.read_noise * made_normal(&random));
        }
    }
}

struct figures {
    double mean, deviation, predicted;
};

static struct figures figures_of(const float *values)
{
    struct figures f = {0, 0, 0};
    for (int i = 0; i < PIXELS; i++) {
        f.mean += (double)values[i] / PIXELS;
        f.predicted += (double)variance[i] / PIXELS;
    }
    for (int i = 0; i < PIXELS; i++) {
        f.deviation += (values[i] - f.mean) * (values[i] - f.mean) / (PIXELS - 1);
    }
    f.deviation = sqrt(f.deviation);
    f.predicted = sqrt(f.predicted);
    return f;
}

/* The light at which exposure `e` reaches `share` of its range. */
static double light_at(int e, double share)
{
    return share * ((1 << BITS) - 1 - noise.pedestal) / seconds[e];
}

static void noise_free_frames_give_the_radiance_within_quantisation(void)
{
    for (int i = 0; i < PIXELS; i++) {
        double light = 0.5 + i * 1.2;
        for (int e = 0; e < EXPOSURES; e++) {
            exposures[e].raw[i] = quantised(light * seconds[e] + noise.pedestal);
        }
    }
    TEST_ASSERT_EQUAL_UINT(0, hdr_merge(&frames, &noise, radiance, NULL));
    for (int i = 0; i < PIXELS; i++) {
        double light = 0.5 + i * 1.2;
        /* Each exposure is off by half a raw unit at most. However they are weighed between shot noise (by their time)
         * and read noise (by its square), the sum is off by no more than with weights by time. */
        double used = 1;
        double total = seconds[0];
        for (int e = 1; e < EXPOSURES; e++) {
            bool safe = light < light_at(e, 0.9);
            used += safe ? 1 : 0;
            total += safe ? seconds[e] : 0;
        }
        TEST_ASSERT_DOUBLE_WITHIN(0.5 * used / total + 1e-5 * light, light, (double)radiance[i]);
    }
}

/* The same weights in double precision, one pixel at a time, iterated until nothing changes. */
static double reference(int pixel)
{
    double limit = (1 << BITS) - 2;
    double estimate = 0;
    for (int round = 0; round < 100; round++) {
        double above = 0;
        double below = 0;
        for (int e = 0; e < EXPOSURES; e++) {
            double raw = exposures[e].raw[pixel];
            double expected = fmax(estimate, 0) * seconds[e];
            double var =
                noise.read_noise * noise.read_noise + 1.0 / 12 + expected / noise.electrons;
            bool safe = limit - noise.pedestal - expected >= 4 * sqrt(var);
            if (raw < limit && (round == 0 || e == 0 || safe)) {
                above += seconds[e] * (raw - noise.pedestal) / var;
                below += seconds[e] * seconds[e] / var;
            }
        }
        estimate = above / below;
    }
    return estimate;
}

static void merge_agrees_with_double_reference(void)
{
    for (int step = 0; pow(1.7, step) < light_at(0, 0.95); step++) {
        double light = pow(1.7, step);
        expose(light);
        (void)hdr_merge(&frames, &noise, radiance, variance);
        size_t off = 0;
        for (int i = 0; i < PIXELS; i += 10) {
            /* A few pixels lie so near the limit of an exposure that rounding decides whether it counts. */
            off +=
                fabs((double)radiance[i] - reference(i)) > 1e-3 * sqrt((double)variance[i]) ? 1 : 0;
        }
        TEST_ASSERT_TRUE(off <= 2);
    }
}

static void merge_is_unbiased_and_knows_its_variance(void)
{
    /* Over 10,000:1, and where an exposure is just at the end of its range. */
    const double lights[] = {
        light_at(0, 0.95),       light_at(0, 0.95) / 1e4, light_at(0, 0.95) / 1e3,
        light_at(0, 0.95) / 1e2, light_at(3, 0.9),        light_at(3, 0.97),
        light_at(3, 0.99),       light_at(3, 1),          light_at(2, 0.98),
        light_at(1, 0.985),      light_at(1, 1.01)};
    for (size_t k = 0; k < sizeof lights / sizeof *lights; k++) {
        expose(lights[k]);
        TEST_ASSERT_EQUAL_UINT(0, hdr_merge(&frames, &noise, radiance, variance));
        struct figures f = figures_of(radiance);
        /* Four standard errors: 1 in 16,000 would fail by chance, and the seed is fixed. */
        TEST_ASSERT_DOUBLE_WITHIN(4 * f.deviation / sqrt(PIXELS), lights[k], f.mean);
        /* 20,000 samples know a deviation to 0.5 %; where exposures drop out pixel by pixel their number scatters, hence
         * 5 %. */
        TEST_ASSERT_DOUBLE_WITHIN(0.05 * f.deviation, f.deviation, f.predicted);
    }
}

static void weighing_each_sample_by_its_own_noise_would_be_biased(void)
{
    /* The twin of the test above: four exposures of 20 electrons each show what the merge avoids. */
    static float naive[PIXELS];
    double light = 40;
    noise = (struct noise_model){16, 0.5, 1};
    for (int e = 0; e < EXPOSURES; e++) {
        seconds[e] = 0.5;
        exposures[e].exposure_ns = 500000000;
    }
    expose(light);
    (void)hdr_merge(&frames, &noise, radiance, variance);
    for (int i = 0; i < PIXELS; i++) {
        double above = 0;
        double below = 0;
        for (int e = 0; e < EXPOSURES; e++) {
            double value = exposures[e].raw[i] - noise.pedestal;
            double var =
                noise.read_noise * noise.read_noise + 1.0 / 12 + fmax(value, 0) / noise.electrons;
            above += seconds[e] * value / var;
            below += seconds[e] * seconds[e] / var;
        }
        naive[i] = (float)(above / below);
    }
    struct figures ours = figures_of(radiance);
    struct figures theirs = figures_of(naive);
    TEST_ASSERT_TRUE(fabs(theirs.mean - light) > 6 * theirs.deviation / sqrt(PIXELS));
    TEST_ASSERT_TRUE(fabs(ours.mean - light) < 4 * ours.deviation / sqrt(PIXELS));
}

static void dynamic_range_of_10000_is_kept(void)
{
    /* 1/30 s to 2 s and 10 bits, as in the paper: the darkest of 10,000:1 stands out from its noise. */
    double darkest = light_at(0, 0.95) / 1e4;
    expose(darkest);
    (void)hdr_merge(&frames, &noise, radiance, variance);
    TEST_ASSERT_TRUE(figures_of(radiance).deviation < darkest / 3);
}

static void pixels_saturated_at_every_exposure_are_not_measured(void)
{
    expose(light_at(0, 0.2));
    for (int i = 0; i < PIXELS; i += 100) {
        for (int e = 0; e < EXPOSURES; e++) {
            exposures[e].raw[i] = (1 << BITS) - 1 - (i / 100 & 1); /* the guard value counts too */
        }
    }
    TEST_ASSERT_EQUAL_UINT(PIXELS / 100, hdr_merge(&frames, &noise, radiance, variance));
    for (int i = 0; i < PIXELS; i++) {
        TEST_ASSERT_TRUE(isnan(radiance[i]) == (i % 100 == 0));
        TEST_ASSERT_TRUE(isnan(variance[i]) == (i % 100 == 0));
    }
}

static void sensors_without_noise_are_allowed(void)
{
    struct noise_model silent = {16, 0, 0};
    for (int i = 0; i < PIXELS; i++) {
        for (int e = 0; e < EXPOSURES; e++) {
            exposures[e].raw[i] = quantised(100 * seconds[e] + 16);
        }
    }
    TEST_ASSERT_EQUAL_UINT(0, hdr_merge(&frames, &silent, radiance, variance));
    TEST_ASSERT_DOUBLE_WITHIN(0.25, 100, (double)radiance[7]); /* half a raw unit in 2 s */
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(noise_free_frames_give_the_radiance_within_quantisation);
    RUN_TEST(merge_agrees_with_double_reference);
    RUN_TEST(merge_is_unbiased_and_knows_its_variance);
    RUN_TEST(weighing_each_sample_by_its_own_noise_would_be_biased);
    RUN_TEST(dynamic_range_of_10000_is_kept);
    RUN_TEST(pixels_saturated_at_every_exposure_are_not_measured);
    RUN_TEST(sensors_without_noise_are_allowed);
    return UNITY_END();
}
