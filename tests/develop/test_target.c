/* The pitch by a target of dots: the lattice, and a target on the virtual station's stage. */
#include "base/picture.h"
#include "made.h"
#include "nacre/scan.h"
#include "rig/develop/lattice.h"
#include "rig/develop/target.h"
#include "tests/files.h"
#include "unity.h"
#include "virtual_scan.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct nacre_error error;
static char *folder;

void setUp(void)
{
    memset(&error, 0, sizeof error);
    folder = folder_make();
}

void tearDown(void)
{
    folder_remove(folder);
}

enum { COLUMNS = 7, ROWS = 6 };

/* Dots 5 apart, turned by `angle`, in perspective, each off by `noise` in both axes. */
static size_t lay_dots(double angle, double noise, struct point *dots)
{
    struct made_random random = {7};
    for (int i = 0; i < COLUMNS * ROWS; i++) {
        int row = i / COLUMNS;
        double x = 5 * (i % COLUMNS - 3);
        double y = 5 * (row - 2.5);
        double w = 1 + 0.002 * x - 0.001 * y;
        dots[i].x = 20 + (cos(angle) * x - sin(angle) * y) / w + noise * made_normal(&random);
        dots[i].y = 18 + (sin(angle) * x + cos(angle) * y) / w + noise * made_normal(&random);
    }
    return COLUMNS * ROWS;
}

static void lattice_is_found_at_every_turn(void)
{
    for (int k = 0; k < 12; k++) {
        struct point dots[COLUMNS * ROWS];
        struct lattice lattice;
        size_t count = lay_dots(0.37 * k, 0, dots);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, lattice_find(dots, count, &lattice, &error),
                                      error.text);
        TEST_ASSERT_EQUAL_UINT(count, lattice.dots);
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, lattice.rms); /* a homography holds it exactly */
    }
}

static void dots_beside_the_lattice_are_left_out(void)
{
    struct point dots[COLUMNS * ROWS + 3];
    struct lattice lattice;
    size_t count = lay_dots(0.2, 0.01, dots);
    dots[9].x += 0.8; /* within reach, but no place for a dot */
    dots[count++] = (struct point){dots[4].x + 2, dots[4].y + 2};
    dots[count++] = (struct point){70, 70};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, lattice_find(dots, count, &lattice, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_UINT(COLUMNS * ROWS - 1, lattice.dots);
    /* 0.01 in each axis, of which 8 of 82 coordinates are taken up: known to 1 / sqrt(2 * 74), times 4. */
    TEST_ASSERT_DOUBLE_WITHIN(0.0134 * 4 * 0.082, 0.01 * sqrt(2 * 74 / 82.0), lattice.rms);
}

/* The dots that are not lost, in place of all; how many. */
static size_t keep_dots(struct point *dots, size_t count, const size_t *lost, size_t lost_count)
{
    size_t kept = 0;
    for (size_t i = 0; i < count; i++) {
        bool is_lost = false;
        for (size_t k = 0; k < lost_count; k++) {
            is_lost = is_lost || lost[k] == i;
        }
        if (!is_lost) {
            dots[kept++] = dots[i];
        }
    }
    return kept;
}

static void diagonals_are_not_taken_for_rows_where_neighbours_are_lost(void)
{
    struct point dots[COLUMNS * ROWS];
    struct lattice lattice;
    /* All four neighbours of the dot in the middle, number 3 of rows 2 and 3: its nearest is then a diagonal one. */
    const size_t lost[] = {3 * COLUMNS + 2, 3 * COLUMNS + 4, 2 * COLUMNS + 3, 4 * COLUMNS + 3};
    size_t count = keep_dots(dots, lay_dots(0.3, 0, dots), lost, 4);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, lattice_find(dots, count, &lattice, &error),
                                  error.text);
    /* All but the lonely dot, which is reached from nowhere. */
    TEST_ASSERT_EQUAL_UINT(count - 1, lattice.dots);
    struct point a = homography_apply(&lattice.map, (struct point){0, 0});
    struct point b = homography_apply(&lattice.map, (struct point){1, 0});
    /* 5, but for the perspective: 1 + 0.002 15 + 0.001 12.5 at most, squared along the row. */
    TEST_ASSERT_DOUBLE_WITHIN(0.09 * 5, 5, hypot(b.x - a.x, b.y - a.y));
}

static void lattices_that_are_not_square_are_refused(void)
{
    const struct {
        double shear, stretch;
    } cases[] = {{0.5, 0.866}, {0, 1.4}}; /* triangles; oblongs */
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        struct point dots[COLUMNS * ROWS];
        struct lattice lattice;
        for (int i = 0; i < COLUMNS * ROWS; i++) {
            int row = i / COLUMNS;
            /* A little off, so that rows at 60 degrees pass for rows. */
            dots[i].x = 5 * (i % COLUMNS + (cases[k].shear - 0.01) * row);
            dots[i].y = 5 * cases[k].stretch * row;
        }
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, lattice_find(dots, COLUMNS * ROWS, &lattice, &error));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no square lattice"), error.text);
    }
}

static void too_few_dots_are_refused(void)
{
    struct point dots[COLUMNS * ROWS];
    struct lattice lattice;
    (void)lay_dots(0, 0, dots);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, lattice_find(dots, 8, &lattice, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "8 dots"));
    for (int i = 0; i < COLUMNS * ROWS; i++) {
        dots[i].x = dots[i].y = i; /* on a line */
    }
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, lattice_find(dots, COLUMNS * ROWS, &lattice, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, lattice_find(dots, 0, &lattice, &error));
}

enum { WIDTH = 36, HEIGHT = 30 };
#define PITCH_MM   0.5
#define SPACING_MM 3.0
#define DOT_MM     1.5

static const char station_text[] =
    "sample: {width: 36, height: 30, pitch_mm: 0.5}\n"
    "camera: {driver: virtual, width: 164, height: 142, bayer: GRBG, bits: 10, pedestal: 24,\n"
    "         read_noise: 0.8, electrons: 15}\n"
    "projector: {driver: virtual, wheel_hz: 30}\ntrigger: {driver: virtual}\nplan: plan.yaml\n"
    "virtual:\n  sample: sample.yaml\n  seed: 2\n"
    "  projector: {contrast: 2000, vignetting: 0.2}\n"
    "  camera:\n"
    "    {elevation_deg: 20, roll_deg: 3, pixels_per_point: 4.2, vignetting: 0.2,\n"
    "     distortion: [-0.01, 0], response: [0.7, 1, 0.8]}\n";

/* A printed sheet: nearly white, scattering within a third of a point, with ink in its upper part where the picture is
 * bright. */
static const char target_text[] =
    "width: 36\nheight: 30\npitch_mm: 0.5\nthickness_mm: 1.5\nmargin_points: 4\nbase: paper\n"
    "materials:\n"
    "  - {name: paper, scattering_per_mm: [8, 8, 8], absorption_per_mm: [0.01, 0.01, 0.01],\n"
    "     index: 1.3}\n"
    "  - {name: ink, scattering_per_mm: [8, 8, 8], absorption_per_mm: [7, 7, 7], index: 1.3}\n"
    "inclusions:\n"
    "  - {material: ink, depth_mm: [0, 0.5], map: {image: dots.png, size_mm: [18, 15]}}\n";

static const char *const all_lit = "seed: 3\nblack_frames: 8\nwhite_frames: 3\ndot_spacing: 8\n"
                                   "dot_shift: 4\ngrid_spacing: 1\nwindow: 1\n"
                                   "exposure_turns: [1, 4, 15, 60]\n";

/* Dots turned by 8 degrees, as 60 pixels a mm. */
static void draw_target(bool dots)
{
    enum { PER_MM = 60 };
    struct picture picture;
    char path[256];
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&picture, 18 * PER_MM, 15 * PER_MM, &error));
    for (int i = 0; i < picture.width * picture.height; i++) {
        double x = (i % picture.width + 0.5) / PER_MM - 8.7;
        int row = i / picture.width;
        double y = (row + 0.5) / PER_MM - 7.9;
        double u = cos(0.14) * x + sin(0.14) * y;
        double v = cos(0.14) * y - sin(0.14) * x;
        double across = u - SPACING_MM * round(u / SPACING_MM);
        double down = v - SPACING_MM * round(v / SPACING_MM);
        bool ink = dots ? hypot(across, down) < DOT_MM / 2 : i == 0;
        for (int c = 0; c < 3; c++) {
            picture.rgb[3 * i + c] = ink ? 1 : 0;
        }
    }
    (void)snprintf(path, sizeof path, "%s/dots.png", folder);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_write(path, &picture, NULL, &error));
    picture_finish(&picture);
}

/* Scan the target, say what the station file shall say of the pitch afterwards, and measure. */
static int measure(const char *plan, struct target_report *report)
{
    struct sequence_result result;
    struct develop_report unused;
    char path[256];
    virtual_scan_write(folder, "sample.yaml", target_text);
    virtual_scan_write(folder, "plan.yaml", plan);
    virtual_scan_write(folder, "station.yaml", station_text);
    virtual_scan_run(folder, &result, &unused);
    (void)snprintf(path, sizeof path, "%s/session", folder);
    return target_measure(path, SPACING_MM, NULL, report, &error);
}

/* Make the session's station file lie about the pitch, so that it cannot be where the measured one comes from. */
static void forge_pitch(void)
{
    size_t size = 0;
    char *path = path_join(folder, "session/station.yaml");
    char *text = (char *)file_read(path, &size);
    TEST_ASSERT_NOT_NULL_MESSAGE(text, path);
    char *found = strstr(text, "pitch_mm: 0.5");
    TEST_ASSERT_NOT_NULL_MESSAGE(found, text);
    found[strlen("pitch_mm: 0.")] = '7';
    text_write(path, text);
    free(text);
    free(path);
}

static void pitch_of_a_printed_target_is_true_to_a_third_of_a_percent(void)
{
    struct target_report report;
    struct develop_report developed;
    char session[256], scan[256];
    draw_target(true);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, measure(all_lit, &report), error.text);
    /* Centres: a dot has 3 points, 127 pixels of 1 % noise over 15 x 15 of them, 0.01 sqrt(225 * 19) / 127 = 0.005 pixels;
     * ink is drawn in voxels of at most 0.125 mm, of which some 40 lie on the dot's edge and are in or out by half:
     * sqrt(40 / 12) 0.0156 0.75 / (1.77 sqrt(2)) = 0.009 mm; the camera's 8 x 8 places add 0.01 pixels. In points 0.018 in
     * each axis. Some 20 dots 6 points apart have a spread of 6 sqrt(20 (16 - 1) / 12 * 2) = 42 points at least (a square
     * of 4 x 4 and more): 0.043 %, of which 4. Light is lost at the region's rim, over the mean free path's 0.5 points:
     * at dots 1.5 from it a gradient of 5 % a point, times 1.5^2 / 4, moves outer dots by 0.03 points inward, or outward,
     * of 13: 0.2 % of the outer half of them, 0.1 % in all. */
    TEST_ASSERT_DOUBLE_WITHIN(0.003 * PITCH_MM, PITCH_MM, report.pitch_mm);
    TEST_ASSERT_DOUBLE_WITHIN(0.004 * PITCH_MM, PITCH_MM, report.across);
    TEST_ASSERT_DOUBLE_WITHIN(0.004 * PITCH_MM, PITCH_MM, report.down);
    TEST_ASSERT_TRUE(report.dots >= 16);
    TEST_ASSERT_TRUE(report.doubt > 1e-5 && report.doubt < 0.001);
    /* The scan has it, whatever the station's file says, and the user is told. */
    (void)snprintf(session, sizeof session, "%s/session", folder);
    (void)snprintf(scan, sizeof scan, "%s/scan.exr", folder);
    forge_pitch();
    const struct develop_options options = {.demosaic = DEMOSAIC_FIT,
                                            .store = NACRE_FLOAT,
                                            .flat = FLAT_PAPER,
                                            .target = session,
                                            .target_spacing_mm = SPACING_MM};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, develop_session(session, &options, scan, NULL, &developed, &error), error.text);
    TEST_ASSERT_EQUAL_DOUBLE(report.pitch_mm, developed.pitch_mm);
    TEST_ASSERT_TRUE(developed.warnings.count > 0);
    TEST_ASSERT_NOT_NULL(strstr(developed.warnings.texts[0], "the station file 0.7 mm"));
    struct nacre_scan *written;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_scan_open(scan, &written, &error));
    TEST_ASSERT_EQUAL_FLOAT((float)report.pitch_mm, (float)nacre_scan_info(written)->pitch_mm);
    nacre_scan_close(written);
}

static void sheet_without_dots_is_refused(void)
{
    struct target_report report;
    draw_target(false);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, measure(all_lit, &report));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "shows no dots"), error.text);
}

static void session_of_a_sample_is_refused(void)
{
    struct target_report report;
    draw_target(true);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          measure("seed: 3\nblack_frames: 2\nwhite_frames: 1\ndot_spacing: 8\n"
                                  "dot_shift: 4\ngrid_spacing: 9\ngrid_patterns: 1\nwindow: 9\n"
                                  "exposure_turns: [1, 4, 15, 60]\n",
                                  &report));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "every 9-th point"), error.text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(lattice_is_found_at_every_turn);
    RUN_TEST(dots_beside_the_lattice_are_left_out);
    RUN_TEST(diagonals_are_not_taken_for_rows_where_neighbours_are_lost);
    RUN_TEST(lattices_that_are_not_square_are_refused);
    RUN_TEST(too_few_dots_are_refused);
    RUN_TEST(pitch_of_a_printed_target_is_true_to_a_third_of_a_percent);
    RUN_TEST(sheet_without_dots_is_refused);
    RUN_TEST(session_of_a_sample_is_refused);
    return UNITY_END();
}
