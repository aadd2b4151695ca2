/* Feature vectors against closed forms. */
#include "sample.h"

#include "factor/falloff.h"

#include <math.h>
#include <stdlib.h>
#include <unity.h>

void setUp(void)
{
}

void tearDown(void)
{
}

static void fill(float *window, int size, double length, double angle_weight)
{
    int half = size / 2;
    for (int i = 0; i < size * size; i++) {
        int dx = i % size - half, dy = i / size - half;
        double modulation = 1 + angle_weight * (cos(atan2(dy, dx)) - 1);
        window[i] = (float)(exp(-hypot(dx, dy) / length) * modulation);
    }
}

static void look(const float *window, int size, float *radii)
{
    struct nacre_error error = {0};
    struct circles *circles = NULL;
    TEST_ASSERT_EQUAL(NACRE_OK, circles_new(size, &circles, &error));
    features_of_window(circles, window, radii);
    circles_free(circles);
}

/* Along the axes no interpolation takes place, and beside them that of a convex fall-off lies above it: by at most an
 * eighth of its second derivative in each direction, (1/8 + 1/8) / length^2 relative. */
static void a_radial_exponential_comes_back_as_itself(void)
{
    float window[25 * 25], radii[13];
    double length = 6;
    fill(window, 25, length, 0);
    look(window, 25, radii);
    for (int r = 0; r <= 12; r++) {
        double expected = exp(-r / length);
        TEST_ASSERT_TRUE(radii[r] >= (float)expected * 0.999999F);
        TEST_ASSERT_DOUBLE_WITHIN(expected * 0.25 / (length * length), expected, (double)radii[r]);
    }
}

/* A fall-off that is brightest in one direction, along the x axis: the maximum over the angle is that direction's. */
static void the_brightest_direction_counts(void)
{
    float window[11 * 11], radii[6];
    fill(window, 11, 5, 0.4);
    look(window, 11, radii);
    for (int r = 0; r <= 5; r++) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, exp(-r / 5.0), (double)radii[r]);
    }
}

static void unmeasured_directions_are_passed_over(void)
{
    float window[11 * 11], radii[6];
    fill(window, 11, 5, 0);
    for (int i = 0; i < 11 * 11; i++) {
        window[i] = i % 11 > 5 ? NAN : window[i];
    }
    look(window, 11, radii);
    for (int r = 0; r <= 5; r++) {
        /* The negative x axis is measured. */
        TEST_ASSERT_DOUBLE_WITHIN(0.05 * exp(-r / 5.0), exp(-r / 5.0), (double)radii[r]);
    }
}

static void a_window_without_measurement_has_no_fall_off(void)
{
    float window[9], radii[2];
    for (int i = 0; i < 9; i++) {
        window[i] = NAN;
    }
    look(window, 3, radii);
    TEST_ASSERT_TRUE(isnan(radii[0]) && isnan(radii[1]));
}

/* Responses that differ in albedo alone have equal features, to float rounding; lengths do differ. */
static void features_do_not_depend_on_albedo(void)
{
    struct nacre_error error = {0};
    struct sample sample = sample_new(40, 1, 3, 25, 0);
    struct features features;
    for (int x = 0; x < 40; x++) {
        for (int c = 0; c < 3; c++) {
            float *window = sample_at(&sample, x, 0) + c * 625;
            fill(window, 25, x < 2 ? 2 : 4, 0);
            for (int i = 0; i < 625; i++) {
                window[i] *= x % 2 ? 0.01F * (float)(c + 1) : 1;
            }
        }
    }
    struct responses responses = sample_load(&sample, 8);
    TEST_ASSERT_EQUAL(NACRE_OK, features_new(&responses, &features, &error));
    TEST_ASSERT_EQUAL_UINT64(40, features.count);
    TEST_ASSERT_EQUAL_UINT64(39, features.length);
    for (size_t i = 0; i < features.length; i++) {
        float *v = features.values + i;
        TEST_ASSERT_FLOAT_WITHIN(1e-6F, v[0], v[features.length]);
        TEST_ASSERT_FLOAT_WITHIN(1e-6F, v[2 * features.length], v[3 * features.length]);
    }
    TEST_ASSERT_TRUE(features.values[0] > features.values[2 * features.length] + 0.05F);
    features_finish(&features);
    responses_finish(&responses);
    sample_finish(&sample);
}

static void points_without_measurement_have_no_feature_vector(void)
{
    struct nacre_error error = {0};
    struct sample sample = sample_new(5, 4, 1, 3, 0);
    struct features features;
    for (int i = 0; i < 9; i++) {
        sample_at(&sample, 2, 1)[i] = NAN;
    }
    struct responses responses = sample_load(&sample, 8);
    TEST_ASSERT_EQUAL(NACRE_OK, features_new(&responses, &features, &error));
    TEST_ASSERT_EQUAL_UINT64(19, features.count);
    for (size_t i = 0; i < features.count; i++) {
        TEST_ASSERT_TRUE(features.points[i] != 7);
        for (size_t j = 0; j < features.length; j++) {
            TEST_ASSERT_TRUE(isfinite(features.values[i * features.length + j]));
        }
    }
    features_finish(&features);
    responses_finish(&responses);
    sample_finish(&sample);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(a_radial_exponential_comes_back_as_itself);
    RUN_TEST(the_brightest_direction_counts);
    RUN_TEST(unmeasured_directions_are_passed_over);
    RUN_TEST(a_window_without_measurement_has_no_fall_off);
    RUN_TEST(features_do_not_depend_on_albedo);
    RUN_TEST(points_without_measurement_have_no_feature_vector);
    return UNITY_END();
}
