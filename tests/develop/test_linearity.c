/* Regression over the exposures, and the map of defect pixels. */
#include "made.h"
#include "rig/develop/linearity.h"
#include "unity.h"

#include <math.h>
#include <stdlib.h>

enum { WIDTH = 60, HEIGHT = 50, PIXELS = WIDTH * HEIGHT, EXPOSURES = 3, FRAMES = 5 };

static const struct noise_model noise = {20, 1, 10};
static struct exposure exposures[EXPOSURES];
static struct pattern_frames frames;
static struct linearity linearity;
static struct linearity_report report;
static struct nacre_error error;
static float white[PIXELS], black[PIXELS], predicted[PIXELS];
static double light[PIXELS], bend[PIXELS], offset[PIXELS];
static bool defect[PIXELS];

void setUp(void)
{
    frames = (struct pattern_frames){.width = WIDTH,
                                     .height = HEIGHT,
                                     .bits = 10,
                                     .bayer = BAYER_GRBG,
                                     .count = EXPOSURES,
                                     .exposures = exposures};
    for (int e = 0; e < EXPOSURES; e++) {
        exposures[e].exposure_ns = 1000000LL << e;
        exposures[e].raw = calloc(PIXELS, sizeof *exposures[e].raw);
    }
    for (int i = 0; i < PIXELS; i++) {
        light[i] = 150000 * (1 - 0.003 * (i % WIDTH));
        bend[i] = offset[i] = 0;
        black[i] = predicted[i] = 1;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, linearity_init(&linearity, PIXELS, &error));
}

void tearDown(void)
{
    linearity_finish(&linearity);
    for (int e = 0; e < EXPOSURES; e++) {
        free(exposures[e].raw);
    }
}

/* Take white frames and judge the pixels. */
static void judge(double flicker)
{
    struct made_random random = {31};
    static double mean[PIXELS];
    for (int i = 0; i < PIXELS; i++) {
        mean[i] = 0;
    }
    for (int n = 0; n < FRAMES; n++) {
        static float radiance[PIXELS];
        for (int e = 0; e < EXPOSURES; e++) {
            double lamp = 1 + flicker * made_normal(&random);
            for (int i = 0; i < PIXELS; i++) {
                double value = light[i] * lamp * (double)exposures[e].exposure_ns * 1e-9;
                value -= bend[i] * value * value;
                value = made_poisson(&random, value * noise.electrons) / noise.electrons;
                value += offset[i] + noise.pedestal + made_normal(&random);
                exposures[e].raw[i] = (uint16_t)fmin(fmax(floor(value + 0.5), 0), 1023);
            }
        }
        (void)hdr_merge(&frames, &noise, radiance, NULL);
        linearity_add(&linearity, &frames, &noise, radiance);
        for (int i = 0; i < PIXELS; i++) {
            mean[i] += (double)radiance[i] / FRAMES;
            white[i] = (float)mean[i];
        }
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, linearity_judge(&linearity, white, black, predicted, WIDTH,
                                                    HEIGHT, frames.bayer, defect, &report, &error));
}

static void good_sensor_has_no_defects(void)
{
    judge(0);
    TEST_ASSERT_EQUAL_UINT(0, report.dead);
    TEST_ASSERT_EQUAL_UINT(0, report.nonlinear);
    TEST_ASSERT_EQUAL_UINT(0, report.noisy);
    /* 3,000 pixels and 5 frames know the mean of an exposure to some 10^-4. */
    TEST_ASSERT_DOUBLE_WITHIN(5e-4, 0, report.deviation);
}

static void line_has_the_slope_of_the_light_and_the_offset_of_the_pixel(void)
{
    double slope;
    double found;
    double chi;
    int freedom;
    offset[1234] = 8;
    judge(0);
    linearity_line(&linearity, 1234, &slope, &found, &chi, &freedom);
    TEST_ASSERT_EQUAL_INT(EXPOSURES * FRAMES - 2, freedom);
    /* 15 values of about 8 raw units deviation at 600: offset to some 3, slope to 1 %. */
    TEST_ASSERT_DOUBLE_WITHIN(9, 8, found);
    TEST_ASSERT_DOUBLE_WITHIN(0.03 * light[1234], light[1234], slope);
}

static void defects_are_found_and_nothing_else(void)
{
    light[10 * WIDTH + 20] = 0;
    light[30 * WIDTH + 40] *= 0.1;
    bend[20 * WIDTH + 30] = 8e-4; /* half the light is lost at the top of the range */
    black[40 * WIDTH + 7] = 40;
    judge(0);
    TEST_ASSERT_EQUAL_UINT(2, report.dead);
    TEST_ASSERT_EQUAL_UINT(1, report.nonlinear);
    TEST_ASSERT_EQUAL_UINT(1, report.noisy);
    size_t marked = 0;
    for (int i = 0; i < PIXELS; i++) {
        marked += defect[i] ? 1 : 0;
    }
    TEST_ASSERT_EQUAL_UINT(4, marked);
    TEST_ASSERT_TRUE(defect[10 * WIDTH + 20] && defect[30 * WIDTH + 40] &&
                     defect[20 * WIDTH + 30] && defect[40 * WIDTH + 7]);
}

static void flickering_lamp_is_not_taken_for_bad_pixels(void)
{
    judge(0.05);
    TEST_ASSERT_EQUAL_UINT(0, report.nonlinear);
    /* It does show in the mean of the exposures. */
    TEST_ASSERT_TRUE(report.deviation > 2e-3);
}

static void bent_sensor_shows_in_the_deviation(void)
{
    for (int i = 0; i < PIXELS; i++) {
        bend[i] = 1e-4;
    }
    judge(0);
    /* 3 % at half the range against 6 % at its top, about their mean. */
    TEST_ASSERT_TRUE(report.deviation > 5e-3);
}

static void dark_surround_is_not_dead(void)
{
    for (int i = 0; i < PIXELS; i++) {
        bool inside = i % WIDTH > 9 && i % WIDTH < 50 && i / WIDTH > 9 && i / WIDTH < 40;
        light[i] *= inside ? 1 : 0;
    }
    judge(0);
    TEST_ASSERT_EQUAL_UINT(0, report.dead);
}

static void one_exposure_tells_nothing_of_linearity(void)
{
    double slope;
    double found;
    double chi;
    int freedom;
    frames.count = 1;
    judge(0);
    linearity_line(&linearity, 0, &slope, &found, &chi, &freedom);
    TEST_ASSERT_TRUE(isnan(slope) && isnan(found));
    TEST_ASSERT_TRUE(isnan(report.deviation));
    TEST_ASSERT_EQUAL_UINT(0, report.nonlinear);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(good_sensor_has_no_defects);
    RUN_TEST(line_has_the_slope_of_the_light_and_the_offset_of_the_pixel);
    RUN_TEST(defects_are_found_and_nothing_else);
    RUN_TEST(flickering_lamp_is_not_taken_for_bad_pixels);
    RUN_TEST(bent_sensor_shows_in_the_deviation);
    RUN_TEST(dark_surround_is_not_dead);
    RUN_TEST(one_exposure_tells_nothing_of_linearity);
    return UNITY_END();
}
