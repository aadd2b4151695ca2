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
static struct linearity linearity, dark_linearity;
static struct pixel_map map;
static struct linearity_report report;
static struct nacre_error error;
static float white[PIXELS], black[PIXELS], predicted[PIXELS];
static double light[PIXELS], bend[PIXELS], offset[PIXELS], dark[PIXELS];

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
        bend[i] = offset[i] = dark[i] = 0;
        black[i] = predicted[i] = 1;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, linearity_init(&linearity, PIXELS, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, linearity_init(&dark_linearity, PIXELS, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, pixel_map_init(&map, WIDTH, HEIGHT, frames.bayer, &error));
}

void tearDown(void)
{
    linearity_finish(&linearity);
    linearity_finish(&dark_linearity);
    pixel_map_finish(&map);
    for (int e = 0; e < EXPOSURES; e++) {
        free(exposures[e].raw);
    }
}

/* Expose once at every time; `lamp` is the share of the light. */
static void expose(struct made_random *random, double flicker, double lamp)
{
    for (int e = 0; e < EXPOSURES; e++) {
        double lit = lamp * (1 + flicker * made_normal(random));
        for (int i = 0; i < PIXELS; i++) {
            double value = (light[i] * lit + dark[i]) * (double)exposures[e].exposure_ns * 1e-9;
            value -= bend[i] * value * value;
            value = made_poisson(random, value * noise.electrons) / noise.electrons;
            value += offset[i] + noise.pedestal + made_normal(random);
            exposures[e].raw[i] = (uint16_t)fmin(fmax(floor(value + 0.5), 0), 1023);
        }
    }
}

/* Take white and black frames and judge the pixels. */
static void judge(double flicker)
{
    struct made_random random = {31};
    static double mean[PIXELS];
    static float radiance[PIXELS];
    for (int i = 0; i < PIXELS; i++) {
        mean[i] = 0;
    }
    for (int n = 0; n < FRAMES; n++) {
        expose(&random, flicker, 1);
        (void)hdr_merge(&frames, &noise, radiance, NULL);
        linearity_add(&linearity, &frames, &noise, radiance);
        for (int i = 0; i < PIXELS; i++) {
            mean[i] += (double)radiance[i] / FRAMES;
            white[i] = (float)mean[i];
        }
        expose(&random, flicker, 0);
        (void)hdr_merge(&frames, &noise, radiance, NULL);
        linearity_add(&dark_linearity, &frames, &noise, radiance);
    }
    const struct linearity_evidence evidence = {.white = &linearity,
                                                .black = &dark_linearity,
                                                .noise = &noise,
                                                .longest_seconds = 1e-3 * (1 << (EXPOSURES - 1)),
                                                .mean_white = white,
                                                .black_variance = black,
                                                .foretold_variance = predicted};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, linearity_judge(&evidence, &map, &report, &error));
}

static void good_sensor_has_no_defects(void)
{
    judge(0);
    TEST_ASSERT_EQUAL_UINT(0, report.dead);
    TEST_ASSERT_EQUAL_UINT(0, report.hot);
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

static void expect_class(int x, int y, enum pixel_class wanted)
{
    TEST_ASSERT_EQUAL_STRING(pixel_class_names[wanted],
                             pixel_class_names[map.classes[y * WIDTH + x]]);
}

static void defects_are_found_and_nothing_else(void)
{
    light[10 * WIDTH + 20] = 0;
    light[30 * WIDTH + 40] *= 0.1;
    bend[20 * WIDTH + 30] = 8e-4; /* half the light is lost at the top of the range */
    black[40 * WIDTH + 7] = 40;
    /* The limit is (1 + 1/12) 10 / 4 ms = 2,708 a second. 5 frames know a slope to 1.04 / sqrt(5 (1 + 4 + 16 - 49 / 3) ms^2)
     * = 215, and shot noise of the dark counts adds a quarter: twice the limit is 10 of these above it, half 6 below. */
    dark[15 * WIDTH + 25] = 2 * 2708;
    dark[15 * WIDTH + 35] = 2708 / 2.0;
    /* An offset is known to 1.04 sqrt(21 / (5 (63 - 49))) = 0.57, or as rounding may be alike in all frames
     * (1 + 4 / 13) to 0.65: beyond 1.04 + 5 * 0.65 = 4.3. */
    offset[45 * WIDTH + 50] = 8;
    offset[45 * WIDTH + 40] = 0.5;
    judge(0);
    TEST_ASSERT_EQUAL_UINT(2, report.dead);
    TEST_ASSERT_EQUAL_UINT(1, report.hot);
    TEST_ASSERT_EQUAL_UINT(2, report.nonlinear);
    TEST_ASSERT_EQUAL_UINT(1, report.noisy);
    expect_class(20, 10, PIXEL_DEAD);
    expect_class(40, 30, PIXEL_DEAD);
    expect_class(30, 20, PIXEL_NONLINEAR);
    expect_class(7, 40, PIXEL_NOISY);
    expect_class(25, 15, PIXEL_HOT);
    expect_class(50, 45, PIXEL_NONLINEAR);
    TEST_ASSERT_EQUAL_UINT(PIXELS - 6, pixel_map_count(&map, PIXEL_GOOD));
    TEST_ASSERT_DOUBLE_WITHIN(5 * 270, dark[15 * WIDTH + 25], (double)map.dark[15 * WIDTH + 25]);
}

static void light_that_is_everywhere_is_not_hot(void)
{
    /* A projector's black, ten times the limit: what neighbours have too is no defect. */
    for (int i = 0; i < PIXELS; i++) {
        dark[i] = 27080 * (1 - 0.003 * (i % WIDTH));
    }
    dark[15 * WIDTH + 25] += 15 * 2708; /* beyond limit and twice the light */
    dark[15 * WIDTH + 35] += 5 * 2708;  /* below that */
    judge(0);
    TEST_ASSERT_EQUAL_UINT(1, report.hot);
    expect_class(25, 15, PIXEL_HOT);
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

/* A lit area that is turned a little ends on the frame's side, where few neighbours are left to show it. */
static void lit_area_that_ends_at_the_side_of_the_frame_is_not_dead(void)
{
    for (int i = 0; i < PIXELS; i++) {
        light[i] *= 20 * (i % WIDTH) >= i / WIDTH - 20 ? 1 : 0;
    }
    light[10 * WIDTH + 2] = 0;
    judge(0);
    TEST_ASSERT_EQUAL_UINT(1, report.dead);
    expect_class(2, 10, PIXEL_DEAD);
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
    RUN_TEST(light_that_is_everywhere_is_not_hot);
    RUN_TEST(flickering_lamp_is_not_taken_for_bad_pixels);
    RUN_TEST(bent_sensor_shows_in_the_deviation);
    RUN_TEST(dark_surround_is_not_dead);
    RUN_TEST(lit_area_that_ends_at_the_side_of_the_frame_is_not_dead);
    RUN_TEST(one_exposure_tells_nothing_of_linearity);
    return UNITY_END();
}
