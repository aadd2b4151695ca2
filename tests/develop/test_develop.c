/* Developing a whole made session. */
#include "compare.h"
#include "made.h"
#include "nacre/scan.h"
#include "rig/develop/blur.h"
#include "rig/develop/develop.h"
#include "tests/files.h"
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Of libgomp, whose header only gcc finds. */
void omp_set_num_threads(int count);
int omp_get_max_threads(void);

static const char plan_text[] = "seed: 5\nblack_frames: 10\nwhite_frames: 3\ndot_spacing: 8\n"
                                "dot_shift: 4\ndot_size: 2\ngrid_spacing: 7\nwindow: 7\n"
                                "exposure_turns: [1, 4, 16, 64]\n";
enum { SPACING = 7, GRIDS = SPACING * SPACING };

/* The made material is not reciprocal: its fall-off cannot be told from it. */
static const struct develop_options usual = {.black = BLACK_SUBTRACT,
                                             .confidence = 0.99,
                                             .demosaic = DEMOSAIC_AUTO,
                                             .store = NACRE_FLOAT,
                                             .flat = FLAT_PAPER};
static struct made_station station;
static char *folder, *session_path, *scan_path;
static struct nacre_error error;

/* 20 x 16 points seen by 104 x 90 pixels. */
static struct made_station small_station(void)
{
    struct made_station small = made_station_usual();
    small.width = 20;
    small.height = 16;
    small.camera_width = 104;
    small.camera_height = 90;
    small.reach = 0.55;
    small.dead_x = 50;
    small.dead_y = 41;
    return small;
}

void setUp(void)
{
    memset(&error, 0, sizeof error);
}

void tearDown(void)
{
    (void)unlink(scan_path); /* the next test begins without */
}

static struct develop_report develop(const struct develop_options *options)
{
    struct develop_report report;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, develop_session(session_path, options, scan_path, NULL, &report, &error),
        error.text);
    return report;
}

/* Developing fails, says so with these words, and leaves no file. */
static void developing_fails_with(const char *words)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          develop_session(session_path, &usual, scan_path, NULL, NULL, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, words), error.text);
    TEST_ASSERT_TRUE(access(scan_path, F_OK) != 0);
}

static struct comparison compare(void)
{
    return made_compare(&station, scan_path);
}

static void developed_scan_is_close_to_the_exact_responses(void)
{
    struct develop_report report = develop(&usual);
    struct comparison found = compare();
    /* A lit point of R_d 0.27 gives some 0.27 * 600 raw units of 15 electrons in each of its 5 red or blue pixels: 0.9 %
     * of shot noise in the entry that dominates the norm. The made camera samples its views at 8 x 8 places, which
     * moves shares of the straddling third of the pixels by 0.02 to 0.04: another 0.8 %. Twice their sum is a fault. */
    TEST_ASSERT_DOUBLE_WITHIN(0.024, 0, found.error);
    /* Light from the neighbours' tails: at most what falls outside the windows. */
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0.002, found.bias);
    TEST_ASSERT_TRUE(report.overlap > 0.002 && report.overlap < 0.02);
    /* Corners of the window get no light but what the neighbours leak: their scatter is what the report calls noise. */
    TEST_ASSERT_TRUE(found.far_rms > 0.8 * report.noise && found.far_rms < 2 * report.noise);
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 0, report.align.rms_px);
    TEST_ASSERT_EQUAL_INT(GRIDS, report.patterns);
    TEST_ASSERT_EQUAL_INT(0, report.missing_patterns);
    TEST_ASSERT_EQUAL_UINT(20 * 16, report.responses);
    TEST_ASSERT_EQUAL_UINT(0, report.missing_entries);
    TEST_ASSERT_EQUAL_UINT(0, found.missing);
    TEST_ASSERT_EQUAL_UINT(1, report.linearity.dead);
    TEST_ASSERT_EQUAL_UINT(0, report.linearity.nonlinear);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 4.4, report.pixels_per_point);
    /* A sharp camera: what is left are the 8 x 8 places. */
    TEST_ASSERT_EQUAL_INT(DEMOSAIC_FIT, report.demosaic);
    TEST_ASSERT_DOUBLE_WITHIN(0.04, 0, report.misfit);
    TEST_ASSERT_DOUBLE_WITHIN(0.002, 0, report.linearity.deviation);
}

static void fit_is_nearer_than_area_and_malvar(void)
{
    /* The default is the one with the least error: the others blur a steep response over straddling pixels. One that sees
     * the share f of a point and 1 - f of the next counts by f for the former: across each of a point's four edges the mean of
     * f (1 - f), 1/6, of a pixel's 1/4.4 passes, 0.038. A lit point of 1 among neighbours of e^(-1 / 0.55) = 0.16 loses 0.152
     * and gets back 0.024; each neighbour gets some 0.02: sqrt(0.128^2 + 4 0.02^2) / sqrt(1 + 4 0.16^2) = 0.13. With five
     * pixels of red or blue a point instead of many, and with what Malvar's filters do to that, it may be twice that or half. */
    for (int demosaic = DEMOSAIC_AREA; demosaic <= DEMOSAIC_MALVAR; demosaic++) {
        struct develop_options options = usual;
        options.demosaic = (enum demosaic)demosaic;
        (void)develop(&options);
        struct comparison found = compare();
        TEST_ASSERT_TRUE(found.error > 0.065 && found.error < 0.25);
    }
}

static void clipping_black_darkens_the_tails(void)
{
    struct develop_options options = usual;
    (void)develop(&options);
    struct comparison subtracted = compare();
    options.black = BLACK_CLIP;
    (void)develop(&options);
    struct comparison clipped = compare();
    TEST_ASSERT_TRUE(clipped.bias < subtracted.bias - 0.004);
    TEST_ASSERT_TRUE(clipped.error > subtracted.error);
}

static void half_floats_lose_only_their_rounding(void)
{
    struct develop_options options = usual;
    (void)develop(&options);
    double full = compare().error;
    options.store = NACRE_HALF;
    (void)develop(&options);
    TEST_ASSERT_DOUBLE_WITHIN(0x1p-11, full, compare().error); /* half has 11 significant bits */
}

static char *read_all(size_t *size)
{
    char *bytes = (char *)file_read(scan_path, size);
    TEST_ASSERT_NOT_NULL_MESSAGE(bytes, scan_path);
    return bytes;
}

static void number_of_threads_does_not_matter(void)
{
    size_t size;
    size_t other_size;
    int threads = omp_get_max_threads();
    omp_set_num_threads(1);
    (void)develop(&usual);
    char *bytes = read_all(&size);
    omp_set_num_threads(5);
    (void)develop(&usual);
    char *others = read_all(&other_size);
    omp_set_num_threads(threads);
    TEST_ASSERT_EQUAL_UINT(size, other_size);
    TEST_ASSERT_EQUAL_MEMORY(bytes, others, size);
    free(bytes);
    free(others);
}

/* The file of a pattern in the session; heap. */
static char *pattern_path(enum pattern_kind kind, int number)
{
    struct session session = {.path = session_path};
    return session_pattern_path(&session, (struct pattern){kind, number});
}

/* Move files of a kind away, or back. */
static void hide(enum pattern_kind kind, int count, bool away)
{
    for (int n = 0; n < count; n++) {
        char *path = pattern_path(kind, n);
        char *hidden = NULL;
        TEST_ASSERT_TRUE(asprintf(&hidden, "%s.hidden", path) > 0);
        TEST_ASSERT_EQUAL_INT(0, away ? rename(path, hidden) : rename(hidden, path));
        free(path);
        free(hidden);
    }
}

/* Put frames that hold one value in the place of those of a kind, or the true ones back. */
static void fill(enum pattern_kind kind, int count, int value)
{
    if (value >= 0) {
        hide(kind, count, true);
        for (int n = 0; n < count; n++) {
            made_measure(&station, session_path, (struct pattern){kind, n}, value);
        }
    } else {
        hide(kind, count, false);
    }
}

static void missing_grids_leave_responses_not_measured(void)
{
    hide(PATTERN_GRID, 2, true);
    struct develop_report report = develop(&usual);
    struct comparison found = compare();
    hide(PATTERN_GRID, 2, false);
    /* 20 x 16 points, every 7 from (0, 0) and from (1, 0): 3 x 3 each. */
    TEST_ASSERT_EQUAL_INT(2, report.missing_patterns);
    TEST_ASSERT_EQUAL_UINT(18, found.missing);
    TEST_ASSERT_EQUAL_UINT(20 * 16 - 18, report.responses);
    TEST_ASSERT_DOUBLE_WITHIN(0.024, 0, found.error);
}

static void some_calibration_frames_may_be_missing(void)
{
    hide(PATTERN_WHITE, 1, true);
    hide(PATTERN_BLACK, 8, true);
    hide(PATTERN_DOTS, 1, true);
    struct develop_report report = develop(&usual);
    hide(PATTERN_WHITE, 1, false);
    hide(PATTERN_BLACK, 8, false);
    hide(PATTERN_DOTS, 1, false);
    TEST_ASSERT_EQUAL_INT(2, report.white_frames);
    TEST_ASSERT_EQUAL_INT(2, report.black_frames);
    TEST_ASSERT_EQUAL_INT(3, report.dots_frames);
    TEST_ASSERT_DOUBLE_WITHIN(0.03, 0, compare().error);
}

static void kinds_without_any_frame_are_named(void)
{
    const struct {
        enum pattern_kind kind;
        int count;
        const char *words;
    } kinds[] = {{PATTERN_WHITE, 3, "no white frame"},
                 {PATTERN_BLACK, 10, "no black frame"},
                 {PATTERN_DOTS, 4, "no dots frame"},
                 {PATTERN_GRID, GRIDS, "no grid pattern"}};
    for (size_t k = 0; k < 4; k++) {
        hide(kinds[k].kind, kinds[k].count, true);
        developing_fails_with(kinds[k].words);
        hide(kinds[k].kind, kinds[k].count, false);
    }
}

static void frames_of_another_pattern_are_refused(void)
{
    char *path = pattern_path(PATTERN_GRID, 3);
    char *other = pattern_path(PATTERN_GRID, 4);
    char *kept = NULL;
    TEST_ASSERT_TRUE(asprintf(&kept, "%s.kept", path) > 0);
    TEST_ASSERT_EQUAL_INT(0, rename(path, kept));
    TEST_ASSERT_EQUAL_INT(0, link(other, path));
    developing_fails_with("shows pattern grid 4");
    TEST_ASSERT_NOT_NULL(strstr(error.text, "000003.exr"));
    TEST_ASSERT_EQUAL_INT(0, rename(kept, path));
    free(path);
    free(other);
    free(kept);
}

static void damaged_frames_are_refused(void)
{
    char *path = pattern_path(PATTERN_GRID, 5);
    TEST_ASSERT_EQUAL_INT(0, truncate(path, 3000));
    developing_fails_with("000005.exr");
    made_measure(&station, session_path, (struct pattern){PATTERN_GRID, 5}, -1);
    free(path);
}

static void frames_that_say_nothing_are_refused(void)
{
    const struct {
        enum pattern_kind kind;
        int count, value;
        const char *words;
    } cases[] = {{PATTERN_WHITE, 3, 1023, "white frames are saturated"},
                 {PATTERN_WHITE, 3, 16, "white frames are dark"},
                 {PATTERN_BLACK, 10, 1023, "black frames are saturated"},
                 {PATTERN_DOTS, 4, 16, "dots do not fit"},
                 {PATTERN_DOTS, 4, 1023, "dots do not fit"},
                 {PATTERN_GRID, GRIDS, 1023, "grid frame is saturated"},
                 {PATTERN_GRID, GRIDS, 16, "no light"}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        fill(cases[k].kind, cases[k].count, cases[k].value);
        developing_fails_with(cases[k].words);
        fill(cases[k].kind, cases[k].count, -1);
    }
}

static void falloff_that_nothing_tells_is_left_in_and_warned_of(void)
{
    struct develop_options options = usual;
    struct develop_report report;
    options.flat = FLAT_SEPARATE;
    hide(PATTERN_GRID, GRIDS - 2, true); /* the two that are left are neighbours */
    report = develop(&options);
    struct comparison found = compare();
    hide(PATTERN_GRID, GRIDS - 2, false);
    TEST_ASSERT_EQUAL_UINT(0, report.falloff_pairs);
    TEST_ASSERT_EQUAL_INT(1, report.warnings.count);
    TEST_ASSERT_NOT_NULL(strstr(report.warnings.texts[0], "was not taken out"));
    TEST_ASSERT_DOUBLE_WITHIN(0.03, 0, found.error);
}

static void sample_that_is_not_reciprocal_keeps_the_papers_way(void)
{
    /* The made material lets light pass to the right better by up to (1 + 0.2 tanh 0.9) / (1 - 0.2 tanh 0.9), 1.33 over 3
     * points: over 20 points no projector does that. */
    struct develop_options options = usual;
    options.flat = FLAT_SEPARATE;
    struct develop_report report = develop(&options);
    TEST_ASSERT_EQUAL_UINT(0, report.falloff_pairs);
    TEST_ASSERT_EQUAL_INT(1, report.warnings.count);
    TEST_ASSERT_NOT_NULL(strstr(report.warnings.texts[0], "no projector does"));
    TEST_ASSERT_DOUBLE_WITHIN(0.024, 0, compare().error);
}

static void saturated_points_are_not_measured(void)
{
    fill(PATTERN_GRID, 1, 1023);
    struct develop_report report = develop(&usual);
    fill(PATTERN_GRID, 1, -1);
    TEST_ASSERT_EQUAL_UINT(20 * 16, report.responses);
    TEST_ASSERT_TRUE(report.missing_entries > 3 * 9 * 16);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1.0 / GRIDS, report.saturated_share);
}

static void what_is_no_session_is_refused(void)
{
    char *kept = session_path;
    session_path = folder; /* holds station.yaml and plan.yaml but no frames */
    developing_fails_with("no grid pattern");
    TEST_ASSERT_TRUE(asprintf(&session_path, "%s/nowhere", folder) > 0);
    developing_fails_with("nowhere");
    free(session_path);
    TEST_ASSERT_TRUE(asprintf(&session_path, "%s/plan.yaml", folder) > 0);
    developing_fails_with("is no session");
    free(session_path);
    session_path = kept;
}

static void output_that_cannot_be_written_is_refused(void)
{
    char *kept = scan_path;
    TEST_ASSERT_TRUE(asprintf(&scan_path, "%s/nowhere/scan.exr", folder) > 0);
    developing_fails_with("nowhere");
    free(scan_path);
    scan_path = kept;
}

static void camera_without_colours_gives_one_channel(void)
{
    struct made_station colour = station;
    char *kept = session_path;
    char *mono_folder = folder_make();
    station.bayer = BAYER_MONO;
    station.bits = 12;
    station.white[1] =
        station.white[0]; /* its white layer: green's reflectance is the one that counts */
    for (int c = 0; c < 3; c++) {
        station.gain[c] *= 4;
    }
    session_path = made_session(&station, mono_folder, plan_text);
    struct develop_report report = develop(&usual);
    TEST_ASSERT_EQUAL_INT(1, report.channels);
    TEST_ASSERT_DOUBLE_WITHIN(0.024, 0, compare().error);
    free(session_path);
    folder_remove(mono_folder);
    session_path = kept;
    station = colour;
}

/* Another session of the same sample, as long as the test runs. */
struct other {
    struct made_station station;
    char *path, *folder;
};

static struct other other_begin(double blur_px, double soft_px, double layer_soft_px)
{
    struct other kept = {station, session_path, folder_make()};
    station.blur_px = blur_px;
    station.soft_px = soft_px;
    station.layer_soft_px = layer_soft_px;
    session_path = made_session(&station, kept.folder, plan_text);
    return kept;
}

static void other_end(struct other *kept)
{
    free(session_path);
    folder_remove(kept->folder);
    session_path = kept->path;
    station = kept->station;
}

static double error_by(enum demosaic demosaic)
{
    struct develop_options options = usual;
    options.demosaic = demosaic;
    struct develop_report report = develop(&options);
    TEST_ASSERT_EQUAL_INT(demosaic, report.demosaic);
    TEST_ASSERT_TRUE(isnan(report.misfit));
    TEST_ASSERT_TRUE(report.blur_px == 0);
    return compare().error;
}

/* The blur whose picture of an edge is nearest, by least squares, to that of a lens which spreads light evenly over a pixel and
 * `more`: its ends are longer than such a lens's, so its deviation is greater. */
static double nearest_blur(double more)
{
    double best = 0, least = INFINITY, weights[2 * BLUR_REACH + 1];
    for (int step = 0; step < 100 * BLUR_MOST; step++) {
        double blur = 0.01 * step;
        int reach = blur_weights(blur, weights);
        double squares = 0;
        for (int place = -400; place < 400; place++) {
            double x = 0.02 * place;
            double left = fmin(fmax(x / (1 + more) + 0.5, 0), 1);
            for (int k = -reach; k <= reach; k++) {
                left -= weights[reach + k] * fmin(fmax(x + k + 0.5, 0), 1);
            }
            squares += left * left;
        }
        best = squares < least ? blur : best;
        least = fmin(squares, least);
    }
    return best;
}

static void a_camera_out_of_focus_is_seen_in_the_dots(void)
{
    struct other kept = other_begin(1.2, 0, 0);
    struct develop_report report = develop(&usual);
    double error_found = compare().error;
    TEST_ASSERT_EQUAL_INT(DEMOSAIC_FIT, report.demosaic);
    /* the section ends within 0.03; the dots are no edges, but squares four pixels wide */
    TEST_ASSERT_DOUBLE_WITHIN(0.06, nearest_blur(1.2), report.blur_px);
    TEST_ASSERT_TRUE(report.misfit < 0.1);
    TEST_ASSERT_TRUE(error_found < 0.5 * error_by(DEMOSAIC_FIT));
    TEST_ASSERT_TRUE(error_found < 0.5 * error_by(DEMOSAIC_MALVAR));
    other_end(&kept);
}

static void light_that_is_soft_in_the_sample_goes_by_malvar(void)
{
    struct other kept = other_begin(0, 1.2, 0);
    struct develop_report report = develop(&usual);
    TEST_ASSERT_TRUE(report.misfit > 0.1);
    TEST_ASSERT_TRUE(report.blur_px == 0);
    TEST_ASSERT_EQUAL_INT(DEMOSAIC_MALVAR, report.demosaic);
    other_end(&kept);
}

/* With a sample whose light is soft, too, but less: the dots' blur does not become the grids. */
static void a_white_layer_that_spreads_light_is_no_blur_of_the_camera(void)
{
    struct other kept = other_begin(0, 0, 1.2);
    struct develop_report report = develop(&usual);
    TEST_ASSERT_EQUAL_INT(DEMOSAIC_FIT, report.demosaic);
    TEST_ASSERT_TRUE(report.blur_px == 0);
    other_end(&kept);
    kept = other_begin(0, 0.4, 2.4);
    report = develop(&usual);
    TEST_ASSERT_TRUE(report.misfit > 0.03); /* so that the dots were asked */
    TEST_ASSERT_TRUE(report.blur_px == 0);
    other_end(&kept);
}

int main(void)
{
    UNITY_BEGIN();
    folder = folder_make();
    if (asprintf(&scan_path, "%s/scan.exr", folder) < 0) {
        return EXIT_FAILURE;
    }
    station = small_station();
    session_path = made_session(&station, folder, plan_text);
    RUN_TEST(developed_scan_is_close_to_the_exact_responses);
    RUN_TEST(fit_is_nearer_than_area_and_malvar);
    RUN_TEST(clipping_black_darkens_the_tails);
    RUN_TEST(half_floats_lose_only_their_rounding);
    RUN_TEST(number_of_threads_does_not_matter);
    RUN_TEST(missing_grids_leave_responses_not_measured);
    RUN_TEST(some_calibration_frames_may_be_missing);
    RUN_TEST(kinds_without_any_frame_are_named);
    RUN_TEST(frames_of_another_pattern_are_refused);
    RUN_TEST(damaged_frames_are_refused);
    RUN_TEST(frames_that_say_nothing_are_refused);
    RUN_TEST(falloff_that_nothing_tells_is_left_in_and_warned_of);
    RUN_TEST(sample_that_is_not_reciprocal_keeps_the_papers_way);
    RUN_TEST(saturated_points_are_not_measured);
    RUN_TEST(what_is_no_session_is_refused);
    RUN_TEST(output_that_cannot_be_written_is_refused);
    RUN_TEST(a_camera_out_of_focus_is_seen_in_the_dots);
    RUN_TEST(light_that_is_soft_in_the_sample_goes_by_malvar);
    RUN_TEST(a_white_layer_that_spreads_light_is_no_blur_of_the_camera);
    RUN_TEST(camera_without_colours_gives_one_channel);
    free(session_path);
    free(scan_path);
    folder_remove(folder);
    return UNITY_END();
}
