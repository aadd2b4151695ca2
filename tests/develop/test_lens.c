/* The lens's distortion of the virtual station's camera is found by the dots, and its residuals are told. */
#include "made.h"
#include "tests/files.h"
#include "unity.h"
#include "virtual_scan.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { WIDTH = 30, HEIGHT = 24 };

static const char sample_text[] =
    "width: 30\nheight: 24\npitch_mm: 0.5\nthickness_mm: 4\nmargin_points: 4\nbase: pale\n"
    "materials:\n"
    "  - {name: pale, scattering_per_mm: [2.6, 2.5, 2.4], absorption_per_mm: [0.2, 0.3, 0.5],\n"
    "     index: 1.3}\n";

static const char plan_text[] = "seed: 3\nblack_frames: 4\nwhite_frames: 3\ndot_spacing: 6\n"
                                "dot_shift: 2\ngrid_spacing: 9\ngrid_patterns: 1\nwindow: 9\n"
                                "exposure_turns: [1, 4, 15, 60]\n";

static const char station_format[] =
    "sample: {width: 30, height: 24, pitch_mm: 0.5}\n"
    "camera: {driver: virtual, width: 140, height: 116, bayer: RGGB, bits: 10, pedestal: 24,\n"
    "         read_noise: 0.8, electrons: 15}\n"
    "projector: {driver: virtual, wheel_hz: 30}\ntrigger: {driver: virtual}\nplan: plan.yaml\n"
    "virtual:\n  sample: sample.yaml\n  seed: 2\n"
    "  projector: {contrast: 2000, vignetting: 0.2}\n"
    "  camera:\n"
    "    {elevation_deg: 20, roll_deg: 2, pixels_per_point: 4.4, vignetting: 0.3,\n"
    "     response: [0.7, 1, 0.8], distortion: [%g, %g]}\n";

static char *folder;
static struct develop_report report;

void setUp(void)
{
    folder = folder_make();
}

void tearDown(void)
{
    folder_remove(folder);
}

static void see_through(double k1, double k2)
{
    struct sequence_result result;
    char text[2048];
    (void)snprintf(text, sizeof text, station_format, k1, k2);
    virtual_scan_write(folder, "sample.yaml", sample_text);
    virtual_scan_write(folder, "plan.yaml", plan_text);
    virtual_scan_write(folder, "station.yaml", text);
    virtual_scan_run(folder, &result, &report);
}

/* Dots of 2 x 2 points are 77 pixels at 1 % of shot noise, more at the vignetted corners (1.2 %) and in red and blue
 * (1.2 %), summed over 13 x 13 pixels: 0.015 sqrt(169 * 14) / 77 = 0.0095 pixels in each axis, 0.013 in distance. The camera
 * sees by 8 x 8 places: an edge is off by up to 1/16, evenly, 0.036 RMS, and a dot's centre by the mean of two edges
 * that vary along their 9 pixels where they run aslant: 0.036 / sqrt(2 * 9) = 0.009 in each axis, 0.012. Defocus there is
 * none. Together 0.018, which noise of the noise raises by 20 % at most: half of what the goal of 0.05 allows. */
static const double rms_foretold = 0.022;

static void residuals_are_within(double bound)
{
    TEST_ASSERT_DOUBLE_WITHIN(bound, 0, report.align.rms_px);
    for (int tile = 0; tile < ALIGN_TILES * ALIGN_TILES; tile++) {
        /* A ninth holds some 15 dots or more: its RMS is known to 1 / sqrt(4 * 15), 13 %; four of these. */
        double own = report.align.map_px[tile / ALIGN_TILES][tile % ALIGN_TILES];
        TEST_ASSERT_DOUBLE_WITHIN(1.5 * bound, 0, own);
    }
    TEST_ASSERT_EQUAL_UINT(report.align.dots, report.align.matched + report.align.rejected);
}

/* Barrel and cushion of this share of the radius in the frame's corners, 91 pixels off: where the region ends, 80 to 85
 * off, k1 alone moves places by some 0.8 of that. */
static void distortion_is_found_and_leaves_noise_alone(void)
{
    static const double strengths[][2] = {{-0.03, 0}, {0.02, 0}, {-0.03, 0.012}};
    for (int k = 0; k < 3; k++) {
        double k1 = strengths[k][0];
        double k2 = strengths[k][1];
        see_through(k1, k2);
        TEST_ASSERT_TRUE(report.align.lens != LENS_IDEAL);
        residuals_are_within(rms_foretold);
        /* The homography takes up no part of a place's distance from the frame's middle but what is linear in it. */
        double corner = 91 * fabs(k1 + k2);
        TEST_ASSERT_TRUE(report.align.lens_px > 0.4 * corner);
        TEST_ASSERT_TRUE(report.align.lens_px < 1.2 * corner);
        tearDown();
        setUp();
    }
}

static void lens_without_distortion_stays_ideal(void)
{
    see_through(0, 0);
    TEST_ASSERT_EQUAL_INT(LENS_IDEAL, report.align.lens);
    TEST_ASSERT_EQUAL_DOUBLE(0, report.align.lens_px);
    residuals_are_within(rms_foretold);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(distortion_is_found_and_leaves_noise_alone);
    RUN_TEST(lens_without_distortion_stays_ideal);
    return UNITY_END();
}
