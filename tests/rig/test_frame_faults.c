/* The virtual station's faulty frames against the sequencer: each is noticed and taken again, and none is kept. */
#include "stage.h"
#include "unity.h"

#include <stdlib.h>
#include <string.h>

static struct nacre_error error;

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
}

/* Scan the station of this text; the hash of all raw values that were kept. */
static uint64_t scan(const char *station, int retries, struct sequence_result *result)
{
    uint64_t hash = 14695981039346656037U; /* FNV-1a */
    struct stage stage;
    struct session session;
    struct operator_log log = {0};
    struct pattern *patterns;
    size_t count;
    stage_begin(&stage, station, &session);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, stage_scan(&session, FAULT_LOST, -1, retries, &log, result, &error), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&session.plan, &patterns, &count, &error));
    for (size_t i = 0; i < count; i++) {
        struct pattern_frames frames;
        TEST_ASSERT_EQUAL_INT(NACRE_OK, session_read(&session, patterns[i], &frames, &error));
        for (size_t k = 0; k < frames.count; k++) {
            for (int p = 0; p < frames.width * frames.height; p++) {
                hash = (hash ^ frames.exposures[k].raw[p]) * 1099511628211U;
            }
        }
        pattern_frames_finish(&frames);
    }
    free(patterns);
    session_finish(&session);
    stage_remove(&stage);
    return hash;
}

static uint64_t scan_with(const char *camera, const char *more, struct sequence_result *result)
{
    char *text = text_replace(stage_station, "elevation_deg: 20", camera);
    char *whole = text_replace(text, "  seed: 5\n", more);
    uint64_t hash = scan(whole, 20, result);
    free(text);
    free(whole);
    return hash;
}

/* 32 exposures and more for checks; with 0.25 the chance of no fault in 32 is 1e-4, and the seed is fixed. */
static void dropped_frames_are_taken_again(void)
{
    struct sequence_result result;
    uint64_t sound = scan(stage_station, 0, &result);
    uint64_t hash = scan_with("elevation_deg: 20, dropped_frames: 0.25", "  seed: 5\n", &result);
    TEST_ASSERT_TRUE(result.retaken[RETAKE_LOST] > 0);
    TEST_ASSERT_EQUAL_UINT(result.retries,
                           result.retaken[RETAKE_LOST] + result.retaken[RETAKE_GAP]);
    TEST_ASSERT_EQUAL_UINT64(sound, hash);
}

static void late_frames_are_taken_again(void)
{
    struct sequence_result result;
    uint64_t sound = scan(stage_station, 0, &result);
    uint64_t hash = scan_with("elevation_deg: 20, late_frames: 0.25", "  seed: 5\n", &result);
    TEST_ASSERT_TRUE(result.retaken[RETAKE_LATE] > 0);
    TEST_ASSERT_EQUAL_UINT(result.retries, result.retaken[RETAKE_LATE]);
    TEST_ASSERT_EQUAL_UINT64(sound, hash);
}

static void frames_of_stray_pulses_are_taken_again(void)
{
    struct sequence_result result;
    uint64_t sound = scan(stage_station, 0, &result);
    uint64_t hash =
        scan_with("elevation_deg: 20", "  seed: 5\n  trigger: {stray: 0.25}\n", &result);
    TEST_ASSERT_TRUE(result.retaken[RETAKE_EARLY] > 0);
    TEST_ASSERT_EQUAL_UINT(result.retries, result.retaken[RETAKE_EARLY]);
    TEST_ASSERT_EQUAL_UINT64(sound, hash);
}

static void faults_come_at_their_rates_and_again_with_the_seed(void)
{
    struct sequence_result first;
    struct sequence_result again;
    static const char faults[] = "elevation_deg: 20, late_frames: 0.1, dropped_frames: 0.1";
    uint64_t hash = scan_with(faults, "  seed: 5\n  trigger: {stray: 0.1}\n", &first);
    TEST_ASSERT_EQUAL_UINT64(hash,
                             scan_with(faults, "  seed: 5\n  trigger: {stray: 0.1}\n", &again));
    TEST_ASSERT_EQUAL_MEMORY(first.retaken, again.retaken, sizeof first.retaken);
    TEST_ASSERT_TRUE(first.retries > 0);
    /* Of n tries 1 - 0.9^3 = 0.27 fail. 32 exposures that are kept take 44 tries; 5 standard deviations of the number of
     * failures before 32 successes, sqrt(32 x 0.27) / 0.73 = 4. */
    TEST_ASSERT_DOUBLE_WITHIN(20, 12, (double)first.retries);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(dropped_frames_are_taken_again);
    RUN_TEST(late_frames_are_taken_again);
    RUN_TEST(frames_of_stray_pulses_are_taken_again);
    RUN_TEST(faults_come_at_their_rates_and_again_with_the_seed);
    return UNITY_END();
}
