/* Tests of finding out whether the white layer truly lies on the sample, and whether calibrations still hold. */
#include "nacre/exr_file.h"
#include "rig/calibration_reuse.h"
#include "rig/layer_check.h"
#include "rig/sequence.h"

#include "stage.h"
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

static const char sample_text[] = "width: 20\n"
                                  "height: 16\n"
                                  "pitch_mm: 0.4\n"
                                  "thickness_mm: 4\n"
                                  "margin_points: 3\n"
                                  "base: light\n"
                                  "materials:\n"
                                  "  - name: light\n"
                                  "    scattering_per_mm: [2.4, 2.3, 2.1]\n"
                                  "    absorption_per_mm: [0.02, 0.03, 0.06]\n"
                                  "  - name: red\n"
                                  "    scattering_per_mm: [2.9, 2.7, 2.6]\n"
                                  "    absorption_per_mm: [0.04, 0.1, 0.14]\n"
                                  "inclusions:\n"
                                  "  - material: red\n"
                                  "    bands: {angle_deg: 35, period_mm: 4, fraction: 0.5}\n";

static const char station_text[] =
    "sample: {width: 20, height: 16, pitch_mm: 0.4}\n"
    "camera: {driver: virtual, width: 96, height: 80, bits: 10, bayer: RGGB, pedestal: 16,\n"
    "         read_noise: 2, electrons: 8}\n"
    "projector: {driver: virtual, wheel_hz: 30}\n"
    "trigger: {driver: virtual}\n"
    "white_reflectance: 0.9\n"
    "plan: plan.yaml\n"
    "virtual:\n"
    "  sample: sample.yaml\n"
    "  seed: 11\n"
    "  projector: {contrast: 2000, vignetting: 0.1}\n"
    "  camera: {elevation_deg: 12, pixels_per_point: 4, full_scale_s: 0.2}\n";

/* What a person does at each request, in order; the last goes on for good. */
enum deed { DO, NOTHING, OPPOSITE, INSIST };

static struct stage stage;
static struct session session;
static struct virtual_station *station;
static struct devices devices;
static struct sequence_result result;
static struct nacre_error error;
static enum deed deeds[8];
static struct session old; /* whose calibration is used; closed by tearDown */
static int requests, doubts, noise, retries;
static char last_doubt[256];

static int lay(void *context, bool on, struct nacre_error *failure)
{
    enum deed deed = deeds[requests < 7 ? requests : 7];
    (void)context;
    (void)failure;
    requests++;
    if (deed != NOTHING && deed != INSIST) {
        virtual_station_set_white_layer(station, on == (deed == DO));
    }
    return deed == INSIST ? SEQUENCE_INSISTED : NACRE_OK;
}

static void doubt(void *context, const char *why)
{
    (void)context;
    doubts++;
    (void)snprintf(last_doubt, sizeof last_doubt, "%s", why);
}

/* Noise that differs from frame to frame, as that of real cameras does. */
static void renew_noise(void *context)
{
    (void)context;
    virtual_station_begin_pattern(station, (struct pattern){PATTERN_GRID, noise++});
}

static void set_up(const char *text)
{
    stage_make(&stage, text, NULL);
    stage_write(&stage, "sample.yaml", sample_text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(stage.session, stage.station, NULL, false, &session, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, virtual_station_new(&session.station, &station, &error),
                                  error.text);
    devices = (struct devices){.camera = virtual_station_camera(station),
                               .projector = virtual_station_projector(station),
                               .trigger = virtual_station_trigger(station),
                               .clock = virtual_station_clock(station)};
}

static void take_down(void)
{
    virtual_station_free(station);
    session_finish(&session);
    session_finish(&old);
    stage_remove(&stage);
}

void setUp(void)
{
    error.text[0] = last_doubt[0] = '\0';
    memset(deeds, 0, sizeof deeds);
    requests = doubts = noise = retries = 0;
    set_up(station_text);
}

void tearDown(void)
{
    take_down();
}

/* Another station; the sample stays. */
static void begin_again(const char *from, const char *to)
{
    char *text = text_replace(station_text, from, to);
    take_down();
    set_up(text);
    free(text);
}

static int scan(void)
{
    const struct sequence_operator person = {
        .white_layer = lay, .layer_doubted = doubt, .exposure_ends = renew_noise};
    const struct sequence_options options = {
        .retries = retries, .check_layer = true, .calibration = old.path ? &old : NULL};
    return sequence_run(&devices, &session, &person, &options, NULL, &result, &error);
}

static void remove_pattern(enum pattern_kind kind, int number)
{
    char *path = session_pattern_path(&session, (struct pattern){kind, number});
    TEST_ASSERT_EQUAL_INT(0, remove(path));
    free(path);
}

static void person_who_does_it_is_asked_once_for_each_change(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(2, requests);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, doubts, last_doubt);
    TEST_ASSERT_EQUAL_INT(0, result.insisted);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, result.patterns);
    TEST_ASSERT_TRUE(result.times.stages.checks_ns > 0);
    TEST_ASSERT_EQUAL_INT64(0, result.times.rest_ns);
}

static void layer_that_was_not_laid_on_is_noticed(void)
{
    deeds[0] = NOTHING;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(3, requests);
    TEST_ASSERT_EQUAL_INT(1, doubts);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(last_doubt, "no change: the white layer was not laid on"),
                                 last_doubt);
}

static void layer_that_was_not_taken_off_is_noticed(void)
{
    deeds[1] = NOTHING;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(3, requests);
    TEST_ASSERT_EQUAL_INT(1, doubts);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(last_doubt, "no change: the white layer is still on"),
                                 last_doubt);
}

/* A projector of which another program takes the picture away, for black, during the first pattern. */
static struct {
    struct projector base, *inner;
    int shown, asked;
} robbed;

static int show_black_first(struct projector *projector, const uint8_t *levels, int64_t *flip_ns,
                            struct nacre_error *failure)
{
    static const uint8_t black[20 * 16];
    (void)projector;
    return robbed.inner->ops->show(robbed.inner, robbed.shown++ == 0 ? black : levels, flip_ns,
                                   failure);
}

static int confirm_but_first(struct projector *projector, struct nacre_error *failure)
{
    (void)projector;
    return robbed.asked++ == 0 ? nacre_fail(failure, "projector robbed: its picture is gone")
                               : NACRE_OK;
}

/* What was seen of black would make any dots a change. */
static void check_frame_of_another_picture_is_taken_again(void)
{
    static const struct projector_ops ops = {
        .name = "robbed", .show = show_black_first, .confirm = confirm_but_first};
    robbed.inner = devices.projector;
    robbed.base = *robbed.inner;
    robbed.base.ops = &ops;
    robbed.shown = robbed.asked = 0;
    devices.projector = &robbed.base;
    retries = 1;
    deeds[0] = NOTHING;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(3, requests);
    TEST_ASSERT_EQUAL_INT(1, doubts);
    TEST_ASSERT_EQUAL_INT(1, result.retaken[RETAKE_SHOW]);
}

static void layer_taken_off_instead_of_laid_on_is_noticed(void)
{
    virtual_station_set_white_layer(station, true);
    deeds[0] = OPPOSITE;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(3, requests);
    TEST_ASSERT_EQUAL_INT(1, doubts);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(last_doubt, "as if the white layer had been taken off"),
                                 last_doubt);
}

static void person_who_does_nothing_stops_the_scan(void)
{
    for (int i = 0; i < 8; i++) {
        deeds[i] = NOTHING;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan());
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "white layer: asked 3 times to lay it on"),
                                 error.text);
    TEST_ASSERT_EQUAL_INT(3, requests);
    TEST_ASSERT_EQUAL_INT(0, result.patterns);
}

static void layer_that_lay_there_before_needs_insistence(void)
{
    virtual_station_set_white_layer(station, true);
    deeds[1] = INSIST;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(1, doubts);
    TEST_ASSERT_EQUAL_INT(1, result.insisted);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, result.patterns);
}

/* A white board under the layer, of the layer's own colour. */
static void sample_that_looks_like_the_layer_needs_insistence(void)
{
    begin_again("  sample: sample.yaml\n", "");
    deeds[1] = deeds[3] = INSIST;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(4, requests);
    TEST_ASSERT_EQUAL_INT(2, result.insisted);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(last_doubt, "or the sample looks just like it"),
                                 last_doubt);
}

static void resume_with_the_layer_on_is_compared_with_the_first_dots(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    remove_pattern(PATTERN_DOTS, 3);
    remove_pattern(PATTERN_GRID, 4);
    requests = 0;
    deeds[0] = NOTHING; /* it is off */
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(3, requests);
    TEST_ASSERT_EQUAL_INT(1, doubts);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(last_doubt, "does not look as it did with the white layer"),
                                 last_doubt);
    TEST_ASSERT_EQUAL_INT(2, result.patterns);
}

static void resume_with_the_layer_off_is_compared_too(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    remove_pattern(PATTERN_GRID, 4);
    virtual_station_set_white_layer(station, true);
    requests = 0;
    deeds[0] = NOTHING;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(2, requests);
    TEST_ASSERT_EQUAL_INT(1, doubts);
    requests = doubts = 0;
    remove_pattern(PATTERN_GRID, 4); /* and where it is off already, one confirmation is enough */
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(1, requests);
}

/* A camera turned by a degree about its axis: 0.7 pixels at 40 pixels from the middle. */
static void moved_camera_is_noticed_on_resume(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    remove_pattern(PATTERN_DOTS, 3);
    virtual_station_free(station);
    session.station.simulated.camera.roll_deg = 1;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, virtual_station_new(&session.station, &station, &error));
    devices = (struct devices){virtual_station_camera(station), virtual_station_projector(station),
                               virtual_station_trigger(station), virtual_station_clock(station)};
    requests = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan());
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "has moved since this session's calibration"),
                                 error.text);
}

/* Ten times the exposure that saturates: what is still told is told by pixels between the dots. */
static void saturated_frames_are_told_apart_or_called_unclear(void)
{
    begin_again("full_scale_s: 0.2", "full_scale_s: 0.01");
    deeds[0] = NOTHING;
    (void)scan();
    TEST_ASSERT_TRUE_MESSAGE(requests >= 2, error.text);
    TEST_ASSERT_TRUE(doubts >= 1);
}

/* A station at which hardly any light is left: never taken for right. */
static void dark_frames_are_unclear(void)
{
    begin_again("full_scale_s: 0.2", "full_scale_s: 500");
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan());
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(last_doubt, "cannot be told"), last_doubt);
}

/* Measure a session, and begin another, NAME, that is to use its calibration, with `from` in the plan being `to`. */
static void begin_second(const char *from, const char *to)
{
    char path[160];
    char *plan = text_replace(stage_plan, from, to);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    session_finish(&session);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, session_open(stage.session, &old, &error));
    stage_write(&stage, "plan.yaml", plan);
    free(plan);
    (void)snprintf(path, sizeof path, "%s/second", stage.folder);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(path, stage.station, NULL, false, &session, &error), error.text);
    requests = doubts = 0;
}

static void check_origin(struct pattern pattern)
{
    struct pattern_frames taken;
    struct pattern_frames measured;
    struct exr_file file;
    char *path = session_pattern_path(&session, pattern);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_read(&session, pattern, &taken, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, session_read(&old, pattern, &measured, &error));
    for (size_t i = 0; i < taken.count; i++) {
        TEST_ASSERT_EQUAL_UINT16_ARRAY(measured.exposures[i].raw, taken.exposures[i].raw, 96 * 80);
        TEST_ASSERT_EQUAL_INT64(measured.exposures[i].frame_ns, taken.exposures[i].frame_ns);
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_read(path, &file, &error));
    const struct exr_attribute *origin =
        exr_part_find(&file.parts[0], "nacre.calibration", EXR_STRING);
    TEST_ASSERT_NOT_NULL(origin);
    TEST_ASSERT_EQUAL_STRING(stage.session, origin->string);
    exr_file_finish(&file);
    pattern_frames_finish(&taken);
    pattern_frames_finish(&measured);
    free(path);
}

static void calibration_is_used_again_where_nothing_moved(void)
{
    begin_second("seed: 3", "seed: 4");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(STAGE_WHITE + STAGE_DOTS, result.taken_over);
    TEST_ASSERT_EQUAL_INT(STAGE_BLACK + STAGE_GRIDS, result.patterns);
    TEST_ASSERT_EQUAL_INT(2, requests);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, doubts, last_doubt);
    TEST_ASSERT_TRUE(result.moved_px < 0.1);
    TEST_ASSERT_EQUAL_INT64(0, result.times.rest_ns);
    check_origin((struct pattern){PATTERN_WHITE, 0});
    check_origin((struct pattern){PATTERN_DOTS, 3});
}

/* A new virtual station that is not quite the one of the session's file. */
static void move_camera(double roll_deg)
{
    virtual_station_free(station);
    session.station.simulated.camera.roll_deg = roll_deg;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, virtual_station_new(&session.station, &station, &error));
    session.station.simulated.camera.roll_deg = 0;
    devices = (struct devices){virtual_station_camera(station), virtual_station_projector(station),
                               virtual_station_trigger(station), virtual_station_clock(station)};
}

/* Whoever insists that the layer lies there cannot talk this away. */
static void calibration_is_refused_where_something_moved(void)
{
    begin_second("seed: 3", "seed: 4");
    move_camera(1);
    virtual_station_set_white_layer(station, true);
    deeds[0] = INSIST;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan());
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "its calibration does not hold any longer"),
                                 error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "pixels from where they were"), error.text);
    TEST_ASSERT_TRUE(result.moved_px > layer_moved_px && result.moved_px < 1.5);
    TEST_ASSERT_EQUAL_INT(0, result.taken_over + result.patterns);
}

static void calibration_waits_for_the_layer(void)
{
    begin_second("seed: 3", "seed: 4");
    deeds[0] = NOTHING;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(), error.text);
    TEST_ASSERT_EQUAL_INT(3, requests);
    TEST_ASSERT_EQUAL_INT(1, doubts);
    TEST_ASSERT_EQUAL_INT(STAGE_WHITE + STAGE_DOTS, result.taken_over);
}

/* What would be measured then is measured only where nothing has moved from the dots that were taken over. */
static void calibration_that_is_cut_short_has_its_first_dots(void)
{
    begin_second("seed: 3", "seed: 4");
    char *path = session_pattern_path(&session, (struct pattern){PATTERN_WHITE, 0});
    TEST_ASSERT_EQUAL_INT(0, mkdir(path, 0755)); /* which no file can replace */
    free(path);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan());
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "white-000.exr"), error.text);
    TEST_ASSERT_TRUE(session_has(&session, (struct pattern){PATTERN_DOTS, 0}));
}

static void calibration_of_other_dots_is_refused(void)
{
    begin_second("dot_spacing: 4", "dot_spacing: 5");
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan());
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "of another plan: dot_spacing differs"),
                                 error.text);
    TEST_ASSERT_EQUAL_INT(0, requests);
}

static void calibration_of_other_exposures_is_refused(void)
{
    begin_second("[1, 3]", "[1, 4]");
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan());
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "of another plan: exposure_turns differs"),
                                 error.text);
}

static void calibration_of_another_station_is_refused(void)
{
    begin_second("seed: 3", "seed: 4");
    session.station.sample.pitch_mm = 0.41;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, calibration_fits(&old, &session, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "of another station: sample.pitch_mm differs"),
                                 error.text);
    session.station.sample.pitch_mm = 0.4;
    session.station.camera.tolerance_ms = 1; /* has no part in it */
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, calibration_fits(&old, &session, &error), error.text);
}

static void calibration_that_is_not_complete_is_refused(void)
{
    begin_second("white_frames: 1", "white_frames: 2");
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan());
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "pattern white 1 was not measured"),
                                 error.text);
}

/* A picture of dots, moved and of another gain, with noise. */
enum { WIDTH = 120, HEIGHT = 100, PIXELS = WIDTH * HEIGHT };
static uint16_t frames[3][PIXELS];

static double dots_at(double x, double y)
{
    double u = x - 40 * floor(x / 40) - 20;
    double v = y - 40 * floor(y / 40) - 20;
    return 400 / (1 + exp(2 * (sqrt(u * u + v * v) - 4)));
}

static uint32_t state;

/* Numerical Recipes' generator, the same everywhere. */
static double uniform(void)
{
    state = state * 1664525 + 1013904223;
    return state / 4294967296.;
}

/* Of deviation 3. */
static double noise_value(void)
{
    return 6 * (uniform() + uniform() + uniform() - 1.5);
}

static struct frame_difference compare(double right, double down, double gain, double noisy)
{
    state = 1;
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < PIXELS; i++) {
            double x = i % WIDTH;
            double y = i / WIDTH; /* NOLINT(bugprone-integer-division): the row */
            double value = k == 0 ? dots_at(x, y) : gain * dots_at(x - right, y - down) + 7;
            frames[k][i] = (uint16_t)lround(value + 200 + noisy * noise_value());
        }
    }
    const struct frame_pair pair = {frames[0], frames[1], frames[2], WIDTH, HEIGHT, 1023};
    return frame_compare(&pair);
}

/* Up to a quarter more than what is left of a whole number of steps of two pixels, 1 at most. */
static void shift_is_found_to_a_quarter(void)
{
    const double shifts[][2] = {{0, 0}, {0.1, -0.2}, {0.5, 0.3}, {-3.7, 6.2}, {9, -11}};
    for (size_t i = 0; i < sizeof shifts / sizeof *shifts; i++) {
        struct frame_difference d = compare(shifts[i][0], shifts[i][1], 1, 0);
        for (int k = 0; k < 2; k++) {
            double left = fabs(remainder(shifts[i][k], 2));
            TEST_ASSERT_DOUBLE_WITHIN(0.25 * left + 0.01, shifts[i][k],
                                      k == 0 ? d.right_px : d.down_px);
        }
        TEST_ASSERT_DOUBLE_WITHIN(0.02, 1, d.gain);
    }
}

static void gain_is_found_either_way(void)
{
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0.4, compare(0, 0, 0.4, 0.2).gain);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 2, compare(0, 0, 2, 0.2).gain);
}

/* Noise of 3 and of 30, where dots have a contrast of 100. */
static void noise_is_taken_off(void)
{
    struct frame_difference d = compare(0, 0, 1, 1);
    TEST_ASSERT_TRUE(d.rest <= d.doubt);
    TEST_ASSERT_EQUAL_INT(LAYER_WRONG, layer_judge(&d, false, true));
    TEST_ASSERT_EQUAL_INT(LAYER_RIGHT, layer_judge(&d, true, true));
    d = compare(0, 0, 1, 10);
    TEST_ASSERT_TRUE(d.rest <= d.doubt);
    TEST_ASSERT_TRUE(layer_judge(&d, false, true) != LAYER_RIGHT);
}

static void lamp_that_drifts_by_a_tenth_is_no_change(void)
{
    struct frame_difference d = compare(0, 0, 0.9, 1);
    TEST_ASSERT_EQUAL_INT(LAYER_RIGHT, layer_judge(&d, true, true));
    TEST_ASSERT_EQUAL_INT(LAYER_WRONG, layer_judge(&d, false, true));
    d = compare(0, 0, 0.82, 1);
    TEST_ASSERT_EQUAL_INT(LAYER_UNCLEAR, layer_judge(&d, true, true));
    TEST_ASSERT_EQUAL_INT(LAYER_UNCLEAR, layer_judge(&d, false, true));
}

/* The layer still lies there, somebody knocked against the camera. */
static void shift_alone_is_not_the_layer_taken_off(void)
{
    struct frame_difference d = compare(5.3, 2.4, 1, 1);
    TEST_ASSERT_TRUE(layer_judge(&d, false, true) != LAYER_RIGHT);
    TEST_ASSERT_EQUAL_INT(LAYER_MOVED, layer_judge(&d, true, true));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(person_who_does_it_is_asked_once_for_each_change);
    RUN_TEST(layer_that_was_not_laid_on_is_noticed);
    RUN_TEST(layer_that_was_not_taken_off_is_noticed);
    RUN_TEST(check_frame_of_another_picture_is_taken_again);
    RUN_TEST(layer_taken_off_instead_of_laid_on_is_noticed);
    RUN_TEST(person_who_does_nothing_stops_the_scan);
    RUN_TEST(layer_that_lay_there_before_needs_insistence);
    RUN_TEST(sample_that_looks_like_the_layer_needs_insistence);
    RUN_TEST(resume_with_the_layer_on_is_compared_with_the_first_dots);
    RUN_TEST(resume_with_the_layer_off_is_compared_too);
    RUN_TEST(moved_camera_is_noticed_on_resume);
    RUN_TEST(saturated_frames_are_told_apart_or_called_unclear);
    RUN_TEST(dark_frames_are_unclear);
    RUN_TEST(calibration_is_used_again_where_nothing_moved);
    RUN_TEST(calibration_is_refused_where_something_moved);
    RUN_TEST(calibration_waits_for_the_layer);
    RUN_TEST(calibration_that_is_cut_short_has_its_first_dots);
    RUN_TEST(calibration_of_other_dots_is_refused);
    RUN_TEST(calibration_of_other_exposures_is_refused);
    RUN_TEST(calibration_of_another_station_is_refused);
    RUN_TEST(calibration_that_is_not_complete_is_refused);
    RUN_TEST(shift_is_found_to_a_quarter);
    RUN_TEST(gain_is_found_either_way);
    RUN_TEST(noise_is_taken_off);
    RUN_TEST(lamp_that_drifts_by_a_tenth_is_no_change);
    RUN_TEST(shift_alone_is_not_the_layer_taken_off);
    return UNITY_END();
}
