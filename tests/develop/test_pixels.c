/* The map of pixels that cannot be trusted: of the virtual station's sensor, on file, and taken from another session. */
#include "made.h"
#include "nacre/exr_file.h"
#include "nacre/scan.h"
#include "rig/develop/calibrate.h"
#include "rig/virtual/pixels.h"
#include "tests/files.h"
#include "unity.h"
#include "virtual_scan.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CAMERA_WIDTH = 88, CAMERA_HEIGHT = 74, PIXELS = CAMERA_WIDTH * CAMERA_HEIGHT };

static const char sample_text[] =
    "width: 18\nheight: 14\npitch_mm: 0.5\nthickness_mm: 4\nmargin_points: 4\nbase: pale\n"
    "materials:\n"
    "  - {name: pale, scattering_per_mm: [2.6, 2.5, 2.4], absorption_per_mm: [0.2, 0.3, 0.5],\n"
    "     index: 1.3}\n";

static const char plan_text[] = "seed: 3\nblack_frames: 16\nwhite_frames: 4\ndot_spacing: 6\n"
                                "dot_shift: 2\ngrid_spacing: 9\ngrid_patterns: 6\nwindow: 9\n"
                                "exposure_turns: [1, 4, 15, 60]\n";

static const char station_text[] =
    "sample: {width: 18, height: 14, pitch_mm: 0.5}\n"
    "camera: {driver: virtual, width: 88, height: 74, bayer: GBRG, bits: 10, pedestal: 24,\n"
    "         read_noise: 0.8, electrons: 15}\n"
    "projector: {driver: virtual, wheel_hz: 30}\ntrigger: {driver: virtual}\nplan: plan.yaml\n"
    "virtual:\n  sample: sample.yaml\n  seed: 2\n"
    "  projector: {contrast: 2000, vignetting: 0.2}\n"
    "  camera:\n"
    "    {elevation_deg: 20, pixels_per_point: 4.4, vignetting: 0.2, response: [0.7, 1, 0.8],\n"
    "     dark_per_s: 0.4, nonuniformity: 0.02, hot_pixels: 0.01, hot_per_s: 40,\n"
    "     dead_pixels: 0.004}\n";

static char *folder, *session_path, *map_path, *scan_path;
static struct session session;
static struct calibration calibration;
static struct nacre_error error;

void setUp(void)
{
    memset(&error, 0, sizeof error);
}

void tearDown(void)
{
    calibration_finish(&calibration);
    calibration = (struct calibration){0};
}

static char *path_of(const char *name)
{
    char *path = NULL;
    TEST_ASSERT_TRUE(asprintf(&path, "%s/%s", folder, name) > 0);
    return path;
}

static int run_calibration(const char *known, const char *written)
{
    struct visit_progress progress = {.total = 1};
    const struct calibrate_options options = {
        .black = BLACK_SUBTRACT, .confidence = 0.99, .known_pixels = known, .pixels = written};
    calibration_finish(&calibration);
    return calibrate(&session, &options, &progress, &calibration, &error);
}

/* Whether a pixel and all that `linearity` compares it with see the lit area. */
static bool is_well_inside(size_t pixel)
{
    int x = (int)(pixel % CAMERA_WIDTH);
    int y = (int)(pixel / CAMERA_WIDTH);
    return x > 12 && y > 12 && x < CAMERA_WIDTH - 12 && y < CAMERA_HEIGHT - 12;
}

static void sensor_s_defects_are_found_and_no_good_pixel_is_taken_for_one(void)
{
    struct hot_pixels hot = {0};
    static float dark[PIXELS];
    size_t dead = 0;
    size_t surely_hot = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, run_calibration(NULL, NULL), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          hot_pixels_init(&session.station.simulated, PIXELS, &hot, &error));
    for (size_t k = 0; k < hot.count; k++) {
        dark[hot.pixels[k]] = hot.per_s[k];
    }
    /* As noisy as read noise and quantisation in 2 s: (0.64 + 1/12) 15 / 2. A slope is known from 16 frames to
     * 0.85 / sqrt(16 (4.27 - 2.67^2 / 4) s^2) = 0.14, and dark counts at the limit double the variance of the longest
     * exposure: 0.2. Five of these to either side are left to chance, and as much to rounding. */
    const double limit = (0.64 + 1.0 / 12) * 15 / 2;
    const double doubt = 5 * 0.2 + 5 * 0.2;
    const struct pixel_map *map = &calibration.pixels;
    for (size_t i = 0; i < PIXELS; i++) {
        bool is_dead = pixels_is_dead(&session.station.simulated, i) && is_well_inside(i);
        /* Its own light may have been foretold by a third too large. */
        double light = fmax((double)map->dark[i] - (double)dark[i], 0);
        bool is_hot = (double)dark[i] > limit + 1.7 * light + doubt;
        bool may_be_hot = (double)dark[i] > limit - doubt;
        char where[64];
        (void)snprintf(where, sizeof where, "pixel %zu, dark %g, found %g", i, (double)dark[i],
                       (double)map->dark[i]);
        dead += is_dead ? 1 : 0;
        surely_hot += is_hot && !is_dead ? 1 : 0;
        if (is_dead) {
            TEST_ASSERT_EQUAL_INT_MESSAGE(PIXEL_DEAD, map->classes[i], where);
        } else if (is_hot) {
            TEST_ASSERT_EQUAL_INT_MESSAGE(PIXEL_HOT, map->classes[i], where);
        } else if (!may_be_hot && !pixels_is_dead(&session.station.simulated, i)) {
            TEST_ASSERT_EQUAL_INT_MESSAGE(PIXEL_GOOD, map->classes[i], where);
        }
        /* Nothing is made of what cannot be trusted. */
        TEST_ASSERT_TRUE(map->classes[i] == PIXEL_GOOD || isnan(calibration.flat.white[i]));
    }
    /* 0.004 of the inner pixels and 0.01 e^(-12/40) of all: 13 and 48 on average, of deviations 4 and 7. */
    TEST_ASSERT_TRUE(dead > 2 && surely_hot > 24);
    hot_pixels_finish(&hot);
}

static void map_is_written_and_read_back(void)
{
    struct exr_file file = {0};
    struct pixel_map copy = {0};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, run_calibration(NULL, map_path), error.text);
    const struct pixel_map *map = &calibration.pixels;
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          pixel_map_init(&copy, map->width, map->height, map->bayer, &error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, pixel_map_add_known(&copy, map_path, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_MEMORY(map->classes, copy.classes, PIXELS);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_read(map_path, &file, &error));
    const struct exr_plane *plane = exr_part_find_plane(&file.parts[0], "dark");
    TEST_ASSERT_NOT_NULL(plane);
    TEST_ASSERT_EQUAL_MEMORY(map->dark, plane->values, PIXELS * sizeof(float));
    TEST_ASSERT_NOT_NULL(exr_part_find_plane(&file.parts[0], "slope"));
    TEST_ASSERT_NOT_NULL(exr_part_find_plane(&file.parts[0], "offset"));
    exr_file_finish(&file);
    pixel_map_finish(&copy);
}

static void known_pixels_are_left_out_too(void)
{
    char *known_path = path_of("known.exr");
    struct pixel_map known = {0};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, run_calibration(NULL, NULL), error.text);
    struct pixel_map *map = &calibration.pixels;
    size_t good = 40 * CAMERA_WIDTH + 40;
    while (map->classes[good] != PIXEL_GOOD) {
        good++;
    }
    size_t before = pixel_map_count(map, PIXEL_GOOD);
    TEST_ASSERT_FALSE(isnan(calibration.flat.white[good]));
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          pixel_map_init(&known, map->width, map->height, map->bayer, &error));
    known.classes[good] = PIXEL_NOISY;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, pixel_map_write(&known, known_path, &error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, run_calibration(known_path, NULL), error.text);
    TEST_ASSERT_EQUAL_UINT(before - 1, pixel_map_count(&calibration.pixels, PIXEL_GOOD));
    TEST_ASSERT_EQUAL_INT(PIXEL_NOISY, calibration.pixels.classes[good]);
    TEST_ASSERT_TRUE(isnan(calibration.flat.white[good]));
    pixel_map_finish(&known);
    free(known_path);
}

static void calibration_fails_with(const char *known, const char *words)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, run_calibration(known, NULL));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, words), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, known), error.text);
}

static void maps_of_another_camera_are_refused(void)
{
    char *path = path_of("other.exr");
    struct pixel_map other = {0};
    TEST_ASSERT_EQUAL_INT(
        NACRE_OK, pixel_map_init(&other, CAMERA_WIDTH, CAMERA_HEIGHT + 1, BAYER_GBRG, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, pixel_map_write(&other, path, &error));
    calibration_fails_with(path, "88 x 75");
    pixel_map_finish(&other);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          pixel_map_init(&other, CAMERA_WIDTH, CAMERA_HEIGHT, BAYER_RGGB, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, pixel_map_write(&other, path, &error));
    calibration_fails_with(path, "RGGB");
    other.bayer = BAYER_GBRG;
    other.classes[5] = PIXEL_CLASSES;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, pixel_map_write(&other, path, &error));
    calibration_fails_with(path, "pixel (5, 0)");
    calibration_fails_with(scan_path, "is no map of pixels");
    pixel_map_finish(&other);
    free(path);
}

static void measure(void)
{
    struct sequence_result result;
    struct develop_report report;
    virtual_scan_write(folder, "sample.yaml", sample_text);
    virtual_scan_write(folder, "plan.yaml", plan_text);
    virtual_scan_write(folder, "station.yaml", station_text);
    virtual_scan_run(folder, &result, &report);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_open(session_path, &session, &error),
                                  error.text);
}

int main(void)
{
    UNITY_BEGIN();
    folder = folder_make();
    session_path = path_of("session");
    map_path = path_of("map.exr");
    scan_path = path_of("scan.exr");
    RUN_TEST(measure);
    RUN_TEST(sensor_s_defects_are_found_and_no_good_pixel_is_taken_for_one);
    RUN_TEST(map_is_written_and_read_back);
    RUN_TEST(known_pixels_are_left_out_too);
    RUN_TEST(maps_of_another_camera_are_refused);
    session_finish(&session);
    free(session_path);
    free(map_path);
    free(scan_path);
    folder_remove(folder);
    return UNITY_END();
}
