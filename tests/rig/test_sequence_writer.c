/* Tests of writing patterns beside the measurement. */
#include "rig/sequence_writer.h"

#include "stage.h"
#include "unity.h"

#include <stdlib.h>
#include <string.h>

/* More than the queue and the threads hold; compressing one takes some hundred times as long as making it. */
enum { PATTERNS = 12, SIDE = 500 };

static struct stage stage;
static struct session session;
static struct nacre_error error;
static int moved;

static void note(void *context)
{
    (void)context;
    moved++;
}

void setUp(void)
{
    error.text[0] = '\0';
    moved = 0;
    stage_begin(&stage, NULL, &session);
}

void tearDown(void)
{
    session_finish(&session);
    stage_remove(&stage);
}

static struct pattern_frames make_frames(int number)
{
    struct pattern_frames frames = {
        .pattern = {PATTERN_GRID, number}, .width = SIDE, .height = SIDE, .bits = 10, .count = 1};
    uint32_t state = (uint32_t)number;
    frames.exposures = calloc(1, sizeof *frames.exposures);
    TEST_ASSERT_NOT_NULL(frames.exposures);
    frames.exposures[0].raw = malloc(SIDE * SIDE * sizeof(uint16_t));
    TEST_ASSERT_NOT_NULL(frames.exposures[0].raw);
    for (int i = 0; i < SIDE * SIDE; i++) {
        state = state * 1664525 + 1013904223;
        frames.exposures[0].raw[i] = (uint16_t)(state >> 22);
    }
    return frames;
}

/* A daemon's watchdog must not take a slow disk for a scan that hangs. */
static void whoever_waits_for_the_disk_is_told_that_it_moves(void)
{
    const struct sequence_writer_listener listener = {note, NULL};
    struct sequence_writer *writer = NULL;
    size_t patterns = 0;
    uint64_t bytes = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, sequence_writer_new(&session, &listener, &writer, &error));
    for (int i = 0; i < PATTERNS; i++) {
        struct pattern_frames frames = make_frames(i);
        TEST_ASSERT_EQUAL_INT(NACRE_OK, sequence_writer_put(writer, &frames, &error));
    }
    TEST_ASSERT_TRUE(moved > 0);
    moved = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, sequence_writer_finish(writer, &patterns, &bytes, &error));
    TEST_ASSERT_TRUE(moved > 0);
    TEST_ASSERT_EQUAL_UINT64(PATTERNS, patterns);
    TEST_ASSERT_TRUE(bytes > 0);
    sequence_writer_free(writer);
}

static void write_that_fails_is_told_by_the_next_and_at_the_end(void)
{
    const struct sequence_writer_listener nobody = {NULL, NULL};
    struct sequence_writer *writer = NULL;
    size_t patterns = 0;
    uint64_t bytes = 0;
    int status = NACRE_OK;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, sequence_writer_new(&session, &nobody, &writer, &error));
    free(session.path);
    session.path = strdup("/nonexistent");
    for (int i = 0; i < PATTERNS && status == NACRE_OK; i++) {
        struct pattern_frames frames = make_frames(i);
        status = sequence_writer_put(writer, &frames, &error);
        TEST_ASSERT_NULL(frames.exposures);
    }
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    error.text[0] = '\0';
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, sequence_writer_finish(writer, &patterns, &bytes, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "/nonexistent"), error.text);
    TEST_ASSERT_EQUAL_UINT64(0, patterns);
    sequence_writer_free(writer);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(whoever_waits_for_the_disk_is_told_that_it_moves);
    RUN_TEST(write_that_fails_is_told_by_the_next_and_at_the_end);
    return UNITY_END();
}
