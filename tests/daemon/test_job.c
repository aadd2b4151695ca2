/* Tests of jobs on a virtual station. */
#include "rehearsal.h"
#include "rig/daemon/words.h"
#include "unity.h"

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* Nothing takes so long here. */
enum { LIMIT_MS = 20000 };
static const int64_t SECOND_NS = 1000000000;

static struct stage stage;
static struct rehearsal rehearsal;
static struct job *job;
static struct job_order order;
static struct job_status now;
static struct nacre_error error;

/* Without noise, equal patterns give equal frames. */
void setUp(void)
{
    char *quiet = text_replace(stage_station, "read_noise: 1.5", "read_noise: 0");
    char *station = text_replace(quiet, "electrons: 8", "electrons: 0");
    struct job_opener opener = rehearsal_opener(&rehearsal);
    error.text[0] = '\0';
    stage_make(&stage, station, NULL);
    free(station);
    free(quiet);
    rehearsal_init(&rehearsal);
    order = (struct job_order){.path = stage.session, .station = stage.station};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, job_new(&opener, &job, &error), error.text);
}

void tearDown(void)
{
    rehearsal_release(&rehearsal);
    job_free(job);
    job = NULL;
    rehearsal_finish(&rehearsal);
    stage_remove(&stage);
}

static void start(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, job_start(job, &order, &error), error.text);
}

/* Wait for a change, and read it. */
static void wait_change(void)
{
    struct pollfd event = {.fd = job_event_fd(job), .events = POLLIN};
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, poll(&event, 1, LIMIT_MS), words_state(now.state));
    job_clear_event(job);
    job_read(job, &now);
}

/* Follow the job until it is in `state`; on the way the person does what is asked, if `helpful`. */
static void follow(enum job_state state, bool helpful)
{
    for (job_read(job, &now); now.state != state; wait_change()) {
        if (now.state == JOB_WAITING && helpful) {
            (void)job_confirm(job, NULL);
        } else {
            TEST_ASSERT_TRUE_MESSAGE(job_is_active(now.state), now.message);
        }
    }
}

/* Help until the camera is asked for so many frames. */
static void help_until_takes(int takes)
{
    struct pollfd event = {.fd = job_event_fd(job), .events = POLLIN};
    while (rehearsal.takes < takes) {
        (void)poll(&event, 1, 10); /* takes are no changes */
        job_clear_event(job);
        job_read(job, &now);
        TEST_ASSERT_TRUE_MESSAGE(job_is_active(now.state), now.message);
        if (now.state == JOB_WAITING) {
            (void)job_confirm(job, NULL);
        }
    }
}

static void measure(void)
{
    start();
    follow(JOB_DONE, true);
}

/* A hash of all raw values of the session, which must lack nothing. */
static uint64_t hash_session(void)
{
    uint64_t hash = 14695981039346656037u; /* FNV-1a */
    struct session session;
    struct pattern *patterns = NULL;
    size_t count = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_open(stage.session, &session, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&session.plan, &patterns, &count, &error));
    for (size_t i = 0; i < count; i++) {
        struct pattern_frames frames;
        TEST_ASSERT_EQUAL_INT_MESSAGE(
            NACRE_OK, session_read(&session, patterns[i], &frames, &error), error.text);
        for (size_t k = 0; k < frames.count; k++) {
            for (int p = 0; p < frames.width * frames.height; p++) {
                hash = (hash ^ frames.exposures[k].raw[p]) * 1099511628211u;
            }
        }
        pattern_frames_finish(&frames);
    }
    free(patterns);
    session_finish(&session);
    return hash;
}

/* What a scan gives that nobody touched: all tests' stations are the same. */
static uint64_t undisturbed(void)
{
    tearDown();
    setUp();
    measure();
    uint64_t hash = hash_session();
    tearDown();
    setUp();
    return hash;
}

static void scan_is_measured_as_the_person_is_asked(void)
{
    start();
    TEST_ASSERT_EQUAL_STRING("session", (job_read(job, &now), now.name));
    follow(JOB_WAITING, false);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(now.message, "lay the white diffuse layer on"),
                                 now.message);
    follow(JOB_DONE, true);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, now.done);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, now.patterns);
    TEST_ASSERT_EQUAL_INT(0, now.retries);
    (void)hash_session();
}

static void nothing_is_exposed_before_the_person_confirms(void)
{
    start();
    follow(JOB_WAITING, false);
    (void)usleep(100000);
    TEST_ASSERT_EQUAL_INT(0, rehearsal.takes);
    TEST_ASSERT_TRUE(job_is_alive(job, -1000 * SECOND_NS));
}

static void layer_in_doubt_is_asked_for_again_until_the_person_insists(void)
{
    job_free(job);
    rehearsal.check_layer = true;
    struct job_opener opener = rehearsal_opener(&rehearsal);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, job_new(&opener, &job, &error));
    start();
    follow(JOB_WAITING, false);
    TEST_ASSERT_NULL_MESSAGE(strstr(now.message, "insist"), now.message);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, job_confirm(job, &error));
    while (now.state != JOB_WAITING || !strstr(now.message, "insist (nacre confirm --insist)")) {
        TEST_ASSERT_TRUE_MESSAGE(job_is_active(now.state), now.message);
        wait_change();
    }
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(now.message, "The check frame shows no change"),
                                 now.message);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, job_insist(job, &error));
    for (job_read(job, &now); now.state != JOB_DONE; wait_change()) {
        TEST_ASSERT_TRUE_MESSAGE(job_is_active(now.state), now.message);
        if (now.state == JOB_WAITING) {
            (void)job_insist(job, NULL);
        }
    }
    (void)hash_session();
}

static void paused_scan_goes_on_and_equals_an_undisturbed_one(void)
{
    uint64_t expected = undisturbed();
    rehearsal.hang_at = 11;
    start();
    help_until_takes(12);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, job_pause(job, &error));
    rehearsal_release(&rehearsal);
    follow(JOB_PAUSED, false);
    size_t done = now.done;
    int takes = rehearsal.takes;
    TEST_ASSERT_TRUE(done > 0 && done < STAGE_PATTERNS);
    (void)usleep(100000);
    TEST_ASSERT_EQUAL_INT(takes, rehearsal.takes);
    TEST_ASSERT_TRUE(job_is_alive(job, -1000 * SECOND_NS));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, job_resume(job, &error));
    follow(JOB_DONE, true);
    TEST_ASSERT_EQUAL_UINT64(expected, hash_session());
}

static void cancelled_scan_is_resumed_and_equals_an_undisturbed_one(void)
{
    uint64_t expected = undisturbed();
    rehearsal.slow_ms = 5;
    start();
    help_until_takes(9);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, job_cancel(job, &error));
    follow(JOB_CANCELLED, true);
    TEST_ASSERT_TRUE(now.done >= 4 && now.done < STAGE_PATTERNS);
    size_t before = now.done;
    order.station = NULL;
    int takes = rehearsal.takes;
    measure();
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, now.done);
    TEST_ASSERT_EQUAL_INT(2 * (STAGE_PATTERNS - (int)before), rehearsal.takes - takes);
    TEST_ASSERT_EQUAL_UINT64(expected, hash_session());
}

static void waiting_scan_is_cancelled_at_once(void)
{
    start();
    follow(JOB_WAITING, false);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, job_cancel(job, &error));
    follow(JOB_CANCELLED, false);
    TEST_ASSERT_EQUAL_INT(0, now.done);
}

static void camera_that_is_gone_fails_the_job_which_is_resumed(void)
{
    uint64_t expected = undisturbed();
    rehearsal.fault = FAULT_UNPLUGGED;
    rehearsal.fault_at = 12;
    start();
    follow(JOB_FAILED, true);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(now.message, "camera faulty: No such device"), now.message);
    TEST_ASSERT_EQUAL_INT(6, now.done);
    rehearsal.fault_at = -1;
    order.station = NULL;
    measure();
    TEST_ASSERT_EQUAL_UINT64(expected, hash_session());
}

static void frame_taken_again_is_counted(void)
{
    rehearsal.fault = FAULT_LOST;
    rehearsal.fault_at = 5;
    measure();
    TEST_ASSERT_EQUAL_INT(1, now.retries);
}

static void devices_that_do_not_open_fail_the_job_and_leave_no_session(void)
{
    rehearsal.refusal = "camera /dev/video7: is not there";
    start();
    follow(JOB_FAILED, false);
    TEST_ASSERT_EQUAL_STRING("camera /dev/video7: is not there", now.message);
    TEST_ASSERT_EQUAL_INT(-1, access(stage.session, F_OK));
    TEST_ASSERT_EQUAL_UINT(1, now.number);
    start(); /* which may fail in the same way before anybody looks, and is told from the first */
    job_read(job, &now);
    TEST_ASSERT_EQUAL_UINT(2, now.number);
    follow(JOB_FAILED, false);
}

static void complete_session_is_done_without_devices(void)
{
    measure();
    rehearsal.refusal = "nothing is plugged in";
    order.station = NULL;
    measure();
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, now.done);
}

static void plan_is_given_as_text(void)
{
    char *plan = text_replace(stage_plan, "black_frames: 2", "black_frames: 5");
    order.plan = plan;
    measure();
    free(plan);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS + 3, now.done);
    (void)hash_session();
}

static void session_whose_making_was_interrupted_is_made_to_the_end(void)
{
    TEST_ASSERT_EQUAL_INT(0, mkdir(stage.session, 0755));
    order.unfinished = true;
    measure();
    (void)hash_session();
}

static void wrong_station_file_is_refused_at_once(void)
{
    stage_write(&stage, "station.yaml", "sample: {width: 6, hight: 5}\n");
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, job_start(job, &order, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "station.yaml:1:20: "), error.text);
    job_read(job, &now);
    TEST_ASSERT_EQUAL_INT(JOB_IDLE, now.state);
}

static void second_job_is_refused_while_one_is_active(void)
{
    start();
    follow(JOB_WAITING, false);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, job_start(job, &order, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "session is being measured"), error.text);
    follow(JOB_DONE, true);
}

static void requests_that_fit_nothing_are_refused(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, job_pause(job, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no scan is running"), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, job_cancel(job, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, job_confirm(job, &error));
    rehearsal.hang_at = 0;
    start();
    follow(JOB_WAITING, false);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, job_resume(job, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "is not paused"), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, job_confirm(job, &error));
    rehearsal_wait_hanging(&rehearsal);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, job_confirm(job, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "nothing to confirm"), error.text);
}

/* The longest silence of the stage is 6 turns of 1/30 s and 6 s for devices: so 6.2 s, of which 6.1 s are taken off. */
static void job_that_hangs_in_a_device_is_not_alive(void)
{
    static const int64_t slack_ns = -6100000000;
    rehearsal.hang_at = 4;
    start();
    help_until_takes(5);
    TEST_ASSERT_TRUE(job_is_alive(job, 0));
    (void)usleep(150000);
    TEST_ASSERT_FALSE(job_is_alive(job, slack_ns));
    TEST_ASSERT_TRUE(job_is_alive(job, 0));
    rehearsal_release(&rehearsal);
    follow(JOB_DONE, true);
    TEST_ASSERT_TRUE(job_is_alive(job, -1000 * SECOND_NS));
}

/* Nobody is waited for any longer, although the question stands until the end. */
static void cancelled_job_that_hangs_in_a_device_is_not_alive(void)
{
    rehearsal.hang_closing = true;
    start();
    follow(JOB_WAITING, false);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, job_cancel(job, &error));
    rehearsal_wait_hanging(&rehearsal);
    (void)usleep(150000);
    TEST_ASSERT_FALSE(job_is_alive(job, -6100000000));
    TEST_ASSERT_TRUE(job_is_alive(job, 0));
    rehearsal_release(&rehearsal);
    follow(JOB_CANCELLED, true);
}

/* Six exposures of 100 ms a pattern; the longest silence is 9 turns of 1/30 s and 6 s: 6.3 s, of which 6 s are taken off. So
 * the pattern takes longer than that, and an exposure does not. */
static void slow_camera_shows_life_with_every_exposure(void)
{
    char *plan = text_replace(stage_plan, "[1, 3]", "[1, 2, 3, 4, 5, 6]");
    order.plan = plan;
    rehearsal.slow_ms = 100;
    start();
    free(plan);
    follow(JOB_WAITING, false);
    (void)job_confirm(job, NULL);
    for (int i = 0; i < 50; i++) {
        TEST_ASSERT_TRUE(job_is_alive(job, -6 * SECOND_NS));
        (void)usleep(10000);
    }
    TEST_ASSERT_TRUE(rehearsal.takes >= 3);
}

static void job_is_stopped_when_it_is_freed(void)
{
    rehearsal.slow_ms = 5;
    start();
    help_until_takes(3);
    job_free(job);
    job = NULL;
    TEST_ASSERT_NULL(rehearsal.station);
    TEST_ASSERT_TRUE(rehearsal.takes < 2 * STAGE_PATTERNS);
}

static void status_is_told_in_the_operators_words(void)
{
    char text[256];
    struct job_status status = {.state = JOB_RUNNING,
                                .pattern = {PATTERN_GRID, 17},
                                .done = 411,
                                .patterns = 2401,
                                .retries = 3,
                                .seconds_left = 4320,
                                .name = "stone"};
    words_describe(&status, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING(
        "measuring grid 17, pattern 412 of 2401, 1 h 12 min left, 3 frames taken again", text);
    status.retries = 1;
    status.seconds_left = 100;
    status.pausing = true;
    words_describe(&status, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("measuring grid 17, pattern 412 of 2401, 2 min left, 1 frame taken "
                             "again; pausing after it",
                             text);
    status.state = JOB_CANCELLED;
    words_describe(&status, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING(
        "stone was stopped after 411 of 2401 patterns; `nacre resume stone` goes on", text);
}

static void texts_for_the_bus_are_clean_utf8(void)
{
    char text[] = "caf\xc3\xa9 \xe2\x82\xac \xff\xc3 \xed\xa0\x80 \xc0\x80 \xe2\x82";
    words_clean(text);
    TEST_ASSERT_EQUAL_STRING("caf\xc3\xa9 \xe2\x82\xac ?? ??? ?? ??", text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(scan_is_measured_as_the_person_is_asked);
    RUN_TEST(nothing_is_exposed_before_the_person_confirms);
    RUN_TEST(layer_in_doubt_is_asked_for_again_until_the_person_insists);
    RUN_TEST(paused_scan_goes_on_and_equals_an_undisturbed_one);
    RUN_TEST(cancelled_scan_is_resumed_and_equals_an_undisturbed_one);
    RUN_TEST(waiting_scan_is_cancelled_at_once);
    RUN_TEST(camera_that_is_gone_fails_the_job_which_is_resumed);
    RUN_TEST(frame_taken_again_is_counted);
    RUN_TEST(devices_that_do_not_open_fail_the_job_and_leave_no_session);
    RUN_TEST(complete_session_is_done_without_devices);
    RUN_TEST(plan_is_given_as_text);
    RUN_TEST(session_whose_making_was_interrupted_is_made_to_the_end);
    RUN_TEST(wrong_station_file_is_refused_at_once);
    RUN_TEST(second_job_is_refused_while_one_is_active);
    RUN_TEST(requests_that_fit_nothing_are_refused);
    RUN_TEST(job_that_hangs_in_a_device_is_not_alive);
    RUN_TEST(cancelled_job_that_hangs_in_a_device_is_not_alive);
    RUN_TEST(slow_camera_shows_life_with_every_exposure);
    RUN_TEST(job_is_stopped_when_it_is_freed);
    RUN_TEST(status_is_told_in_the_operators_words);
    RUN_TEST(texts_for_the_bus_are_clean_utf8);
    return UNITY_END();
}
