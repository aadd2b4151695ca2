/* From white and dots frames to the homography. */
#include "made.h"
#include "rig/develop/align.h"
#include "rig/develop/quad.h"
#include "unity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PATTERNS = 9, SPACING = 8, SHIFT = 3, SIDE = 2 };

static struct made_station station;
static struct made_random noise;
static struct nacre_error error;
static struct dots_view views[PATTERNS];
static float *white;
static struct homography truth;

void setUp(void)
{
    station = made_station_usual();
    noise = (struct made_random){17};
}

void tearDown(void)
{
    for (int n = 0; n < PATTERNS; n++) {
        dots_view_finish(&views[n]);
    }
    free(white);
    white = NULL;
}

static size_t pixel_count(void)
{
    return (size_t)station.camera_width * (size_t)station.camera_height;
}

/* Turn the camera in one of eight ways: a multiple of 90 degrees, and mirrored from 4 on. */
static void turn_camera(int way)
{
    for (int turn = 0; turn < way % 4; turn++) {
        /* (u, v) goes to (height - v, u). */
        double *m = station.map;
        int height = station.camera_height;
        for (int i = 0; i < 3; i++) {
            double u = m[i];
            m[i] = height * m[6 + i] - m[3 + i];
            m[3 + i] = u;
        }
        station.camera_height = station.camera_width;
        station.camera_width = height;
    }
    for (int i = 0; way >= 4 && i < 3; i++) {
        station.map[i] = station.camera_width * station.map[6 + i] - station.map[i];
    }
    memcpy(truth.m, station.map, sizeof truth.m);
}

/* The picture of levels on the white layer with noise of `deviation` of the brightest. */
static float *picture(const uint8_t *levels, double deviation)
{
    float *radiosity =
        malloc(3 * (size_t)station.width * (size_t)station.height * sizeof *radiosity);
    double *signal = calloc(pixel_count() + 1, sizeof *signal);
    float *seen = calloc(pixel_count() + 1, sizeof *seen);
    made_light(&station, levels, true, radiosity);
    made_signal(&station, radiosity, signal);
    for (size_t i = 0; i < pixel_count(); i++) {
        seen[i] = (float)(signal[i] + deviation * station.gain[1] * made_normal(&noise));
    }
    free(radiosity);
    free(signal);
    return seen;
}

static void draw_dots(int pattern, uint8_t *levels)
{
    for (int i = 0; i < station.width * station.height; i++) {
        int x = i % station.width - pattern % 3 * SHIFT;
        int y = i / station.width - pattern / 3 * SHIFT;
        bool lit = x >= 0 && y >= 0 && x % SPACING < SIDE && y % SPACING < SIDE;
        levels[i] = lit ? 255 : 0;
    }
}

/* Everything the alignment gets, as calibration makes it. */
static void take_pictures(double deviation)
{
    size_t points = (size_t)station.width * (size_t)station.height;
    uint8_t *levels = malloc(points);
    memset(levels, 255, points);
    white = picture(levels, deviation / 2);
    for (int n = 0; n < PATTERNS; n++) {
        draw_dots(n, levels);
        float *lit = picture(levels, deviation);
        for (size_t i = 0; i < pixel_count(); i++) {
            int channel = bayer_channel(station.bayer, (int)i % station.camera_width,
                                        (int)i / station.camera_width);
            bool enough = (double)white[i] > 0.1 * station.gain[channel];
            lit[i] = enough ? lit[i] / white[i] : NAN;
        }
        TEST_ASSERT_EQUAL_INT(NACRE_OK,
                              align_find_drawn(levels, station.width, station.height,
                                               &views[n].drawn, &views[n].drawn_count, &error));
        TEST_ASSERT_EQUAL_INT(NACRE_OK, dots_find(lit, station.camera_width, station.camera_height,
                                                  (double)SIDE * SIDE / SPACING / SPACING,
                                                  &views[n].seen, &error));
        free(lit);
    }
    free(levels);
}

static int find(struct camera_map *map, struct align_report *report)
{
    struct point corners[4];
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK,
                                  quad_find(white, station.camera_width, station.camera_height,
                                            station.bayer, corners, &error),
                                  error.text);
    return align_dots(views, PATTERNS, corners, station.width, station.height,
                      (struct point){station.camera_width / 2.0, station.camera_height / 2.0}, map,
                      report, &error);
}

/* Where the made lens shows what an ideal one shows at `p`. */
static struct point distorted(struct point p)
{
    double x = p.x - station.camera_width / 2.0 - station.lens_x;
    double y = p.y - station.camera_height / 2.0 - station.lens_y;
    double unit = hypot(station.camera_width, station.camera_height) / 2;
    double stretch = station.lens * (x * x + y * y) / (unit * unit);
    return (struct point){p.x + stretch * x, p.y + stretch * y};
}

/* Largest distance between found and true image of a surface point, in camera pixels.
 *
 * By the linearised fit of these 156 dots it is, where centres err by s in each axis and independently, at the median and in
 * all but 1 of 20, 100 and 1000 draws at most
 *     0.71 s, 1.20 s, 1.43 s and 1.76 s without distortion,
 *     1.04 s, 2.14 s, 2.66 s and 3.11 s with k1,
 *     1.76 s, 4.14 s, 5.88 s and 7.52 s with k1, k2 and the centre:
 * the region's corners, which no dot reaches, are the worst. Of s, noise of 2 % makes 0.018 and one of 0.5 % 0.0045 (below).
 * The made camera's 8 x 8 places move an edge by up to 1/16, evenly: 0.036 in a row of pixels; a centre, the mean of two
 * edges of 9 rows, of which 1 to 4 that follow each other err alike, by 0.036 / sqrt(2) / sqrt(9 to 9 / 4): 0.009 to 0.017,
 * here called 0.013. Every test is one draw, or a few, whose noise is always the same. */
static double worst_distance(const struct camera_map *map)
{
    double worst = 0;
    for (int y = 0; y <= station.height; y += 4) {
        for (int x = 0; x <= station.width; x += 4) {
            struct point p = camera_map_apply(map, (struct point){x, y});
            struct point q = distorted(homography_apply(&truth, (struct point){x, y}));
            worst = fmax(worst, hypot(p.x - q.x, p.y - q.y));
        }
    }
    return worst;
}

static void lit_quadrilateral_is_found_to_a_pixel_and_a_half(void)
{
    struct point corners[4];
    turn_camera(0);
    take_pictures(0.01);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, quad_find(white, station.camera_width, station.camera_height,
                                              station.bayer, corners, &error));
    const struct point surface[4] = {
        {0, 0}, {station.width, 0}, {station.width, station.height}, {0, station.height}};
    for (int i = 0; i < 4; i++) {
        /* A corner pixel is lit to a quarter: half a diagonal, and noise decides on one more pixel. */
        struct point true_corner = homography_apply(&truth, surface[i]);
        TEST_ASSERT_DOUBLE_WITHIN(1.5, true_corner.x, corners[i].x);
        TEST_ASSERT_DOUBLE_WITHIN(1.5, true_corner.y, corners[i].y);
    }
}

static void dark_frame_has_no_quadrilateral(void)
{
    struct point corners[4];
    white = calloc(pixel_count(), sizeof *white);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          quad_find(white, station.camera_width, station.camera_height,
                                    station.bayer, corners, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "no lit area"));
}

static void shadow_across_the_region_is_refused(void)
{
    struct point corners[4];
    turn_camera(0);
    take_pictures(0);
    for (int y = 0; y < station.camera_height; y++) {
        for (int x = 0; x < station.camera_width; x++) {
            /* A quarter of the region lies in shadow: an L is left. */
            if (x > station.camera_width / 2 && y > station.camera_height / 2) {
                white[y * station.camera_width + x] = 0;
            }
        }
    }
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          quad_find(white, station.camera_width, station.camera_height,
                                    station.bayer, corners, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "quadrilateral"));
}

static void drawn_dots_are_listed_and_those_at_the_border_marked(void)
{
    size_t cut = 0;
    turn_camera(0);
    take_pictures(0);
    /* 40 x 36 points, every 8: 5 x 5 of the first pattern, of which those at the left and upper border are cut. */
    TEST_ASSERT_EQUAL_UINT(25, views[0].drawn_count);
    for (size_t i = 0; i < views[0].drawn_count; i++) {
        const struct drawn_dot *dot = &views[0].drawn[i];
        TEST_ASSERT_EQUAL_INT(SIDE, dot->right - dot->left);
        TEST_ASSERT_EQUAL_INT(SIDE, dot->bottom - dot->top);
        cut += dot->cut ? 1 : 0;
    }
    TEST_ASSERT_EQUAL_UINT(9, cut);
}

static void map_is_found_to_a_twentieth_of_a_pixel_in_noise(void)
{
    struct camera_map map;
    struct align_report report;
    turn_camera(0);
    take_pictures(0.02);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, find(&map, &report), error.text);
    /* A dot covers some 80 pixels plus margin, 170 in all, with noise of 2 % (3 % of red and blue) of its level: its
     * centroid scatters by 0.03 sqrt(sum of squared distances = 170 * 14) / 80 = 0.018 in each axis. */
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 0, report.rms_px);
    /* 0.018 and 0.013 are 0.022, of which 1.43. */
    TEST_ASSERT_DOUBLE_WITHIN(0.03, 0, worst_distance(&map));
    TEST_ASSERT_TRUE(report.matched + report.rejected >= report.dots * 95 / 100);
    TEST_ASSERT_TRUE(report.rejected * 20 <= report.dots);
}

static void every_turn_and_mirror_of_the_camera_is_recognised(void)
{
    for (int way = 0; way < 8; way++) {
        struct camera_map map;
        struct align_report report;
        station = made_station_usual();
        turn_camera(way);
        take_pictures(0.005);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, find(&map, &report), error.text);
        /* A wrong way is off by points; 0.0045 and, at most, 0.017 are 0.0176, of which 1.76. */
        TEST_ASSERT_DOUBLE_WITHIN(0.03, 0, worst_distance(&map));
        tearDown();
    }
}

static void lens_without_distortion_is_left_ideal(void)
{
    struct camera_map map;
    struct align_report report;
    turn_camera(0);
    take_pictures(0.02);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, find(&map, &report), error.text);
    TEST_ASSERT_EQUAL_INT(LENS_IDEAL, report.lens);
    TEST_ASSERT_EQUAL_DOUBLE(0, report.lens_px);
    for (int i = 0; i < ALIGN_TILES * ALIGN_TILES; i++) {
        /* Some 20 dots each: within a third of the mean of all. */
        double tile = report.map_px[i / ALIGN_TILES][i % ALIGN_TILES];
        TEST_ASSERT_TRUE(tile > report.rms_px / 2 && tile < 1.7 * report.rms_px);
    }
}

static void radial_distortion_is_found_where_there_is_some(void)
{
    /* Barrel and cushion of up to 2.4 and 1.2 px at the region's corners. */
    const double strengths[] = {-0.03, 0.015};
    for (int k = 0; k < 2; k++) {
        struct camera_map map;
        struct align_report report;
        station = made_station_usual();
        station.lens = strengths[k];
        turn_camera(0);
        take_pictures(0.005);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, find(&map, &report), error.text);
        TEST_ASSERT_EQUAL_INT(LENS_RADIAL, report.lens);
        /* 0.0045 and 0.013 are 0.0138, of which 3.11, rounded down. */
        TEST_ASSERT_DOUBLE_WITHIN(0.05, 0, report.rms_px);
        TEST_ASSERT_DOUBLE_WITHIN(0.04, 0, worst_distance(&map));
        TEST_ASSERT_TRUE(report.lens_px > 30 * fabs(strengths[k]));
        tearDown();
    }
}

static void distortion_about_another_centre_is_found(void)
{
    struct camera_map map;
    struct align_report report;
    station.lens = -0.05;
    station.lens_x = 30;
    station.lens_y = -20;
    turn_camera(0);
    take_pictures(0.005);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, find(&map, &report), error.text);
    TEST_ASSERT_EQUAL_INT(LENS_SHIFTED, report.lens);
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 0, report.rms_px);
    /* 0.0138 times 4.14, rounded up. */
    TEST_ASSERT_DOUBLE_WITHIN(0.06, 0, worst_distance(&map));
}

static void dots_that_moved_are_rejected(void)
{
    struct camera_map map;
    struct align_report report;
    turn_camera(0);
    take_pictures(0.005);
    for (int n = 0; n < PATTERNS; n++) {
        /* As if dust lay on two dots of every pattern. */
        views[n].seen.centres[3].x += 1.5;
        views[n].seen.centres[7].y -= 2;
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, find(&map, &report), error.text);
    TEST_ASSERT_TRUE(report.rejected >= 10);
    /* 0.0138 times 1.43. */
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 0, worst_distance(&map));
}

static void centres_know_no_vignetting_and_no_colour(void)
{
    /* The same picture with strong vignetting and very different colour filters moves no centre. */
    struct camera_map map;
    struct align_report report;
    station.vignetting = 0.6;
    station.gain[0] /= 4;
    station.gain[2] *= 3;
    turn_camera(0);
    take_pictures(0);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, find(&map, &report), error.text);
    /* What is left is that the made camera samples its pixels at 8 x 8 places: at most 0.017 sqrt(2), and 0.013 times 1.43. */
    TEST_ASSERT_DOUBLE_WITHIN(0.025, 0, report.rms_px);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 0, worst_distance(&map));
}

static void dots_not_seen_are_an_error_that_says_so(void)
{
    struct camera_map map;
    struct align_report report;
    turn_camera(0);
    take_pictures(0);
    for (int n = 0; n < PATTERNS; n++) {
        views[n].seen.count = n == 0 ? 3 : 0;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, find(&map, &report));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "3 were seen"));
}

static void dots_of_another_spacing_are_refused(void)
{
    struct camera_map map;
    struct align_report report;
    turn_camera(0);
    take_pictures(0);
    for (int n = 0; n < PATTERNS; n++) {
        /* What was drawn is not what was shown. */
        for (size_t i = 0; i < views[n].drawn_count; i++) {
            struct drawn_dot *dot = &views[n].drawn[i];
            dot->left = dot->left * 5 / 8;
            dot->top = dot->top * 5 / 8;
            dot->right = dot->left + SIDE;
            dot->bottom = dot->top + SIDE;
        }
    }
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, find(&map, &report));
}

static void empty_frame_has_no_dots(void)
{
    struct dots dots;
    float lit[400] = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, dots_find(lit, 20, 20, 0.05, &dots, &error));
    TEST_ASSERT_EQUAL_UINT(0, dots.count);
    for (int i = 0; i < 400; i++) {
        lit[i] = NAN;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, dots_find(lit, 20, 20, 0.05, &dots, &error));
    TEST_ASSERT_EQUAL_UINT(0, dots.count);
    dots_finish(&dots);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(lit_quadrilateral_is_found_to_a_pixel_and_a_half);
    RUN_TEST(dark_frame_has_no_quadrilateral);
    RUN_TEST(shadow_across_the_region_is_refused);
    RUN_TEST(drawn_dots_are_listed_and_those_at_the_border_marked);
    RUN_TEST(map_is_found_to_a_twentieth_of_a_pixel_in_noise);
    RUN_TEST(every_turn_and_mirror_of_the_camera_is_recognised);
    RUN_TEST(lens_without_distortion_is_left_ideal);
    RUN_TEST(radial_distortion_is_found_where_there_is_some);
    RUN_TEST(distortion_about_another_centre_is_found);
    RUN_TEST(dots_that_moved_are_rejected);
    RUN_TEST(centres_know_no_vignetting_and_no_colour);
    RUN_TEST(dots_not_seen_are_an_error_that_says_so);
    RUN_TEST(dots_of_another_spacing_are_refused);
    RUN_TEST(empty_frame_has_no_dots);
    return UNITY_END();
}
