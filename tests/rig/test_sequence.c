/* Tests of the sequencer on a virtual station with faults. */
#include "rig/sequence.h"

#include "stage.h"
#include "unity.h"

#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

static struct nacre_error error;
static struct stage stage;
static struct session session;
static struct operator_log log_;
static struct sequence_result result;

void setUp(void)
{
    error.text[0] = '\0';
    log_ = (struct operator_log){0};
    stage_begin(&stage, NULL, &session);
}

void tearDown(void)
{
    session_finish(&session);
    stage_remove(&stage);
}

static int scan(enum fault fault, int when, int retries)
{
    return stage_scan(&session, fault, when, retries, &log_, &result, &error);
}

static void read_pattern(struct pattern pattern, struct pattern_frames *frames)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_read(&session, pattern, frames, &error),
                                  error.text);
}

/* A hash of every raw value of every pattern; each pattern must be there, well timed. */
static uint64_t hash_frames(void)
{
    uint64_t hash = 14695981039346656037u; /* FNV-1a */
    struct pattern *patterns;
    size_t count;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&session.plan, &patterns, &count, &error));
    for (size_t i = 0; i < count; i++) {
        struct pattern_frames frames;
        read_pattern(patterns[i], &frames);
        for (size_t k = 0; k < frames.count; k++) {
            const struct exposure *exposure = &frames.exposures[k];
            TEST_ASSERT_TRUE(exposure->trigger_ns >= exposure->flip_ns);
            TEST_ASSERT_EQUAL_INT64(exposure->trigger_ns, exposure->frame_ns);
            for (int p = 0; p < frames.width * frames.height; p++) {
                hash = (hash ^ exposure->raw[p]) * 1099511628211u;
            }
        }
        pattern_frames_finish(&frames);
    }
    free(patterns);
    return hash;
}

/* The hash of a scan that nothing disturbed. */
static uint64_t undisturbed(void)
{
    struct stage own;
    struct session other = session;
    struct operator_log log = {0};
    stage_begin(&own, NULL, &session);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, stage_scan(&session, FAULT_LOST, -1, 0, &log, &result, &error), error.text);
    uint64_t hash = hash_frames();
    session_finish(&session);
    session = other;
    stage_remove(&own);
    return hash;
}

static size_t count_files(const char *folder, bool hidden)
{
    char path[160];
    size_t count = 0;
    (void)snprintf(path, sizeof path, "%s/%s", stage.session, folder);
    DIR *listing = opendir(path);
    TEST_ASSERT_NOT_NULL(listing);
    for (struct dirent *entry = readdir(listing); entry; entry = readdir(listing)) {
        bool is_hidden = entry->d_name[0] == '.';
        count += is_hidden == hidden && strcmp(entry->d_name, ".") != 0 &&
                 strcmp(entry->d_name, "..") != 0;
    }
    (void)closedir(listing);
    return count;
}

static size_t count_patterns(void)
{
    return count_files("frames", false) + count_files("calibration", false);
}

static void scan_measures_every_pattern(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(FAULT_LOST, -1, 0), error.text);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, result.patterns);
    TEST_ASSERT_EQUAL_INT(2 * STAGE_PATTERNS, result.exposures);
    TEST_ASSERT_EQUAL_INT(0, result.retries);
    TEST_ASSERT_EQUAL_INT(0, result.skipped);
    TEST_ASSERT_EQUAL_INT(STAGE_GRIDS, count_files("frames", false));
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS - STAGE_GRIDS, count_files("calibration", false));
    TEST_ASSERT_EQUAL_INT(0, count_files("frames", true));
    TEST_ASSERT_EQUAL_INT(1, log_.layer_on);
    TEST_ASSERT_EQUAL_INT(1, log_.layer_off);
    (void)hash_frames();
}

static void measured_patterns_are_not_measured_again(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan(FAULT_LOST, -1, 0));
    int64_t station_ns = result.station_ns;
    log_ = (struct operator_log){0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan(FAULT_UNPLUGGED, 0, 0));
    TEST_ASSERT_EQUAL_INT(0, result.patterns);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, result.skipped);
    TEST_ASSERT_EQUAL_INT(0, log_.begun + log_.layer_on + log_.layer_off);
    TEST_ASSERT_EQUAL_INT64(0, result.station_ns);
    TEST_ASSERT_TRUE(station_ns > 0);
}

/* Exposures of 1/30 and 1/10 s with 10 ms read-out each, on a station where a pattern appears 16 ms after a refresh at a
 * multiple of 1/30 s: 33.3 + 10 + 100 + 10 ms from the glass on, 16 ms before; 169.3 ms rounded up to the next refresh is
 * 200 ms for each pattern but the last. */
static void station_time_is_that_of_exposures_and_refreshes(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan(FAULT_LOST, -1, 0));
    double expected_s = 0.2 * (STAGE_PATTERNS - 1) + 0.016 + 1. / 30 + 0.1 + 0.02;
    /* Each exposure and refresh is rounded to a nanosecond. */
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, expected_s, (double)result.station_ns * 1e-9);
}

/* Of that time, on a clock on which nothing but devices takes any: 16 patterns wait for 200 - 133.3 - 20 ms each until they
 * are on the glass, the first for 16 ms. */
static void time_is_accounted_for(void)
{
    const struct exposer_times *stages = &result.times.stages;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan(FAULT_LOST, -1, 0));
    double turn_s = 1. / 30;
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, STAGE_PATTERNS * 4 * turn_s,
                              (double)stages->exposing_ns * 1e-9);
    TEST_ASSERT_EQUAL_INT64(2 * STAGE_PATTERNS * 10000000, stages->readout_ns);
    double flip_s = 0.016 + (STAGE_PATTERNS - 1) * (0.2 - 4 * turn_s - 0.02);
    TEST_ASSERT_DOUBLE_WITHIN(400e-9, flip_s, (double)stages->flip_ns * 1e-9);
    TEST_ASSERT_EQUAL_INT64(0, stages->trigger_ns);
    TEST_ASSERT_EQUAL_INT64(0, stages->retakes_ns);
    TEST_ASSERT_EQUAL_INT64(0, stages->checks_ns);
    TEST_ASSERT_EQUAL_INT64(0, result.times.person_ns);
    TEST_ASSERT_EQUAL_INT64(0, result.times.disk_ns);
    TEST_ASSERT_EQUAL_INT64(0, result.times.rest_ns);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, flip_s / turn_s / (2 * STAGE_PATTERNS),
                              sequence_overhead_turns(&result, &session.station));
    TEST_ASSERT_TRUE(sequence_overhead_turns(&result, &session.station) <= 1);
}

/* One more exposure of 1/30 s and one more read-out than kept frames need. */
static void time_of_retakes_is_told_apart(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan(FAULT_LATE, 8, 1));
    const struct exposer_times *stages = &result.times.stages;
    TEST_ASSERT_DOUBLE_WITHIN(10e-9, 1. / 30 + 0.01, (double)stages->retakes_ns * 1e-9);
    TEST_ASSERT_EQUAL_INT64(2 * STAGE_PATTERNS * 10000000, stages->readout_ns);
    TEST_ASSERT_EQUAL_INT64(0, result.times.rest_ns);
}

static void waits_of_the_person_are_told_apart(void)
{
    log_.white_layer_takes_ns = 5000000000;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan(FAULT_LOST, -1, 0));
    TEST_ASSERT_EQUAL_INT64(2 * log_.white_layer_takes_ns, result.times.person_ns);
    TEST_ASSERT_EQUAL_INT64(0, result.times.rest_ns);
}

/* What was retaken was retaken for this reason and no other. */
static void retaken_once_for(enum retake reason)
{
    for (int i = 0; i < RETAKES; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(i == (int)reason, result.retaken[i], retake_names[i]);
    }
}

static void retakes_are_counted_by_reason(void)
{
    const struct {
        enum fault fault;
        enum retake reason;
    } cases[] = {{FAULT_LATE, RETAKE_LATE},
                 {FAULT_EARLY, RETAKE_EARLY},
                 {FAULT_LOST, RETAKE_LOST},
                 {FAULT_DROPPED, RETAKE_GAP},
                 {FAULT_BROKEN, RETAKE_LOST}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        tearDown();
        setUp();
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(cases[i].fault, 9, 1), error.text);
        retaken_once_for(cases[i].reason);
    }
}

/* A projector of which the patterns are gone at the `when`-th question, from 0, and after that `fails` times. */
static struct {
    struct projector base, *inner;
    int when, fails, asked;
} fickle;

static int show_steadily(struct projector *projector, const uint8_t *levels, int64_t *flip_ns,
                         struct nacre_error *failure)
{
    (void)projector;
    return fickle.inner->ops->show(fickle.inner, levels, flip_ns, failure);
}

static int confirm_seldom(struct projector *projector, struct nacre_error *failure)
{
    (void)projector;
    int number = fickle.asked++;
    return number >= fickle.when && number < fickle.when + fickle.fails
               ? nacre_fail(failure, "projector fickle: its picture is gone")
               : NACRE_OK;
}

static int scan_with_fickle_projector(int when, int fails, int retries)
{
    static const struct projector_ops ops = {
        .name = "fickle", .show = show_steadily, .confirm = confirm_seldom};
    struct virtual_station *station = NULL;
    const struct sequence_options options = {.retries = retries};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, virtual_station_new(&session.station, &station, &error));
    fickle.inner = virtual_station_projector(station);
    fickle.base = *fickle.inner;
    fickle.base.ops = &ops;
    fickle.when = when;
    fickle.fails = fails;
    fickle.asked = 0;
    struct devices devices = {virtual_station_camera(station), &fickle.base,
                              virtual_station_trigger(station), virtual_station_clock(station)};
    const struct sequence_operator person = stage_operator(&log_, station);
    int status = sequence_run(&devices, &session, &person, &options, NULL, &result, &error);
    virtual_station_free(station);
    return status;
}

/* Two exposures more than are kept, and their read-outs. */
static void pattern_that_left_the_glass_is_measured_again(void)
{
    uint64_t expected = undisturbed();
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan_with_fickle_projector(4, 1, 1), error.text);
    retaken_once_for(RETAKE_SHOW);
    TEST_ASSERT_EQUAL_INT(2 * STAGE_PATTERNS, result.exposures);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, result.patterns);
    TEST_ASSERT_EQUAL_INT64(2 * STAGE_PATTERNS * 10000000, result.times.stages.readout_ns);
    TEST_ASSERT_TRUE(result.times.stages.retakes_ns > 153000000);
    TEST_ASSERT_EQUAL_INT64(0, result.times.rest_ns);
    TEST_ASSERT_TRUE(hash_frames() == expected);
}

static void pattern_that_never_stays_stops_the_scan(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan_with_fickle_projector(4, 3, 2));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "its picture is gone"), error.text);
    TEST_ASSERT_EQUAL_INT(4, result.patterns);
}

static void frame_that_begins_early_within_the_tolerance_counts(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(FAULT_JITTER, 9, 0), error.text);
    TEST_ASSERT_EQUAL_INT(0, result.retries);
}

static void tolerance_is_the_stations_where_none_is_given(void)
{
    session.station.camera.tolerance_ms = 1.8;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(FAULT_JITTER, 9, 1), error.text);
    retaken_once_for(RETAKE_EARLY);
}

static void fault_is_mended_by_one_retry(enum fault fault)
{
    uint64_t expected = undisturbed();
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(fault, 9, 1), error.text);
    TEST_ASSERT_EQUAL_INT(1, result.retries);
    TEST_ASSERT_EQUAL_INT(2 * STAGE_PATTERNS, result.exposures);
    TEST_ASSERT_TRUE(hash_frames() == expected);
}

static void late_frame_is_taken_again(void)
{
    fault_is_mended_by_one_retry(FAULT_LATE);
}

static void frame_from_before_its_trigger_is_taken_again(void)
{
    fault_is_mended_by_one_retry(FAULT_EARLY);
}

static void lost_frame_is_taken_again(void)
{
    fault_is_mended_by_one_retry(FAULT_LOST);
}

static void frame_after_a_gap_is_taken_again(void)
{
    fault_is_mended_by_one_retry(FAULT_DROPPED);
}

static void input_output_error_is_retried(void)
{
    fault_is_mended_by_one_retry(FAULT_BROKEN);
}

static void doubtful_frame_without_retries_stops_the_scan(enum fault fault, const char *what)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan(fault, 3, 0));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, what), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "pattern dots 0: exposure of 100 ms: "),
                                 error.text);
    TEST_ASSERT_EQUAL_INT(1, count_patterns());
    TEST_ASSERT_EQUAL_INT(1, result.patterns);
}

static void late_frame_is_named(void)
{
    doubtful_frame_without_retries_stops_the_scan(FAULT_LATE,
                                                  "began 40000000 ns after its trigger");
}

static void gap_is_named(void)
{
    doubtful_frame_without_retries_stops_the_scan(FAULT_DROPPED, "frame 4 came where 3 was next");
}

static void dead_camera_stops_the_scan_after_the_retries(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan(FAULT_UNPLUGGED, 11, 4));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "No such device"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "given up after 5 tries"), error.text);
    TEST_ASSERT_EQUAL_INT(4, result.retries);
    TEST_ASSERT_EQUAL_INT(5, result.patterns);
    TEST_ASSERT_EQUAL_INT(5, count_patterns());
}

/* At every exposure in turn: before, within and after each pattern. */
static void scan_resumed_after_a_dead_camera_equals_an_undisturbed_one(void)
{
    uint64_t expected = undisturbed();
    int when = 0;
    int stops = 0;
    while (scan(FAULT_UNPLUGGED, when, 0) != NACRE_OK) {
        TEST_ASSERT_TRUE(stops < 2 * STAGE_PATTERNS);
        stops++;
        when = 2 + stops % 2; /* one pattern each time, and sometimes half of the next */
        session_finish(&session);
        TEST_ASSERT_EQUAL_INT(
            NACRE_OK, session_create(stage.session, stage.station, NULL, true, &session, &error));
    }
    TEST_ASSERT_TRUE(stops > STAGE_PATTERNS / 2);
    TEST_ASSERT_TRUE(hash_frames() == expected);
}

/* Run the scan in a process of its own and kill it when the session holds `patterns` files. */
static void scan_and_kill(size_t patterns)
{
    pid_t child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        _exit(scan(FAULT_LOST, -1, 0) == NACRE_OK ? 0 : 1);
    }
    int status = 0;
    while (count_patterns() < patterns && waitpid(child, &status, WNOHANG) == 0) {
        (void)usleep(200);
    }
    (void)kill(child, SIGKILL);
    (void)waitpid(child, &status, 0);
}

static void scan_resumed_after_kills_equals_an_undisturbed_one(void)
{
    uint64_t expected = undisturbed();
    for (size_t patterns = 1; patterns < STAGE_PATTERNS; patterns += 4) {
        scan_and_kill(patterns);
    }
    session_finish(&session);
    TEST_ASSERT_EQUAL_INT(
        NACRE_OK, session_create(stage.session, stage.station, NULL, true, &session, &error));
    TEST_ASSERT_EQUAL_INT(0, count_files("frames", true));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(FAULT_LOST, -1, 0), error.text);
    TEST_ASSERT_TRUE(hash_frames() == expected);
}

/* The flag that a signal sets is the process's, so this is done in one of its own. */
static void interrupted_scan_leaves_whole_files(void)
{
    int status;
    pid_t child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        progress_catch_signals();
        log_.raise_at = 6;
        _exit(scan(FAULT_LOST, -1, 0) == NACRE_CANCELLED && result.patterns == 6 ? 0 : 1);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
    TEST_ASSERT_EQUAL_INT(6, count_patterns());
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(FAULT_LOST, -1, 0), error.text);
    TEST_ASSERT_EQUAL_INT(6, result.skipped);
    (void)hash_frames();
}

/* A limit on the size of files stands for a disk that fills up while the scan runs. */
static void disk_that_fills_up_stops_the_scan_without_torn_files(void)
{
    int status;
    pid_t child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        const struct rlimit limit = {1000, 1000};
        (void)signal(SIGXFSZ, SIG_IGN);
        (void)setrlimit(RLIMIT_FSIZE, &limit);
        bool stopped = scan(FAULT_LOST, -1, 0) == NACRE_FAILED && strstr(error.text, "session/");
        _exit(stopped && result.patterns == 0 ? 0 : 1);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
    TEST_ASSERT_EQUAL_INT(0, count_patterns());
    TEST_ASSERT_EQUAL_INT(0, count_files("frames", true) + count_files("calibration", true));
}

static int scan_within(int64_t within_ns)
{
    struct virtual_station *station = NULL;
    const struct sequence_options options = {.within_ns = within_ns};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, virtual_station_new(&session.station, &station, &error));
    struct devices devices = {virtual_station_camera(station), virtual_station_projector(station),
                              virtual_station_trigger(station), virtual_station_clock(station)};
    const struct sequence_operator person = stage_operator(&log_, station);
    int status = sequence_run(&devices, &session, &person, &options, NULL, &result, &error);
    virtual_station_free(station);
    return status;
}

/* On the virtual station's clock, at each of many limits: never longer, and no grid less than there was time for. */
static void scan_is_over_within_its_time(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan_within(0));
    int64_t whole_ns = result.station_ns;
    TEST_ASSERT_EQUAL_UINT(0, result.left);
    for (int share = 10; share < 20; share++) {
        tearDown();
        setUp();
        int64_t within_ns = whole_ns * share / 20;
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan_within(within_ns), error.text);
        TEST_ASSERT_TRUE(result.station_ns <= within_ns);
        TEST_ASSERT_TRUE(result.left > 0 && result.left < STAGE_GRIDS);
        TEST_ASSERT_EQUAL_UINT(STAGE_PATTERNS - result.left, result.patterns);
        /* The slowest pattern so far takes twice the mean at most: the white layer's is not counted as overhead of it alone. */
        double mean_ns = (double)whole_ns / STAGE_PATTERNS;
        TEST_ASSERT_TRUE((double)(within_ns - result.station_ns) < 3 * mean_ns);
    }
}

static void what_there_was_no_time_for_is_resumed(void)
{
    uint64_t expected = undisturbed();
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan_within(0));
    int64_t within_ns = result.station_ns * 7 / 10;
    tearDown();
    setUp();
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan_within(within_ns));
    size_t left = result.left;
    TEST_ASSERT_TRUE(left > 0);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan_within(0));
    TEST_ASSERT_EQUAL_UINT(left, result.patterns);
    TEST_ASSERT_TRUE(hash_frames() == expected);
}

static void too_little_time_for_a_grid_is_refused(void)
{
    /* Five patterns with the layer, two black ones and a grid, of 4 turns of 1/30 s each: 1.07 s of exposing. */
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan_within(1000000000));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "calibration and one grid"), error.text);
    TEST_ASSERT_EQUAL_INT(0, count_patterns());
}

static void estimate_counts_what_is_missing(void)
{
    struct sequence_needs needs;
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          sequence_estimate(&session.station, &session.plan, NULL, &needs, &error));
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, needs.patterns);
    TEST_ASSERT_EQUAL_INT(2 * STAGE_PATTERNS, needs.exposures);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, STAGE_PATTERNS * 4. / 30, needs.seconds);
    uint64_t bytes = needs.bytes;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan(FAULT_UNPLUGGED, 12, 0));
    TEST_ASSERT_EQUAL_INT(
        NACRE_OK, sequence_estimate(&session.station, &session.plan, &session, &needs, &error));
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS - 6, needs.patterns);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan(FAULT_LOST, -1, 0));
    TEST_ASSERT_TRUE(result.bytes > 0 && result.bytes < bytes);
}

/* Devices that have no operations but names: a refused scan must not touch them. */
static int run_untouchable(int width, int height, int sample_width)
{
    static const struct camera_ops camera_ops = {.name = "c"};
    static const struct projector_ops projector_ops = {.name = "p"};
    struct camera camera = {&camera_ops, width, height, 10, BAYER_GRBG, false};
    struct projector projector = {&projector_ops, sample_width, 5, 33333333};
    struct clock clock = clock_monotonic();
    struct devices devices = {&camera, &projector, NULL, &clock};
    const struct sequence_options options = {0};
    struct sequence_operator person = {0};
    return sequence_run(&devices, &session, &person, &options, NULL, &result, &error);
}

static void devices_that_differ_from_the_station_file_are_refused(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, run_untouchable(640, 20, 6));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "camera c: delivers 640 x 20 pixels"),
                                 error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, run_untouchable(24, 20, 7));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "projector p: shows 7 x 5 pixels"), error.text);
}

/* 512^2 grids of two 4 GiB exposures: 2 PiB, more than disks have. */
static void scan_larger_than_the_disk_is_refused_before_it_begins(void)
{
    session.station.camera.width = session.station.camera.height = 32768;
    session.plan.grid_spacing = 512;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, run_untouchable(32768, 32768, 6));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "MiB free"), error.text);
    TEST_ASSERT_EQUAL_INT(0, count_patterns());
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(scan_measures_every_pattern);
    RUN_TEST(measured_patterns_are_not_measured_again);
    RUN_TEST(station_time_is_that_of_exposures_and_refreshes);
    RUN_TEST(time_is_accounted_for);
    RUN_TEST(time_of_retakes_is_told_apart);
    RUN_TEST(waits_of_the_person_are_told_apart);
    RUN_TEST(retakes_are_counted_by_reason);
    RUN_TEST(pattern_that_left_the_glass_is_measured_again);
    RUN_TEST(pattern_that_never_stays_stops_the_scan);
    RUN_TEST(frame_that_begins_early_within_the_tolerance_counts);
    RUN_TEST(tolerance_is_the_stations_where_none_is_given);
    RUN_TEST(late_frame_is_taken_again);
    RUN_TEST(frame_from_before_its_trigger_is_taken_again);
    RUN_TEST(lost_frame_is_taken_again);
    RUN_TEST(frame_after_a_gap_is_taken_again);
    RUN_TEST(input_output_error_is_retried);
    RUN_TEST(late_frame_is_named);
    RUN_TEST(gap_is_named);
    RUN_TEST(dead_camera_stops_the_scan_after_the_retries);
    RUN_TEST(scan_resumed_after_a_dead_camera_equals_an_undisturbed_one);
    RUN_TEST(scan_resumed_after_kills_equals_an_undisturbed_one);
    RUN_TEST(interrupted_scan_leaves_whole_files);
    RUN_TEST(disk_that_fills_up_stops_the_scan_without_torn_files);
    RUN_TEST(scan_is_over_within_its_time);
    RUN_TEST(what_there_was_no_time_for_is_resumed);
    RUN_TEST(too_little_time_for_a_grid_is_refused);
    RUN_TEST(estimate_counts_what_is_missing);
    RUN_TEST(devices_that_differ_from_the_station_file_are_refused);
    RUN_TEST(scan_larger_than_the_disk_is_refused_before_it_begins);
    return UNITY_END();
}
