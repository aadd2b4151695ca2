/* Tests of nacre view on a virtual station: what it finds is what the station file says. */
#include "base/picture.h"
#include "tests/cmd/spawn.h"
#include "tests/cmd/stations.h"
#include "tests/cmd/told.h"
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 96, HEIGHT = 80 };

static char *folder, *station, *output;
static struct spawned ran;
static json_t *result;

void setUp(void)
{
    folder = folder_make();
    stations_write(folder);
    station = path_join(folder, "station.yaml");
    output = path_join(folder, "view.png");
    result = NULL;
    ran = (struct spawned){0};
}

void tearDown(void)
{
    json_decref(result);
    spawned_finish(&ran);
    free(station);
    free(output);
    folder_remove(folder);
}

static void view(const char *pattern, const char *exposure)
{
    const char *const arguments[] = {
        NACRE,    "view",   "--station", station, "-o",
        output,   "--json", "--pattern", pattern, exposure ? "--exposure" : NULL,
        exposure, NULL};
    json_decref(result);
    spawned_finish(&ran);
    ran = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    result = told_parse(ran.output);
}

static double number(const char *key)
{
    return told_number(result, key);
}

static int region(const char *key)
{
    return (int)json_integer_value(json_object_get(json_object_get(result, "region"), key));
}

/* Share of the picture's pixels that have the colour. */
static double share_of(float red, float green, float blue)
{
    struct picture picture;
    struct nacre_error error;
    size_t count = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_read(output, &picture, &error), error.text);
    TEST_ASSERT_EQUAL_INT(WIDTH, picture.width);
    TEST_ASSERT_EQUAL_INT(HEIGHT, picture.height);
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++) {
        const float *p = picture.rgb + 3 * i;
        count +=
            fabsf(p[0] - red) < 0.02F && fabsf(p[1] - green) < 0.02F && fabsf(p[2] - blue) < 0.02F;
    }
    picture_finish(&picture);
    return (double)count / (WIDTH * HEIGHT);
}

/* 20 x 16 points of 4 pixels, 80 x 64 about the middle of 96 x 80, seen from 12 degrees above: at most 5 % larger or
 * smaller at an edge. The region found is good to 2 pixels. */
static void region_is_what_the_projector_lights(void)
{
    view("white", NULL);
    const json_t *corners = json_object_get(json_object_get(result, "region"), "corners");
    const double expected[4][2] = {{8, 8}, {88, 8}, {88, 72}, {8, 72}};
    TEST_ASSERT_EQUAL_INT(4, json_array_size(corners));
    for (size_t i = 0; i < 4; i++) {
        for (size_t k = 0; k < 2; k++) {
            TEST_ASSERT_DOUBLE_WITHIN(
                5, expected[i][k],
                json_number_value(json_array_get(json_array_get(corners, i), k)));
        }
    }
    TEST_ASSERT_EQUAL_INT(0, (region("left") | region("top") | region("width") | region("height")) &
                                 1);
    TEST_ASSERT_TRUE(region("left") <= 8 && region("left") + region("width") >= 88);
    TEST_ASSERT_TRUE(region("top") <= 10 && region("top") + region("height") >= 70);
    TEST_ASSERT_TRUE(region("left") + region("width") <= WIDTH);
    TEST_ASSERT_TRUE(region("top") + region("height") <= HEIGHT);
    /* The outline: some 280 of 7680 pixels, each once. */
    TEST_ASSERT_DOUBLE_WITHIN(0.012, 280. / 7680, share_of(0.1F, 1, 0.1F));
    TEST_ASSERT_EQUAL_DOUBLE(0, number("saturated"));
    TEST_ASSERT_EQUAL_DOUBLE(0, share_of(1, 0, 1));
}

/* By calibration the corners are those of the camera's map, good to a tenth of a pixel: the projector's picture is centred, and
 * narrower at its far edge, the upper one. */
static void region_is_known_by_calibration(void)
{
    char *session = path_join(folder, "session");
    const char *const scan[] = {NACRE, "scan", session, "--station", station, NULL};
    const char *const look[] = {NACRE,  "view",          "--station", station,  "-o",
                                output, "--calibration", session,     "--json", NULL};
    double x[4];
    double y[4];
    ran = spawn(scan, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    spawned_finish(&ran);
    ran = spawn(look, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    result = told_parse(ran.output);
    const json_t *corners = json_object_get(json_object_get(result, "region"), "corners");
    for (size_t i = 0; i < 4; i++) {
        x[i] = json_number_value(json_array_get(json_array_get(corners, i), 0));
        y[i] = json_number_value(json_array_get(json_array_get(corners, i), 1));
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.1, WIDTH, x[0] + x[1]);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, WIDTH, x[3] + x[2]);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, y[0], y[1]);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, y[2], y[3]);
    TEST_ASSERT_DOUBLE_WITHIN(1, 80, (x[1] - x[0] + x[2] - x[3]) / 2);
    /* cos 12 of 64 pixels */
    TEST_ASSERT_DOUBLE_WITHIN(0.3, 62.6, y[3] - y[0]);
    free(session);
}

static void saturated_pixels_are_counted_and_marked(void)
{
    view("white", "20000");
    TEST_ASSERT_TRUE(number("saturated") > 0.5);
    /* All but those under the outline. */
    TEST_ASSERT_DOUBLE_WITHIN(0.05, number("saturated"), share_of(1, 0, 1));
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 20000, number("exposure_ms"));
}

static void exposure_is_whole_turns(void)
{
    view("white", "40");
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 1000 / 30., number("exposure_ms"));
    view("white", "1");
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 1000 / 30., number("exposure_ms"));
}

static void focus_falls_as_the_lens_is_defocused(void)
{
    view("dots", NULL);
    double sharp = number("focus");
    stations_change(station, "pixels_per_point: 4}", "pixels_per_point: 4, defocus_px: 4}");
    view("dots", NULL);
    double blurred = number("focus");
    TEST_ASSERT_TRUE(sharp > 0 && blurred > 0);
    /* A circle of 4 pixels blurs edges of one over four. */
    TEST_ASSERT_TRUE(blurred < 0.7 * sharp);
}

static void station_in_the_dark_has_no_region(void)
{
    stations_change(station, "pixels_per_point: 4}", "pixels_per_point: 4, full_scale_s: 90000}");
    view("white", NULL);
    TEST_ASSERT_TRUE(json_is_null(json_object_get(result, "region")));
    TEST_ASSERT_EQUAL_DOUBLE(0, share_of(0.1F, 1, 0.1F));
}

static void grey_cameras_are_looked_through_too(void)
{
    stations_change(station, "bayer: RGGB", "bayer: mono");
    view("grid", NULL);
    TEST_ASSERT_TRUE(region("width") >= 76);
    TEST_ASSERT_TRUE(number("focus") > 0);
}

static void values_to_keep_are_printed(void)
{
    const char *const arguments[] = {NACRE, "view", "--station", station, "-o", output, NULL};
    ran = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, ran.status, ran.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(ran.output, "keep       camera: {width: "), ran.output);
}

static void grids_of_regions_are_shown(void)
{
    char *plan = path_join(folder, "plan.yaml");
    size_t size = 0;
    char *text = (char *)file_read(plan, &size);
    char *more = NULL;
    TEST_ASSERT_TRUE(asprintf(&more,
                              "%sregions: [{x: 0, y: 0, width: 20, height: 8, spacing: 13, "
                              "longest_turns: 8}]\n",
                              text) > 0);
    text_write(plan, more);
    view("grid", NULL);
    free(more);
    free(text);
    free(plan);
}

static void picture_of_unknown_kind_is_refused(void)
{
    const char *const arguments[] = {NACRE, "view", "--station", station, "-o", "/tmp/x.bmp", NULL};
    ran = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT(1, ran.status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(ran.errors, "/tmp/x.bmp"), ran.errors);
}

static void output_is_needed(void)
{
    const char *const arguments[] = {NACRE, "view", "--station", station, NULL};
    ran = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT(2, ran.status);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(region_is_what_the_projector_lights);
    RUN_TEST(region_is_known_by_calibration);
    RUN_TEST(saturated_pixels_are_counted_and_marked);
    RUN_TEST(exposure_is_whole_turns);
    RUN_TEST(focus_falls_as_the_lens_is_defocused);
    RUN_TEST(station_in_the_dark_has_no_region);
    RUN_TEST(grey_cameras_are_looked_through_too);
    RUN_TEST(values_to_keep_are_printed);
    RUN_TEST(grids_of_regions_are_shown);
    RUN_TEST(picture_of_unknown_kind_is_refused);
    RUN_TEST(output_is_needed);
    return UNITY_END();
}
