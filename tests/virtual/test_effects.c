/* Effects of the virtual station: each is there when it is called for, and costs nothing when it is not. */
#include "rig/virtual/effects.h"

#include "full.h"
#include "rig/virtual/effects_list.h"
#include "rig/virtual/surface.h"
#include "tests/nacre/scratch.h"
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* As omp.h has it; clang-tidy has no such header. */
extern void omp_set_num_threads(int count);

static struct virtual_station *station;
static uint16_t whole[FULL_PIXELS], other[FULL_PIXELS];
static struct effects work, other_work;

void setUp(void)
{
    scratch_make();
    station = NULL;
}

void tearDown(void)
{
    virtual_station_free(station);
    scratch_remove();
}

/* A frame of a new station of these texts, and the work that was done for it. */
static void measure(const char *station_text, const char *sample_text, uint16_t *raw,
                    struct effects *effects)
{
    virtual_station_free(station);
    station = full_make(station_text, sample_text);
    full_frame(station, raw);
    *effects = *virtual_station_effects(station);
}

/* Both files without what the piece says. */
static void measure_without(const struct full_piece *piece)
{
    char *text = full_take_out(piece->of_sample ? full_sample : full_station, piece->text);
    measure(piece->of_sample ? full_station : text, piece->of_sample ? text : full_sample, other,
            &other_work);
    free(text);
}

/* Both files, and one of them forbids the effect. */
static void measure_forbidden(const struct full_piece *piece, bool by_sample)
{
    char *text = NULL;
    TEST_ASSERT_TRUE(asprintf(&text, "%swithout: [%s]\n", by_sample ? full_sample : full_station,
                              effect_names[piece->effect]) >= 0);
    measure(by_sample ? full_station : text, by_sample ? text : full_sample, other, &other_work);
    free(text);
}

static void effect_that_is_called_for_changes_the_frame_by_more_than_its_threshold(void)
{
    measure(full_station, full_sample, whole, &work);
    double sum = 0;
    for (int i = 0; i < FULL_PIXELS; i++) {
        sum += whole[i] - 64.;
    }
    for (int k = 0; k < full_piece_count; k++) {
        const struct full_piece *piece = &full_pieces[k];
        double difference = 0;
        char message[128];
        measure_without(piece);
        for (int i = 0; i < FULL_PIXELS; i++) {
            difference += fabs((double)whole[i] - other[i]);
        }
        (void)snprintf(message, sizeof message, "%s: %.5f of the frame, wanted %.5f",
                       effect_names[piece->effect], difference / sum, piece->least);
        TEST_ASSERT_TRUE_MESSAGE(difference / sum > piece->least, message);
    }
}

static void absent_effect_does_no_work_and_the_others_do_theirs(void)
{
    measure(full_station, full_sample, whole, &work);
    for (int k = 0; k < full_piece_count; k++) {
        enum effect_id absent = full_pieces[k].effect;
        const char *name = effect_names[absent];
        measure_without(&full_pieces[k]);
        TEST_ASSERT_TRUE_MESSAGE(work.simulated[absent] && work.work[absent] > 0, name);
        for (int i = 0; i < EFFECTS; i++) {
            bool gone = i == (int)absent;
            TEST_ASSERT_EQUAL_INT_MESSAGE(work.simulated[i] && !gone, other_work.simulated[i],
                                          name);
            TEST_ASSERT_EQUAL_UINT64_MESSAGE(gone ? 0 : work.work[i], other_work.work[i], name);
        }
    }
}

static void forbidden_effect_is_as_if_no_file_called_for_it(void)
{
    static uint16_t absent[FULL_PIXELS];
    for (int k = 0; k < full_piece_count; k++) {
        const struct full_piece *piece = &full_pieces[k];
        measure_without(piece);
        memcpy(absent, other, sizeof absent);
        measure_forbidden(piece, k % 2);
        TEST_ASSERT_EQUAL_UINT64(0, other_work.work[piece->effect]);
        TEST_ASSERT_EQUAL_MEMORY_MESSAGE(absent, other, sizeof absent, effect_names[piece->effect]);
    }
}

static void frame_does_not_depend_on_the_number_of_threads(void)
{
    omp_set_num_threads(1);
    measure(full_station, full_sample, whole, &work);
    omp_set_num_threads(2);
    measure(full_station, full_sample, other, &other_work);
    TEST_ASSERT_EQUAL_MEMORY(whole, other, sizeof whole);
    TEST_ASSERT_EQUAL_MEMORY(&work, &other_work, sizeof work);
}

static void seed_changes_what_is_accidental(void)
{
    char *text = full_take_out(full_station, "  seed: 3\n");
    measure(full_station, full_sample, whole, &work);
    measure(text, full_sample, other, &other_work);
    TEST_ASSERT_TRUE(memcmp(whole, other, sizeof whole) != 0);
    free(text);
}

static const char plain_station[] =
    "sample: {width: 16, height: 12, pitch_mm: 0.5}\n"
    "camera: {driver: virtual, width: 80, height: 60, bits: 12, bayer: RGGB}\n"
    "projector: {driver: virtual, wheel_hz: 30}\ntrigger: {driver: virtual}\n";

static void plain_station_does_no_work_at_all(void)
{
    measure(plain_station, full_sample, whole, &work);
    for (int i = 0; i < EFFECTS; i++) {
        TEST_ASSERT_FALSE(work.simulated[i]);
        TEST_ASSERT_EQUAL_UINT64(0, work.work[i]);
    }
}

/* The list of effects of the texts, with the plan's exposures. */
static struct effect *list(const char *station_text, const char *sample_text, double turns,
                           size_t *count)
{
    struct nacre_error error;
    struct station settings;
    struct sample sample;
    struct plan plan = {.exposure_turns = &turns, .exposure_count = 1};
    struct effect *effects = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, sample_read(scratch_text("sample.yaml", sample_text), &sample, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, station_read(scratch_text("station.yaml", station_text), &settings, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          effects_list(&settings, &sample, &plan, &effects, count, &error));
    sample_finish(&sample);
    station_finish(&settings);
    return effects;
}

/* The line, from 1, on which the text begins. */
static int line_of(const char *text, const char *place)
{
    int line = 1;
    for (const char *c = text; c < place; c++) {
        line += *c == '\n';
    }
    return line;
}

static const struct effect *find(const struct effect *effects, size_t count, const char *name)
{
    for (size_t i = 0; i < count; i++) {
        if (strcmp(effects[i].name, name) == 0) {
            return &effects[i];
        }
    }
    TEST_FAIL_MESSAGE(name);
    return effects; /* not reached */
}

static void list_names_the_line_that_calls_for_each_effect(void)
{
    size_t count;
    double turns = 1.5;
    struct effect *effects = list(full_station, full_sample, turns, &count);
    for (int k = 0; k < full_piece_count; k++) {
        const struct full_piece *piece = &full_pieces[k];
        const struct effect *effect = find(effects, count, effect_names[piece->effect]);
        const char *text = piece->of_sample ? full_sample : full_station;
        const char *key = strstr(text, piece->text);
        if (piece->effect == EFFECT_WHEEL) {
            key = strstr(text, "segments");
        } else if (piece->effect == EFFECT_READ_NOISE) {
            key = strstr(text, "read_noise");
        }
        TEST_ASSERT_TRUE_MESSAGE(effect->simulated, effect->name);
        TEST_ASSERT_EQUAL_INT_MESSAGE(piece->of_sample, effect->in_sample, effect->name);
        TEST_ASSERT_EQUAL_INT_MESSAGE(line_of(text, key), effect->line, effect->name);
    }
    TEST_ASSERT_FALSE(find(effects, count, "late frames")->simulated);
    TEST_ASSERT_EQUAL_INT(0, find(effects, count, "late frames")->line);
    free(effects);
}

static void list_leaves_out_a_wheel_whose_turns_are_whole_and_what_is_forbidden(void)
{
    size_t count;
    double turns = 4;
    char *text = NULL;
    TEST_ASSERT_TRUE(asprintf(&text, "%swithout: [dust, tilt]\n", full_station) >= 0);
    const char *place = strstr(text, "without");
    TEST_ASSERT_NOT_NULL(place);
    struct effect *effects = list(text, full_sample, turns, &count);
    TEST_ASSERT_FALSE(find(effects, count, "colour wheel")->simulated);
    TEST_ASSERT_NOT_NULL(strstr(find(effects, count, "colour wheel")->reason, "whole turns"));
    TEST_ASSERT_FALSE(find(effects, count, "dust")->simulated);
    TEST_ASSERT_FALSE(find(effects, count, "dust")->in_sample);
    TEST_ASSERT_EQUAL_INT(line_of(text, place), find(effects, count, "tilt")->line);
    free(effects);
    free(text);
}

/* One random number makes both noises. */
static void list_lets_read_noise_pay_where_shot_noise_is_forbidden(void)
{
    size_t count;
    char *text = NULL;
    struct effect *effects = list(full_station, full_sample, 4, &count);
    double seconds = find(effects, count, "shot noise")->seconds;
    TEST_ASSERT_TRUE(seconds > 0);
    TEST_ASSERT_EQUAL_DOUBLE(0, find(effects, count, "read noise")->seconds);
    free(effects);
    TEST_ASSERT_TRUE(asprintf(&text, "%swithout: [shot noise]\n", full_station) >= 0);
    effects = list(text, full_sample, 4, &count);
    TEST_ASSERT_EQUAL_DOUBLE(0, find(effects, count, "shot noise")->seconds);
    TEST_ASSERT_EQUAL_DOUBLE(seconds, find(effects, count, "read noise")->seconds);
    free(effects);
    free(text);
}

/* Specks of 50 to 150 mm cover a sample of a hundredth of a millimetre; going over all of their places would take an hour. */
static void dust_larger_than_the_sample_covers_it_at_once(void)
{
    struct nacre_error error;
    struct station settings;
    struct sample sample;
    struct surface surface = {0};
    struct effects effects = {.simulated[EFFECT_DUST] = true};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, station_read(scratch_text("station.yaml", plain_station), &settings, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, sample_read(scratch_text("sample.yaml", full_sample), &sample, &error),
        error.text);
    sample.pitch_mm = 1e-3;
    sample.dust = (struct sample_dust){.per_cm2 = 1e6, .size_mm = 100};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, surface_init(&settings, &sample, &effects, &surface, &error));
    for (int i = 0; i < sample.width * sample.height; i++) {
        TEST_ASSERT_EQUAL_FLOAT(0, surface.clear[i]);
    }
    surface_finish(&surface);
    sample_finish(&sample);
    station_finish(&settings);
}

static void refuses(const char *station_text, const char *expected)
{
    struct nacre_error error;
    struct station settings;
    TEST_ASSERT_EQUAL_INT(
        NACRE_FAILED, station_read(scratch_text("station.yaml", station_text), &settings, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, expected), error.text);
}

static void refuses_with(const char *more, const char *expected)
{
    char *text = NULL;
    TEST_ASSERT_TRUE(asprintf(&text, "%s%s", plain_station, more) >= 0);
    refuses(text, expected);
    free(text);
}

static void station_is_refused_for_what_no_single_key_shows(void)
{
    refuses_with("without: [dusk]\n",
                 "station.yaml:5: without: no effect is called 'dusk'; did you "
                 "mean 'dust'?");
    refuses_with("virtual: {projector: {wheel: {segments: [{color: 1, angle_deg: 350}]}}}\n",
                 "station.yaml:5: virtual.projector.wheel.segments: take 350 degrees together");
    refuses_with(
        "virtual: {projector: {wheel: {segments: [{color: [1, 1, 0], angle_deg: 360}]}}}\n",
        "none lets blue through");
    refuses_with("virtual: {camera: {distortion: [-0.45, 0]}}\n",
                 "station.yaml:5: virtual.camera.distortion: [-0.45, 0] folds");
    /* 0.14 r^3 is taken from r: less than 1.04 is left anywhere, and the lens gathers light from 1.1. */
    refuses_with("virtual: {camera: {distortion: [-0.14, 0], defocus_px: 10}}\n",
                 "station.yaml:5: virtual.camera.distortion: [-0.14, 0] folds");
    refuses_with("virtual: {projector: {wheel: {segments: []}}}\n",
                 "station.yaml:5: virtual.projector.wheel.segments: there are none");
    refuses_with("virtual: {projector: {contrast: 0.5}}\n",
                 "station.yaml:5: virtual.projector.contrast: with 0.5 black is as bright");
    refuses_with("virtual:\n  tilt_deg: [20, 0]\n  camera: {elevation_deg: 75}\n",
                 "station.yaml:7: virtual: the camera sees the stage from below");
    refuses_with("virtual:\n  camera: {distance_mm: 2, elevation_deg: 60}\n",
                 "station.yaml:6: virtual: part of the sample is behind the camera");
    refuses("sample: {width: 16, height: 12, pitch_mm: 0.5}\n"
            "camera: {driver: v4l2, width: 80, height: 60, bits: 12, bayer: RGGB}\n"
            "projector: {driver: egl, wheel_hz: 30}\ntrigger: {driver: usb}\n"
            "without: [shot noise]\n",
            "station.yaml:5: without: only a virtual station can leave effects out");
}

static void station_is_refused_for_keys_out_of_range_with_line_and_column(void)
{
    refuses_with("virtual: {projector: {lamp: {drift: -0.1}}}\n", "station.yaml:5:37: drift");
    refuses_with("virtual: {projector: {shift_points: [0.7, 0]}}\n",
                 "station.yaml:5:38: shift_points");
    refuses_with("virtual: {camera: {dead_pixels: 2}}\n", "station.yaml:5:33: dead_pixels");
    refuses_with("virtual: {camera: {darkness: 2}}\n", "station.yaml:5:20:");
    refuses_with("virtual: {trigger: {stray: 1}}\n", "station.yaml:5:28: stray");
}

static void sample_is_refused_for_a_surface_or_dust_that_cannot_be(void)
{
    static const char *const cases[][2] = {
        {"dust: {per_cm2: -1, size_mm: 1}\n", "per_cm2"},
        {"dust: {per_cm2: 1}\n", "size_mm"},
        {"surface: {roughness: 0}\n", "roughness"},
        {"without: [heterogenity]\n",
         "10: without: no effect is called 'heterogenity'; did you mean 'het"},
    };
    char *bare = full_take_out(full_sample, full_pieces[7].text);
    char *clean = full_take_out(bare, full_pieces[8].text);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct nacre_error error;
        struct sample sample;
        char *text = NULL;
        TEST_ASSERT_TRUE(asprintf(&text, "%s%s", clean, cases[i][0]) >= 0);
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                              sample_read(scratch_text("sample.yaml", text), &sample, &error));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, cases[i][1]), error.text);
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "sample.yaml:10"), error.text);
        free(text);
    }
    free(bare);
    free(clean);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(effect_that_is_called_for_changes_the_frame_by_more_than_its_threshold);
    RUN_TEST(absent_effect_does_no_work_and_the_others_do_theirs);
    RUN_TEST(forbidden_effect_is_as_if_no_file_called_for_it);
    RUN_TEST(frame_does_not_depend_on_the_number_of_threads);
    RUN_TEST(seed_changes_what_is_accidental);
    RUN_TEST(plain_station_does_no_work_at_all);
    RUN_TEST(list_names_the_line_that_calls_for_each_effect);
    RUN_TEST(list_leaves_out_a_wheel_whose_turns_are_whole_and_what_is_forbidden);
    RUN_TEST(list_lets_read_noise_pay_where_shot_noise_is_forbidden);
    RUN_TEST(dust_larger_than_the_sample_covers_it_at_once);
    RUN_TEST(station_is_refused_for_what_no_single_key_shows);
    RUN_TEST(station_is_refused_for_keys_out_of_range_with_line_and_column);
    RUN_TEST(sample_is_refused_for_a_surface_or_dust_that_cannot_be);
    return UNITY_END();
}
