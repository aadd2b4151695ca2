/* Tests of the virtual camera's geometry and of the projector's light. */
#include "rig/virtual/optics.h"
#include "rig/virtual/projection.h"

#include "unity.h"

#include <math.h>
#include <stdlib.h>

static struct nacre_error error;

void setUp(void)
{
}

void tearDown(void)
{
}

static const double degree = 3.14159265358979323846 / 180;

/* A station with everything off its middle. */
static struct station make_station(void)
{
    struct station station = {.sample = {.width = 12, .height = 9, .pitch_mm = 0.5},
                              .camera = {.width = 80, .height = 64, .bits = 10, .pedestal = 23},
                              .projector = {.wheel_hz = 30}};
    station.simulated.camera = (struct virtual_camera_settings){.distance_mm = 90,
                                                                .elevation_deg = 25,
                                                                .roll_deg = 7,
                                                                .pixels_per_point = 4,
                                                                .full_scale_s = 0.05,
                                                                .response = {1, 1, 1}};
    return station;
}

static void find_homography(const struct station *station, double h[3][3])
{
    struct effects effects;
    effects_plan(station, NULL, &effects);
    optics_homography(station, &effects, h);
}

static void project(double h[3][3], double x, double y, double *u, double *v)
{
    double w = h[2][0] * x + h[2][1] * y + h[2][2];
    *u = (h[0][0] * x + h[0][1] * y + h[0][2]) / w;
    *v = (h[1][0] * x + h[1][1] * y + h[1][2]) / w;
}

/* The same by vectors in space: the place of the point, the pinhole, the axes of the camera, similar triangles. Axes: x
 * right, y down, z from the sample to the projector. */
static void project_in_space(const struct station *station, double x, double y, double *u,
                             double *v)
{
    const struct virtual_camera_settings *camera = &station->simulated.camera;
    double e = camera->elevation_deg * degree, r = camera->roll_deg * degree;
    double pitch = station->sample.pitch_mm;
    double focal_px = camera->pixels_per_point / pitch * camera->distance_mm;
    double point[3] = {(x - station->sample.width / 2.) * pitch,
                       (y - station->sample.height / 2.) * pitch, 0};
    double hole[3] = {0, -camera->distance_mm * sin(e), camera->distance_mm * cos(e)};
    double right[3] = {cos(r), sin(r) * cos(e), sin(r) * sin(e)};
    double down[3] = {-sin(r), cos(r) * cos(e), cos(r) * sin(e)};
    double along[3] = {0, 0, 0};
    double sums[3] = {0, 0, 0};
    for (int k = 0; k < 3; k++) {
        along[k] = -hole[k] / camera->distance_mm;
        sums[0] += right[k] * (point[k] - hole[k]);
        sums[1] += down[k] * (point[k] - hole[k]);
        sums[2] += along[k] * (point[k] - hole[k]);
    }
    *u = station->camera.width / 2. + focal_px * sums[0] / sums[2];
    *v = station->camera.height / 2. + focal_px * sums[1] / sums[2];
}

static void homography_is_that_of_a_pinhole_in_space(void)
{
    struct station station = make_station();
    double h[3][3];
    find_homography(&station, h);
    for (int y = 0; y <= 9; y += 3) {
        for (int x = 0; x <= 12; x += 3) {
            double u, v, expected_u, expected_v;
            project(h, x, y, &u, &v);
            project_in_space(&station, x, y, &expected_u, &expected_v);
            /* Some ten roundings of numbers near 1e2: 1e-13. */
            TEST_ASSERT_DOUBLE_WITHIN(1e-11, expected_u, u);
            TEST_ASSERT_DOUBLE_WITHIN(1e-11, expected_v, v);
        }
    }
}

static void projector_out_of_its_place_lights_points_elsewhere(void)
{
    struct station station = make_station();
    double h[3][3];
    station.simulated.projector.shift_points[0] = 0.25;
    station.simulated.projector.shift_points[1] = -0.4;
    find_homography(&station, h);
    for (int i = 0; i <= 12; i += 3) {
        double u, v, expected_u, expected_v;
        project(h, i, i - 2, &u, &v);
        project_in_space(&station, i + 0.25, i - 2.4, &expected_u, &expected_v);
        TEST_ASSERT_DOUBLE_WITHIN(1e-11, expected_u, u);
        TEST_ASSERT_DOUBLE_WITHIN(1e-11, expected_v, v);
    }
}

static void camera_above_sees_the_lower_edge_smaller(void)
{
    struct station station = make_station();
    double h[3][3], left, right, ignored;
    station.simulated.camera.roll_deg = 0;
    find_homography(&station, h);
    project(h, 0, 0, &left, &ignored);
    project(h, 12, 0, &right, &ignored);
    double upper = right - left;
    project(h, 0, 9, &left, &ignored);
    project(h, 12, 9, &right, &ignored);
    /* Depths of the edges: 90 mm -+ 2.25 mm sin 25. */
    double depth = 2.25 * sin(25 * degree);
    TEST_ASSERT_DOUBLE_WITHIN(1e-10, 48 * 90 / (90 - depth), upper);
    TEST_ASSERT_DOUBLE_WITHIN(1e-10, 48 * 90 / (90 + depth), right - left);
}

static void see(const struct station *station, const float *radiosity, float *signal)
{
    struct optics optics;
    struct effects effects;
    effects_plan(station, NULL, &effects);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, optics_init(station, &effects, &optics, &error));
    TEST_ASSERT_EQUAL_INT(80 * 64, optics.pixel_count);
    optics_apply(&optics, radiosity, signal);
    optics_finish(&optics);
}

enum { POINTS = 12 * 9, PIXELS = 80 * 64 };

/* The signal of one pixel that a white surface fills: saturated after full_scale_s. */
static void white_surface_fills_the_range_in_the_full_scale_time(void)
{
    struct station station = make_station();
    float radiosity[3 * POINTS], *signal = malloc(PIXELS * sizeof *signal);
    for (int i = 0; i < 3 * POINTS; i++) {
        radiosity[i] = 1;
    }
    station.camera.bayer = BAYER_MONO;
    see(&station, radiosity, signal);
    /* 24 bits of each weight, up to four of them. */
    TEST_ASSERT_DOUBLE_WITHIN(1000 / 0.05 * 4e-7, 1000 / 0.05, signal[32 * 80 + 40]);
    TEST_ASSERT_EQUAL_FLOAT(0, signal[0]); /* beyond the sample it is dark */
    TEST_ASSERT_EQUAL_FLOAT(0, signal[PIXELS - 1]);
    free(signal);
}

/* The pixels of a lit point lie where the homography says, and their areas are that of its picture: the quadrilateral of
 * its corners. */
static void lit_point_appears_where_the_homography_says(void)
{
    struct station station = make_station();
    float radiosity[3 * POINTS] = {0}, *signal = malloc(PIXELS * sizeof *signal);
    double h[3][3], u[4], v[4], area = 0, centre[2] = {0, 0}, sum = 0, moments[2] = {0, 0};
    const int x = 9, y = 2;
    station.camera.bayer = BAYER_MONO;
    radiosity[y * 12 + x] = 1;
    see(&station, radiosity, signal);
    find_homography(&station, h);
    for (int k = 0; k < 4; k++) {
        project(h, x + (k == 1 || k == 2), y + (k >= 2), &u[k], &v[k]);
    }
    for (int k = 0; k < 4; k++) {
        int n = (k + 1) % 4;
        double cross = u[k] * v[n] - u[n] * v[k];
        area += cross / 2;
        centre[0] += (u[k] + u[n]) * cross / 6;
        centre[1] += (v[k] + v[n]) * cross / 6;
    }
    for (int i = 0; i < PIXELS; i++) {
        double covered = signal[i] / (1000 / 0.05);
        sum += covered;
        moments[0] += covered * (i % 80 + 0.5);
        moments[1] += covered * (i / 80 + 0.5); // NOLINT(bugprone-integer-division): the row
    }
    /* Places 1/8 pixel apart: about 110 of 900 lie at the outline, each off by at most half of 1/64, in random
     * directions: sqrt(110) / 128 = 0.08; and the centre by that over the area, a hundredth. */
    TEST_ASSERT_DOUBLE_WITHIN(0.25, area, sum);
    TEST_ASSERT_DOUBLE_WITHIN(0.03, centre[0] / area, moments[0] / sum);
    TEST_ASSERT_DOUBLE_WITHIN(0.03, centre[1] / area, moments[1] / sum);
    free(signal);
}

static void pixels_see_the_colour_of_their_filter_alone(void)
{
    struct station station = make_station();
    float radiosity[3 * POINTS], *signal = malloc(PIXELS * sizeof *signal);
    static const double response[3] = {0.5, 1, 0.25};
    for (int c = 0; c < 3; c++) {
        station.simulated.camera.response[c] = response[c];
        for (int i = 0; i < POINTS; i++) {
            radiosity[c * POINTS + i] = (float)(c + 1);
        }
    }
    station.camera.bayer = BAYER_GBRG;
    see(&station, radiosity, signal);
    /* GBRG: green blue / red green, from an even pixel on. */
    TEST_ASSERT_FLOAT_WITHIN(0.02F, 2 * 1.F * 20000, signal[32 * 80 + 40]);
    TEST_ASSERT_FLOAT_WITHIN(0.02F, 3 * 0.25F * 20000, signal[32 * 80 + 41]);
    TEST_ASSERT_FLOAT_WITHIN(0.02F, 1 * 0.5F * 20000, signal[33 * 80 + 40]);
    TEST_ASSERT_FLOAT_WITHIN(0.02F, 2 * 1.F * 20000, signal[33 * 80 + 41]);
    free(signal);
}

static void camera_loses_light_towards_the_corners(void)
{
    struct station station = make_station();
    float radiosity[3 * POINTS], *signal = malloc(PIXELS * sizeof *signal);
    for (int i = 0; i < 3 * POINTS; i++) {
        radiosity[i] = 1;
    }
    station.camera.bayer = BAYER_MONO;
    station.simulated.camera.pixels_per_point = 40; /* the sample fills the frame */
    station.simulated.camera.vignetting = 0.3;
    see(&station, radiosity, signal);
    /* Pixel (0, 0) has its centre at (0.5, 0.5): r^2 is (39.5^2 + 31.5^2) of 40^2 + 32^2. */
    double corner = 1 - 0.3 * (39.5 * 39.5 + 31.5 * 31.5) / (1600 + 1024);
    TEST_ASSERT_DOUBLE_WITHIN(20000 * 2e-6, 20000 * corner, signal[0]);
    TEST_ASSERT_DOUBLE_WITHIN(20000 * 2e-6, 20000 * corner, signal[PIXELS - 1]);
    TEST_ASSERT_DOUBLE_WITHIN(20000 * 2e-6, 20000 * (1 - 0.3 * 0.5 / (1600 + 1024)),
                              signal[32 * 80 + 40]);
    free(signal);
}

static void draw(const struct station *station, const uint8_t *levels, float *irradiance)
{
    struct projection projection;
    struct effects effects;
    effects_plan(station, NULL, &effects);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, projection_init(station, &effects, &projection, &error));
    projection_draw(&projection, &effects, levels, irradiance);
    projection_finish(&projection);
}

static void projector_has_a_black_level_and_falls_off(void)
{
    struct station station = make_station();
    uint8_t levels[POINTS] = {255, 0, 51};
    float irradiance[3 * POINTS];
    station.simulated.projector =
        (struct virtual_projector_settings){.contrast = 200, .vignetting = 0.2};
    draw(&station, levels, irradiance);
    double r2[3];
    for (int i = 0; i < 3; i++) {
        r2[i] = ((i - 5.5) * (i - 5.5) + 16) / (36 + 20.25);
    }
    for (int c = 0; c < 3; c++) {
        const float *plane = irradiance + c * POINTS;
        TEST_ASSERT_DOUBLE_WITHIN(1e-7, 1 - 0.2 * r2[0], plane[0]);
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, (1 - 0.2 * r2[1]) / 200, plane[1]);
        TEST_ASSERT_DOUBLE_WITHIN(1e-7, (1 - 0.2 * r2[2]) * (0.2 + 0.8 / 200), plane[2]);
    }
}

static void projector_without_contrast_is_dark_where_it_shows_black(void)
{
    struct station station = make_station();
    uint8_t levels[POINTS] = {0};
    float irradiance[3 * POINTS];
    draw(&station, levels, irradiance);
    for (int i = 0; i < 3 * POINTS; i++) {
        TEST_ASSERT_EQUAL_FLOAT(0, irradiance[i]);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(homography_is_that_of_a_pinhole_in_space);
    RUN_TEST(projector_out_of_its_place_lights_points_elsewhere);
    RUN_TEST(camera_above_sees_the_lower_edge_smaller);
    RUN_TEST(white_surface_fills_the_range_in_the_full_scale_time);
    RUN_TEST(lit_point_appears_where_the_homography_says);
    RUN_TEST(pixels_see_the_colour_of_their_filter_alone);
    RUN_TEST(camera_loses_light_towards_the_corners);
    RUN_TEST(projector_has_a_black_level_and_falls_off);
    RUN_TEST(projector_without_contrast_is_dark_where_it_shows_black);
    return UNITY_END();
}
