/* The virtual station's frames developed, against the exact responses of the sample that lay on it. */
#include "made.h"
#include "nacre/scan.h"
#include "rig/develop/develop.h"
#include "rig/develop/pilot.h"
#include "tests/files.h"
#include "unity.h"
#include "virtual_scan.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 18, HEIGHT = 14, WINDOW = 9 };

static const char sample_text[] =
    "width: 18\nheight: 14\npitch_mm: 0.5\nthickness_mm: 4\nmargin_points: 4\nbase: pale\n"
    "materials:\n"
    "  - {name: pale, scattering_per_mm: [2.6, 2.5, 2.4], absorption_per_mm: [0.2, 0.3, 0.5],\n"
    "     index: 1.3}\n"
    "  - {name: rust, scattering_per_mm: [3.2, 3.0, 2.8], absorption_per_mm: [0.3, 0.6, 0.9],\n"
    "     index: 1.3}\n"
    "inclusions:\n"
    "  - {material: rust, bands: {angle_deg: 60, period_mm: 3, fraction: 0.45}}\n";

static const char plan_text[] = "seed: 3\nblack_frames: 24\nwhite_frames: 4\ndot_spacing: 6\n"
                                "dot_shift: 2\ngrid_spacing: 9\nwindow: 9\n"
                                "exposure_turns: [1, 4, 15, 60]\n";

static const char pilot_text[] = "seed: 3\nblack_frames: 24\nwhite_frames: 4\ndot_spacing: 6\n"
                                 "dot_shift: 2\ngrid_spacing: 18\ngrid_patterns: 40\n"
                                 "window: 17\nexposure_turns: [1, 4, 15, 60]\n";

static const char *plan = plan_text;
static char *folder;
static struct nacre_error error;

void setUp(void)
{
    folder = folder_make();
}

void tearDown(void)
{
    folder_remove(folder);
}

static void must(int status)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, status, error.text);
}

static char *in_folder(const char *name)
{
    return path_join(folder, name);
}

/* Scan the sample with a station of these properties into FOLDER/session. */
static void scan(const char *sensor, double vignetting, double roll_deg)
{
    char text[1024];
    struct sequence_result result;
    (void)snprintf(text, sizeof text,
                   "sample: {width: %d, height: %d, pitch_mm: 0.5}\n"
                   "camera: {driver: virtual, width: 88, height: 74, bayer: GBRG, %s}\n"
                   "projector: {driver: virtual, wheel_hz: 30}\ntrigger: {driver: virtual}\n"
                   "white_reflectance: [0.95, 0.9, 0.85]\nplan: plan.yaml\n"
                   "virtual:\n  sample: sample.yaml\n  seed: 2\n"
                   "  projector: {contrast: 2000, vignetting: %g}\n"
                   "  camera: {elevation_deg: 20, roll_deg: %g, pixels_per_point: 4.4,\n"
                   "           vignetting: 0.2, response: [0.7, 1, 0.8]}\n",
                   WIDTH, HEIGHT, sensor, vignetting, roll_deg);
    virtual_scan_write(folder, "station.yaml", text);
    virtual_scan_write(folder, "plan.yaml", plan);
    virtual_scan_write(folder, "sample.yaml", sample_text);
    virtual_scan_measure(folder, &result);
    TEST_ASSERT_EQUAL_UINT64(0, result.retries);
}

static struct develop_report develop_by(const struct develop_options *options)
{
    struct develop_report report;
    char *path = in_folder("session");
    char *output = in_folder("scan.exr");
    must(develop_session(path, options, output, NULL, &report, &error));
    free(path);
    free(output);
    return report;
}

static struct develop_report develop(enum demosaic demosaic)
{
    struct develop_options options = {.black = BLACK_SUBTRACT,
                                      .confidence = 0.99,
                                      .demosaic = demosaic,
                                      .store = NACRE_FLOAT,
                                      .flat = FLAT_SEPARATE};
    return develop_by(&options);
}

/* Mean over the points of ||developed - exact|| / ||exact||, and of the ratio of their sums in *scale. */
static double compare(double *scale)
{
    struct nacre_scan *scans[2];
    static const char *const names[2] = {"scan.exr", "exact.exr"};
    static float responses[2][3 * WINDOW * WINDOW];
    double sum = 0;
    *scale = 0;
    for (int k = 0; k < 2; k++) {
        char *path = in_folder(names[k]);
        must(nacre_scan_open(path, &scans[k], &error));
        free(path);
    }
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double off = 0;
        double all = 0;
        double totals[2] = {0, 0};
        for (int k = 0; k < 2; k++) {
            must(nacre_scan_read(scans[k], i % WIDTH, i / WIDTH, responses[k], &error));
        }
        for (int k = 0; k < 3 * WINDOW * WINDOW; k++) {
            double exact = (double)responses[1][k];
            off += pow((double)responses[0][k] - exact, 2);
            all += exact * exact;
            totals[0] += (double)responses[0][k];
            totals[1] += exact;
        }
        sum += sqrt(off / all) / (WIDTH * HEIGHT);
        *scale += totals[0] / totals[1] / (WIDTH * HEIGHT);
    }
    nacre_scan_close(scans[0]);
    nacre_scan_close(scans[1]);
    return sum;
}

static const char silent[] = "bits: 16";
static const char noisy[] = "bits: 10, pedestal: 24, read_noise: 0.8, electrons: 15";

static void scan_without_noise_is_exact_but_for_the_virtual_camera(void)
{
    double scale;
    scan(silent, 0, 1.5);
    virtual_scan_exact(folder, WINDOW);
    struct develop_report report = develop(DEMOSAIC_AUTO);
    /* The virtual camera knows how a pixel's view is shared between points from 8 x 8 places: a share is off by 0.02 to
     * 0.04, and the pixels that straddle points are some 40 % of all. With 48 x 48 places the same scan is within
     * 0.1 %. Light from neighbours' tails adds 0.3 % to sums, hardly anything to the norm. */
    TEST_ASSERT_DOUBLE_WITHIN(0.009, 0, compare(&scale));
    TEST_ASSERT_DOUBLE_WITHIN(0.006, 1, scale);
    TEST_ASSERT_TRUE(fabs(scale - 1) < report.overlap);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 0, report.align.rms_px);
    TEST_ASSERT_EQUAL_INT(DEMOSAIC_FIT, report.demosaic);
    TEST_ASSERT_TRUE(report.misfit < 0.03);
    TEST_ASSERT_EQUAL_UINT(WIDTH * HEIGHT, report.responses);
    TEST_ASSERT_EQUAL_UINT(0, report.missing_entries);
}

static void scan_with_noise_and_fall_off_is_within_its_budget(void)
{
    double scale;
    scan(noisy, 0.2, 1.5);
    virtual_scan_exact(folder, WINDOW);
    struct develop_report report = develop(DEMOSAIC_AUTO);
    /* To the above come the shot noise of the lit points (0.13 of a white that nearly fills the range, over exposures of
     * 1 and 4 turns: some 20,000 electrons in a colour, 0.7 %) and the projector's fall-off between x_i and x_o (0.3 %);
     * they add in squares: 1.1 %. */
    TEST_ASSERT_DOUBLE_WITHIN(0.013, 0, compare(&scale));
    TEST_ASSERT_DOUBLE_WITHIN(0.006, 1, scale);
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 0, report.align.rms_px);
    TEST_ASSERT_EQUAL_UINT(0, report.linearity.dead + report.linearity.nonlinear);
}

/* Share of an exact response's energy in one colour beyond ring `half`. */
static double exact_leak(const float *response, int window, int half)
{
    double within = 0;
    double beyond = 0;
    for (int k = 0; k < window * window; k++) {
        int u = abs(k % window - window / 2);
        int v = abs(k / window - window / 2);
        within += u <= half && v <= half ? (double)response[k] : 0;
        beyond += u <= half && v <= half ? 0 : (double)response[k];
    }
    return beyond / (within + beyond);
}

static void pilot_bounds_the_leak_of_the_whole_scan(void)
{
    enum { ALL = 35 }; /* a window that holds the whole sample around any of its points */
    static float response[3 * ALL * ALL];
    const double bound = 0.03;
    struct pilot pilot;
    struct nacre_scan *exact = NULL;
    double mean = 0;
    double narrower = 0;
    int above = 0;
    int half;
    plan = pilot_text;
    scan(noisy, 0.2, 1.5);
    plan = plan_text;
    virtual_scan_exact(folder, ALL);
    char *path = in_folder("session");
    char *scratch = in_folder("scan.exr");
    char *exact_path = in_folder("exact.exr");
    must(pilot_read(path, scratch, NULL, &pilot, &error));
    must(pilot_choose(&pilot, bound, &half, &error));
    /* Grids whose one point would lie below the 14 rows light none: 4 of 18. */
    TEST_ASSERT_TRUE(pilot.responses > 24 && pilot.responses <= 40);
    must(nacre_scan_open(exact_path, &exact, &error));
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        must(nacre_scan_read(exact, i % WIDTH, i / WIDTH, response, &error));
        for (int c = 0; c < 3; c++) {
            double leak = exact_leak(response + (ptrdiff_t)c * ALL * ALL, ALL, half);
            mean += leak / (3 * WIDTH * HEIGHT);
            above += leak > bound ? 1 : 0;
            narrower =
                fmax(narrower, exact_leak(response + (ptrdiff_t)c * ALL * ALL, ALL, half - 1));
        }
    }
    /* The worst of 40 points in 252 leaves a 40th of the others above it, and the window is no wider than it must be. */
    TEST_ASSERT_TRUE(mean < bound);
    TEST_ASSERT_TRUE(above < 3 * WIDTH * HEIGHT / 20);
    TEST_ASSERT_TRUE(narrower > bound);
    nacre_scan_close(exact);
    pilot_finish(&pilot);
    free(path);
    free(scratch);
    free(exact_path);
}

/* What developing makes of the entries that are a ten-thousandth of the brightest. */
struct dim {
    size_t count;
    double exact, off, scatter; /* means of value and error, deviation of the error */
};

static struct dim look_at_dim_entries(int window)
{
    struct nacre_scan *scans[2];
    static const char *const names[2] = {"scan.exr", "exact.exr"};
    static float responses[2][3 * 17 * 17];
    struct dim dim = {0};
    float brightest = 0;
    for (int k = 0; k < 2; k++) {
        char *path = in_folder(names[k]);
        must(nacre_scan_open(path, &scans[k], &error));
        free(path);
    }
    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < WIDTH * HEIGHT; i++) {
            for (int k = 0; k < 2; k++) {
                must(nacre_scan_read(scans[k], i % WIDTH, i / WIDTH, responses[k], &error));
            }
            for (int k = 0; k < 3 * window * window && !isnan(responses[0][window * window / 2]);
                 k++) {
                double share = (double)(responses[1][k] / brightest) * 1e4;
                double off = (double)(responses[0][k] - responses[1][k]);
                if (pass == 0) {
                    brightest = fmaxf(brightest, responses[1][k]);
                } else if (share > 0.7 && share < 1.4) {
                    dim.count++;
                    dim.exact += (double)responses[1][k];
                    dim.off += off;
                    dim.scatter += off * off;
                }
            }
        }
    }
    nacre_scan_close(scans[0]);
    nacre_scan_close(scans[1]);
    dim.exact /= (double)dim.count;
    dim.off /= (double)dim.count;
    dim.scatter = sqrt(dim.scatter / (double)dim.count - dim.off * dim.off);
    return dim;
}

static void dynamic_range_of_10000_is_kept(void)
{
    struct develop_options subtract = {.black = BLACK_SUBTRACT,
                                       .confidence = 0.99,
                                       .demosaic = DEMOSAIC_FIT,
                                       .store = NACRE_FLOAT,
                                       .flat = FLAT_PAPER};
    struct develop_options clip = subtract;
    clip.black = BLACK_CLIP;
    plan = pilot_text; /* so far apart that no neighbour's light falls on dim entries */
    scan(noisy, 0.2, 1.5);
    plan = plan_text;
    virtual_scan_exact(folder, 17);
    (void)develop_by(&subtract);
    struct dim kept = look_at_dim_entries(17);
    (void)develop_by(&clip);
    struct dim clipped = look_at_dim_entries(17);
    /* A single entry of a ten-thousandth of the brightest is as large as its noise; their mean is true to four standard
     * errors and 2 % for what else is off (the projector's fall-off over 8 points). */
    TEST_ASSERT_TRUE(kept.count > 1000);
    TEST_ASSERT_TRUE(kept.scatter < 1.2 * kept.exact);
    TEST_ASSERT_DOUBLE_WITHIN(4 * kept.scatter / sqrt((double)kept.count) + 0.02 * kept.exact, 0,
                              kept.off);
    /* The paper's way gives them up: of what lies below 2.33 deviations hardly a quarter is left. */
    TEST_ASSERT_TRUE(clipped.off < -0.5 * kept.exact);
}

static void falloff_taken_where_light_enters_beats_the_papers_way(void)
{
    /* A projector that loses half its light towards the corners, and a camera without noise: the error that is left is
     * the virtual camera's 0.7 % (above) and, the paper's way, E(x_i) / E(x_o). */
    double scale;
    struct develop_options paper = {.black = BLACK_SUBTRACT,
                                    .confidence = 0.99,
                                    .demosaic = DEMOSAIC_FIT,
                                    .store = NACRE_FLOAT,
                                    .flat = FLAT_PAPER};
    struct develop_options separate = paper;
    separate.flat = FLAT_SEPARATE;
    scan(silent, 0.5, 1.5);
    virtual_scan_exact(folder, WINDOW);
    (void)develop_by(&paper);
    double theirs = compare(&scale);
    struct develop_report report = develop_by(&separate);
    double ours = compare(&scale);
    TEST_ASSERT_DOUBLE_WITHIN(0.009, 0, ours);
    TEST_ASSERT_TRUE(theirs * theirs > ours * ours + 0.006 * 0.006);
    /* The middles of the outermost points lie at 0.94 of the way to the corner: 1 / (1 - 0.5 * 0.88) is 1.79. So few
     * points, each off by the virtual camera's per cent, know it to what the report calls doubt; three times that. */
    TEST_ASSERT_DOUBLE_WITHIN(3 * 1.79 * report.falloff_doubt, 0.79, report.falloff);
    TEST_ASSERT_TRUE(report.falloff_doubt < 0.02);
    TEST_ASSERT_EQUAL_INT(0, report.warnings.count);
}

static void fit_beats_the_means_by_far(void)
{
    double scale;
    scan(noisy, 0.2, 1.5);
    virtual_scan_exact(folder, WINDOW);
    (void)develop(DEMOSAIC_FIT);
    double fit = compare(&scale);
    (void)develop(DEMOSAIC_AREA);
    double area = compare(&scale);
    (void)develop(DEMOSAIC_MALVAR);
    double malvar = compare(&scale);
    TEST_ASSERT_TRUE(10 * fit < area);
    TEST_ASSERT_TRUE(10 * fit < malvar);
}

static void camera_upside_down_gives_the_same_scan(void)
{
    double scale;
    scan(noisy, 0.2, -178);
    virtual_scan_exact(folder, WINDOW);
    (void)develop(DEMOSAIC_AUTO);
    TEST_ASSERT_DOUBLE_WITHIN(0.013, 0, compare(&scale));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(scan_without_noise_is_exact_but_for_the_virtual_camera);
    RUN_TEST(scan_with_noise_and_fall_off_is_within_its_budget);
    RUN_TEST(pilot_bounds_the_leak_of_the_whole_scan);
    RUN_TEST(dynamic_range_of_10000_is_kept);
    RUN_TEST(falloff_taken_where_light_enters_beats_the_papers_way);
    RUN_TEST(fit_beats_the_means_by_far);
    RUN_TEST(camera_upside_down_gives_the_same_scan);
    return UNITY_END();
}
