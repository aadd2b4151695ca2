/* Sessions that are damaged, foreign or badly planned: refused with the place and the remedy, or warned of. */
#include "compare.h"
#include "made.h"
#include "rig/develop/develop.h"
#include "rig/develop/wheel.h"
#include "tests/files.h"
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define PLAN(seed, exposures)                                                                      \
    "seed: " seed "\nblack_frames: 8\nwhite_frames: 2\ndot_spacing: 6\ndot_shift: 3\n"             \
    "dot_size: 2\ngrid_spacing: 7\nwindow: 7\nexposure_turns: " exposures "\n"

enum { DOTS = 4 };

static const char plan_text[] = PLAN("5", "[1, 4, 16, 64]");
static const struct develop_options usual = {.black = BLACK_SUBTRACT,
                                             .confidence = 0.99,
                                             .demosaic = DEMOSAIC_FIT,
                                             .store = NACRE_FLOAT,
                                             .flat = FLAT_PAPER};
static struct made_station station;
static struct develop_report report;
static struct nacre_error error;
static char *folder, *session_path, *scan_path;

/* 16 x 13 points seen by 84 x 74 pixels. */
void setUp(void)
{
    memset(&error, 0, sizeof error);
    station = made_station_usual();
    station.width = 16;
    station.height = 13;
    station.camera_width = 84;
    station.camera_height = 74;
    station.reach = 0.55;
    folder = folder_make();
    TEST_ASSERT_TRUE(asprintf(&scan_path, "%s/scan.exr", folder) > 0);
}

void tearDown(void)
{
    free(session_path);
    free(scan_path);
    session_path = scan_path = NULL;
    folder_remove(folder);
}

static void scan(const char *plan)
{
    session_path = made_session(&station, folder, plan);
}

static void develop(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, develop_session(session_path, &usual, scan_path, NULL, &report, &error),
        error.text);
}

static void developing_fails_with(const char *words)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          develop_session(session_path, &usual, scan_path, NULL, &report, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, words), error.text);
    TEST_ASSERT_TRUE(access(scan_path, F_OK) != 0);
}

static bool is_warned_of(const char *words)
{
    for (int i = 0; i < report.warnings.count; i++) {
        if (strstr(report.warnings.texts[i], words)) {
            return true;
        }
    }
    return false;
}

/* Put grid 3 of another session, measured by `other`, in the place of this one's. */
static void swap_frame(const struct made_station *other, const char *plan)
{
    char *elsewhere = folder_make();
    char *path = made_session(other, elsewhere, plan);
    struct session from = {.path = path};
    struct session to = {.path = session_path};
    char *source = session_pattern_path(&from, (struct pattern){PATTERN_GRID, 3});
    char *target = session_pattern_path(&to, (struct pattern){PATTERN_GRID, 3});
    TEST_ASSERT_EQUAL_INT(0, unlink(target));
    TEST_ASSERT_EQUAL_INT(0, rename(source, target));
    free(source);
    free(target);
    free(path);
    folder_remove(elsewhere);
}

static void frame_of_another_session_is_refused(void)
{
    scan(plan_text);
    swap_frame(&station, PLAN("6", "[1, 4, 16, 64]"));
    developing_fails_with("another session");
    TEST_ASSERT_NOT_NULL(strstr(error.text, "000003.exr"));
}

static void frame_of_another_session_of_the_same_plan_is_refused(void)
{
    struct made_station other = station;
    scan(plan_text);
    other.white[0] = 0.7;
    swap_frame(&other, plan_text);
    developing_fails_with("another session: its nacre.session is");
    TEST_ASSERT_NOT_NULL(strstr(error.text, "000003.exr"));
}

static void frame_of_another_size_is_refused(void)
{
    struct made_station other = station;
    scan(plan_text);
    other.camera_width += 2;
    swap_frame(&other, plan_text);
    developing_fails_with("86 x 74");
    TEST_ASSERT_NOT_NULL(strstr(error.text, "000003.exr"));
}

static void frame_of_another_bayer_order_is_refused(void)
{
    struct made_station other = station;
    scan(plan_text);
    other.bayer = BAYER_BGGR;
    swap_frame(&other, plan_text);
    developing_fails_with("BGGR");
}

static void frame_of_another_depth_is_refused(void)
{
    struct made_station other = station;
    scan(plan_text);
    other.bits = 12;
    swap_frame(&other, plan_text);
    developing_fails_with("12 bits");
}

static void error_of_part_turns_is_that_of_a_wheel_of_three_colours(void)
{
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0, wheel_colour_error(1));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0, wheel_colour_error(60));
    /* Half a turn sees 1/3 of a turn of a colour for 1/6 of the phases, none for 1/6, and all between alike for the
     * rest: variance 1/36 - 2/3 (1/3)^2 2/6 ... in closed form 2 (1/6 (1/6)^2 + 1/3 (1/6)^2 / 3), over a mean of 1/6. */
    double variance = 2 * (1.0 / 6 / 36 + 1.0 / 3 / 36 / 3);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, sqrt(variance) * 6, wheel_colour_error(0.5));
    /* The part turn weighs less the more whole ones there are. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, wheel_colour_error(0.5) / 9, wheel_colour_error(4.5));
}

static void exposures_of_part_turns_are_warned_of(void)
{
    scan(PLAN("5", "[1, 4.5, 16, 64]"));
    develop();
    TEST_ASSERT_TRUE(is_warned_of("4.5 turns"));
    TEST_ASSERT_TRUE(is_warned_of("wrong by 8.3 %"));
    TEST_ASSERT_EQUAL_INT(1, report.warnings.count);
}

static void pedestal_within_the_read_noise_is_warned_of(void)
{
    station.pedestal = 2;
    scan(plan_text);
    develop();
    TEST_ASSERT_TRUE(is_warned_of("pedestal of 2"));
}

static void good_session_is_not_warned_of(void)
{
    scan(plan_text);
    develop();
    TEST_ASSERT_EQUAL_INT(0, report.warnings.count);
}

static void dark_dots_pattern_is_named(void)
{
    scan(plan_text);
    made_measure(&station, session_path, (struct pattern){PATTERN_DOTS, 2}, 16);
    develop();
    TEST_ASSERT_TRUE(is_warned_of("dots pattern 2 shows 0 of"));
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 0, report.align.rms_px);
}

static void dots_patterns_that_show_nothing_are_an_error_that_names_one(void)
{
    scan(plan_text);
    for (int n = 1; n < DOTS; n++) {
        made_measure(&station, session_path, (struct pattern){PATTERN_DOTS, n}, 16);
    }
    developing_fails_with("dots pattern 1 shows 0 of");
}

static void missing_dots_are_placed_in_the_region_where_a_map_is_found(void)
{
    /* 16 patterns of 4 to 9 dots: a third of them is enough for a map and too few to be believed. */
    scan("seed: 5\nblack_frames: 8\nwhite_frames: 2\ndot_spacing: 4\ndot_shift: 1\ndot_size: 2\n"
         "grid_spacing: 7\nwindow: 7\nexposure_turns: [1, 4, 16, 64]\n");
    for (int n = 4; n < 16; n++) {
        made_measure(&station, session_path, (struct pattern){PATTERN_DOTS, n}, 16);
    }
    developing_fails_with("dots pattern 4 shows 0 of");
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "of the region"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "resume the scan"), error.text);
}

static void plan_with_too_few_dots_is_refused(void)
{
    scan("seed: 5\nblack_frames: 8\nwhite_frames: 2\ndot_spacing: 12\ndot_shift: 6\ndot_size: 2\n"
         "grid_spacing: 7\nwindow: 7\nexposure_turns: [1, 4, 16, 64]\n");
    developing_fails_with("narrower dot_spacing");
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(frame_of_another_session_is_refused);
    RUN_TEST(frame_of_another_session_of_the_same_plan_is_refused);
    RUN_TEST(frame_of_another_size_is_refused);
    RUN_TEST(frame_of_another_bayer_order_is_refused);
    RUN_TEST(frame_of_another_depth_is_refused);
    RUN_TEST(error_of_part_turns_is_that_of_a_wheel_of_three_colours);
    RUN_TEST(exposures_of_part_turns_are_warned_of);
    RUN_TEST(pedestal_within_the_read_noise_is_warned_of);
    RUN_TEST(good_session_is_not_warned_of);
    RUN_TEST(dark_dots_pattern_is_named);
    RUN_TEST(dots_patterns_that_show_nothing_are_an_error_that_names_one);
    RUN_TEST(missing_dots_are_placed_in_the_region_where_a_map_is_found);
    RUN_TEST(plan_with_too_few_dots_is_refused);
    return UNITY_END();
}
