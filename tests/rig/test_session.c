/* Tests of session folders and their pattern files. */
#include "rig/session.h"

#include "nacre/exr_file.h"
#include "stage.h"
#include "unity.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static struct nacre_error error;
static struct stage stage;
static struct session session;

void setUp(void)
{
    error.text[0] = '\0';
    stage_begin(&stage, NULL, &session);
}

void tearDown(void)
{
    session_finish(&session);
    stage_remove(&stage);
}

enum { WIDTH = 24, HEIGHT = 20, PIXELS = WIDTH * HEIGHT };

/* Frames of the stage's station with recognisable values. The times need more than 32 bits. */
static struct pattern_frames make_frames(struct pattern pattern)
{
    struct pattern_frames frames = {.pattern = pattern,
                                    .width = WIDTH,
                                    .height = HEIGHT,
                                    .bits = 10,
                                    .bayer = BAYER_GRBG,
                                    .seed = 3,
                                    .count = 2};
    frames.exposures = calloc(2, sizeof *frames.exposures);
    TEST_ASSERT_NOT_NULL(frames.exposures);
    for (size_t k = 0; k < 2; k++) {
        struct exposure *exposure = &frames.exposures[k];
        *exposure =
            (struct exposure){.exposure_ns = session_exposure_ns(&session, k),
                              .flip_ns = 10800000000001 + (int64_t)k,
                              .trigger_ns = 10800000000101 + (int64_t)k,
                              .frame_ns = 10800000000201 + (int64_t)k,
                              .pulse_ns = k == 0 ? 0 : 33333349, /* one that was not measured */
                              .pulse_doubt_ns = k == 0 ? 0 : 1700,
                              .sequence = 4000000000u + (uint32_t)k,
                              .raw = calloc(PIXELS, sizeof(uint16_t))};
        TEST_ASSERT_NOT_NULL(exposure->raw);
        for (int i = 0; i < PIXELS; i++) {
            exposure->raw[i] = (uint16_t)((i * 37 + (int)k * 500 + pattern.number) % 1024);
        }
    }
    return frames;
}

static void write_frames(struct pattern_frames frames)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_write(&session, &frames, &error), error.text);
    pattern_frames_finish(&frames);
}

static void reading_fails(struct pattern pattern, const char *what)
{
    struct pattern_frames frames;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, session_read(&session, pattern, &frames, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, what), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, stage.session), error.text);
    TEST_ASSERT_NULL(frames.exposures);
}

static const struct pattern grid7 = {PATTERN_GRID, 7};

static void frames_come_back_as_they_were_written(void)
{
    struct pattern_frames written = make_frames(grid7);
    struct pattern_frames read;
    TEST_ASSERT_FALSE(session_has(&session, grid7));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_write(&session, &written, &error), error.text);
    TEST_ASSERT_TRUE(session_has(&session, grid7));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_read(&session, grid7, &read, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT(7, read.pattern.number);
    TEST_ASSERT_EQUAL_INT(PATTERN_GRID, read.pattern.kind);
    TEST_ASSERT_EQUAL_INT(BAYER_GRBG, read.bayer);
    TEST_ASSERT_EQUAL_INT(10, read.bits);
    TEST_ASSERT_EQUAL_INT(3, read.seed);
    TEST_ASSERT_EQUAL_INT(2, read.count);
    for (size_t k = 0; k < 2; k++) {
        const struct exposure *a = &written.exposures[k], *b = &read.exposures[k];
        TEST_ASSERT_EQUAL_INT64(a->exposure_ns, b->exposure_ns);
        TEST_ASSERT_EQUAL_INT64(a->flip_ns, b->flip_ns);
        TEST_ASSERT_EQUAL_INT64(a->trigger_ns, b->trigger_ns);
        TEST_ASSERT_EQUAL_INT64(a->frame_ns, b->frame_ns);
        TEST_ASSERT_EQUAL_INT64(a->pulse_ns, b->pulse_ns);
        TEST_ASSERT_EQUAL_INT64(a->pulse_doubt_ns, b->pulse_doubt_ns);
        TEST_ASSERT_EQUAL_UINT32(a->sequence, b->sequence);
        TEST_ASSERT_EQUAL_UINT16_ARRAY(a->raw, b->raw, PIXELS);
    }
    pattern_frames_finish(&written);
    pattern_frames_finish(&read);
}

static void pattern_files_have_the_documented_names(void)
{
    static const struct {
        struct pattern pattern;
        const char *name;
    } cases[] = {{{PATTERN_GRID, 412}, "session/frames/000412.exr"},
                 {{PATTERN_BLACK, 3}, "session/calibration/black-003.exr"},
                 {{PATTERN_WHITE, 0}, "session/calibration/white-000.exr"},
                 {{PATTERN_DOTS, 1234}, "session/calibration/dots-1234.exr"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char *path = session_pattern_path(&session, cases[i].pattern);
        TEST_ASSERT_NOT_NULL(path);
        TEST_ASSERT_EQUAL_STRING(cases[i].name, path + strlen(stage.folder) + 1);
        free(path);
    }
}

static void exposures_are_whole_turns_to_the_nanosecond(void)
{
    TEST_ASSERT_EQUAL_INT64(33333333, session_exposure_ns(&session, 0));
    TEST_ASSERT_EQUAL_INT64(100000000, session_exposure_ns(&session, 1));
}

static void pattern_that_was_not_measured_is_refused(void)
{
    reading_fails(grid7, "frames/000007.exr");
}

static void truncated_file_is_refused(void)
{
    char *path = session_pattern_path(&session, grid7);
    struct stat found;
    write_frames(make_frames(grid7));
    TEST_ASSERT_EQUAL_INT(0, stat(path, &found));
    TEST_ASSERT_EQUAL_INT(0, truncate(path, found.st_size * 2 / 3));
    reading_fails(grid7, "000007.exr");
    TEST_ASSERT_EQUAL_INT(0, truncate(path, 0));
    reading_fails(grid7, "000007.exr");
    free(path);
}

static void file_under_another_name_is_refused(void)
{
    char *path = session_pattern_path(&session, grid7);
    char *other = session_pattern_path(&session, (struct pattern){PATTERN_GRID, 8});
    write_frames(make_frames(grid7));
    TEST_ASSERT_EQUAL_INT(0, rename(path, other));
    reading_fails((struct pattern){PATTERN_GRID, 8}, "shows pattern grid 7");
    free(path);
    free(other);
}

static void file_of_another_session_is_refused(void)
{
    struct pattern_frames frames = make_frames(grid7);
    frames.seed = 4;
    write_frames(frames);
    reading_fails(grid7, "another session");
}

/* Write grid 7 as a session of this id would, and expect its refusal. */
static void foreign_id_is_refused(const char *id)
{
    char own[sizeof session.id];
    memcpy(own, session.id, sizeof own);
    (void)snprintf(session.id, sizeof session.id, "%s", id);
    write_frames(make_frames(grid7));
    memcpy(session.id, own, sizeof own);
    reading_fails(grid7, "another session");
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, own), error.text);
}

static void file_of_another_session_with_the_same_settings_is_refused(void)
{
    TEST_ASSERT_EQUAL_UINT(16, strlen(session.id));
    foreign_id_is_refused("0123456789abcdef");
    foreign_id_is_refused(""); /* of an older nacre */
}

static void session_without_an_id_takes_frames_without_one_only(void)
{
    struct pattern_frames frames;
    char path[160];
    write_frames(make_frames(grid7));
    (void)snprintf(path, sizeof path, "%s/session.yaml", stage.session);
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    session_finish(&session);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, session_open(stage.session, &session, &error));
    reading_fails(grid7, "another session");
    write_frames(make_frames(grid7));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_read(&session, grid7, &frames, &error),
                                  error.text);
    pattern_frames_finish(&frames);
}

static void damaged_id_is_refused(void)
{
    stage_write(&stage, "session/session.yaml", "id: 0123456789abcdeX\n");
    struct session opened;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, session_open(stage.session, &opened, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "16 hexadecimal digits"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "session.yaml"), error.text);
}

/* The id of a session that is made for this. */
static void make_id(const char *name, char id[17])
{
    struct session other;
    char path[160];
    (void)snprintf(path, sizeof path, "%s/%s", stage.folder, name);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(path, stage.station, NULL, false, &other, &error), error.text);
    memcpy(id, other.id, sizeof other.id);
    session_finish(&other);
}

static void ids_follow_from_the_settings_where_all_is_virtual(void)
{
    char same[17], other[17];
    make_id("same", same);
    TEST_ASSERT_EQUAL_STRING(session.id, same);
    char *text = text_replace(stage_station, "  seed: 5\n", "  seed: 6\n");
    stage_write(&stage, "station.yaml", text);
    make_id("other", other);
    TEST_ASSERT_TRUE(strcmp(session.id, other) != 0);
    free(text);
}

static void ids_are_drawn_where_something_is_real(void)
{
    char one[17], other[17];
    char *text =
        text_replace(stage_station, "trigger: {driver: virtual}", "trigger: {driver: usb}");
    stage_write(&stage, "station.yaml", text);
    make_id("one", one);
    make_id("other", other);
    TEST_ASSERT_TRUE(strcmp(one, other) != 0);
    free(text);
}

static void resumed_session_keeps_its_id(void)
{
    char own[17];
    memcpy(own, session.id, sizeof own);
    stage_write(&stage, "session/session.yaml", "id: 0123456789abcdef\n"); /* as if drawn */
    session_finish(&session);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(stage.session, stage.station, NULL, true, &session, &error),
        error.text);
    TEST_ASSERT_EQUAL_STRING("0123456789abcdef", session.id);
    TEST_ASSERT_TRUE(strcmp(own, session.id) != 0);
    session_finish(&session);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(stage.session, NULL, NULL, true, &session, &error), error.text);
    TEST_ASSERT_EQUAL_STRING("0123456789abcdef", session.id);
}

static void file_of_another_camera_is_refused(void)
{
    struct pattern_frames frames = make_frames(grid7);
    frames.width = 20;
    write_frames(frames);
    reading_fails(grid7, "is 20 x 20 where the station's frames are 24 x 20");
    frames = make_frames(grid7);
    frames.bits = 12;
    write_frames(frames);
    reading_fails(grid7, "12 bits");
    frames = make_frames(grid7);
    frames.bayer = BAYER_RGGB;
    write_frames(frames);
    reading_fails(grid7, "Bayer order RGGB");
}

static void file_with_other_exposures_is_refused(void)
{
    struct pattern_frames frames = make_frames(grid7);
    frames.exposures[1].exposure_ns++;
    write_frames(frames);
    reading_fails(grid7, "100000001 ns");
    frames = make_frames(grid7);
    frames.count = 1;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, session_write(&session, &frames, &error));
    frames.count = 2;
    pattern_frames_finish(&frames);
    reading_fails(grid7, "1 exposures where the plan has 2");
}

static void value_above_saturation_is_refused(void)
{
    struct pattern_frames frames = make_frames(grid7);
    frames.exposures[1].raw[5] = 1024;
    write_frames(frames);
    reading_fails(grid7, "1024");
}

static void other_picture_is_refused(void)
{
    struct exr_file file = {0};
    char *path = session_pattern_path(&session, grid7);
    struct exr_part *part = exr_file_add_part(&file, "a", WIDTH, HEIGHT);
    TEST_ASSERT_NOT_NULL(exr_part_add_plane(part, "raw", NACRE_UINT));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_write(path, &file, EXR_ZIP, &error));
    reading_fails(grid7, "nacre.format");
    exr_file_finish(&file);
    free(path);
}

static void session_is_opened_with_the_settings_it_was_made_from(void)
{
    struct session opened;
    char where[64];
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_open(stage.session, &opened, &error),
                                  error.text);
    TEST_ASSERT_TRUE(
        settings_same(&station_schema, &session.station, &opened.station, where, sizeof where));
    TEST_ASSERT_TRUE(settings_same(&plan_schema, &session.plan, &opened.plan, where, sizeof where));
    session_finish(&opened);
}

static void folder_that_is_no_session_is_refused(void)
{
    struct session opened;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, session_open("/nowhere", &opened, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "/nowhere"), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, session_open(stage.station, &opened, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "is no session"), error.text);
}

static int create(bool resume)
{
    session_finish(&session);
    return session_create(stage.session, stage.station, NULL, resume, &session, &error);
}

static void existing_session_is_not_begun_again(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, create(false));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "--resume"), error.text);
}

static void session_that_does_not_exist_is_not_resumed(void)
{
    struct session other;
    char path[128];
    (void)snprintf(path, sizeof path, "%s/other", stage.folder);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          session_create(path, stage.station, NULL, true, &other, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, path), error.text);
    TEST_ASSERT_EQUAL_INT(-1, access(path, F_OK));
}

static void session_is_resumed_with_the_same_settings_or_its_own(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, create(true), error.text);
    session_finish(&session);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(stage.session, NULL, NULL, true, &session, &error), error.text);
    TEST_ASSERT_EQUAL_INT(WIDTH, session.station.camera.width);
}

static void comments_and_defaults_spelled_out_are_no_difference(void)
{
    char *text = text_replace(stage_station, "  bits: 10\n", "  bits: 10 # as ever\n");
    char *more = text_replace(text, "elevation_deg: 20", "elevation_deg: 20.0, distance_mm: 500");
    stage_write(&stage, "station.yaml", more);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, create(true), error.text);
    free(text);
    free(more);
}

static void resume_refuses_other_settings(void)
{
    char *text = text_replace(stage_station, "elevation_deg: 20", "elevation_deg: 21");
    stage_write(&stage, "station.yaml", text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, create(true));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "virtual.camera.elevation_deg"), error.text);
    free(text);
    stage_write(&stage, "station.yaml", stage_station);
    text = text_replace(stage_plan, "[1, 3]", "[1, 4]");
    stage_write(&stage, "plan.yaml", text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, create(true));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "exposure_turns"), error.text);
    free(text);
}

static void session_is_measured_by_one_program_at_a_time(void)
{
    struct session other;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          session_create(stage.session, stage.station, NULL, true, &other, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "another program"), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, create(true), error.text);
}

static void resume_removes_unfinished_files_and_nothing_else(void)
{
    struct stat found;
    char unfinished[160], other[160];
    write_frames(make_frames(grid7));
    (void)snprintf(unfinished, sizeof unfinished, "%s/frames/.000008.exr.part-aB3xY9",
                   stage.session);
    (void)snprintf(other, sizeof other, "%s/frames/.notes", stage.session);
    TEST_ASSERT_EQUAL_INT(0, close(creat(unfinished, 0666)));
    TEST_ASSERT_EQUAL_INT(0, close(creat(other, 0666)));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, create(true), error.text);
    TEST_ASSERT_EQUAL_INT(-1, stat(unfinished, &found));
    TEST_ASSERT_EQUAL_INT(0, stat(other, &found));
    TEST_ASSERT_TRUE(session_has(&session, grid7));
}

static void session_killed_while_it_was_made_is_made_to_the_end(void)
{
    char path[160];
    (void)snprintf(path, sizeof path, "%s/plan.yaml", stage.session);
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    (void)snprintf(path, sizeof path, "%s/frames", stage.session);
    TEST_ASSERT_EQUAL_INT(0, rmdir(path));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, create(true), error.text);
    write_frames(make_frames(grid7));
    session_finish(&session);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_open(stage.session, &session, &error),
                                  error.text);
}

static void station_without_a_plan_needs_one(void)
{
    struct session other;
    char path[128];
    char *text = text_replace(stage_station, "plan: plan.yaml\n", "");
    (void)snprintf(path, sizeof path, "%s/other", stage.folder);
    stage_write(&stage, "station.yaml", text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          session_create(path, stage.station, NULL, false, &other, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "--plan"), error.text);
    TEST_ASSERT_EQUAL_INT(-1, access(path, F_OK));
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(path, stage.station, stage.plan, false, &other, &error),
        error.text);
    session_finish(&other);
    free(text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(frames_come_back_as_they_were_written);
    RUN_TEST(pattern_files_have_the_documented_names);
    RUN_TEST(exposures_are_whole_turns_to_the_nanosecond);
    RUN_TEST(pattern_that_was_not_measured_is_refused);
    RUN_TEST(truncated_file_is_refused);
    RUN_TEST(file_under_another_name_is_refused);
    RUN_TEST(file_of_another_session_is_refused);
    RUN_TEST(file_of_another_session_with_the_same_settings_is_refused);
    RUN_TEST(session_without_an_id_takes_frames_without_one_only);
    RUN_TEST(damaged_id_is_refused);
    RUN_TEST(ids_follow_from_the_settings_where_all_is_virtual);
    RUN_TEST(ids_are_drawn_where_something_is_real);
    RUN_TEST(resumed_session_keeps_its_id);
    RUN_TEST(file_of_another_camera_is_refused);
    RUN_TEST(file_with_other_exposures_is_refused);
    RUN_TEST(value_above_saturation_is_refused);
    RUN_TEST(other_picture_is_refused);
    RUN_TEST(session_is_opened_with_the_settings_it_was_made_from);
    RUN_TEST(folder_that_is_no_session_is_refused);
    RUN_TEST(existing_session_is_not_begun_again);
    RUN_TEST(session_that_does_not_exist_is_not_resumed);
    RUN_TEST(session_is_resumed_with_the_same_settings_or_its_own);
    RUN_TEST(comments_and_defaults_spelled_out_are_no_difference);
    RUN_TEST(resume_refuses_other_settings);
    RUN_TEST(session_is_measured_by_one_program_at_a_time);
    RUN_TEST(resume_removes_unfinished_files_and_nothing_else);
    RUN_TEST(session_killed_while_it_was_made_is_made_to_the_end);
    RUN_TEST(station_without_a_plan_needs_one);
    return UNITY_END();
}
