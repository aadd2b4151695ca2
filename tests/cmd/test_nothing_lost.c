/* A scan killed at any moment, stopped, or out of disk is resumed to what an undisturbed one gives, and nothing that
 * was written is measured again. */
#include "tests/cmd/frames.h"
#include "tests/cmd/mounts.h"
#include "tests/cmd/spawn.h"
#include "tests/cmd/told.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <unity.h>

/* 1 white, 4 dots, 2 black, 25 grids. */
enum { PATTERNS = 32, EXPOSURES = 2, STOPS = 20, STOPPED = 130 };
/* Under sanitizers, which look at the runs and not at the disk, fewer will do. */
#ifdef __SANITIZE_ADDRESS__
enum { KILLS = 40 };
#else
enum { KILLS = 200 };
#endif
/* Every so many sessions are developed, too, which follows from their files' being the same. */
enum { DEVELOPED = 10 };
/* So often at most one session's scan is killed. */
enum { CHAIN = 3 };

static const char plan[] =
    "{seed: 5, black_frames: 2, white_frames: 1, dot_spacing: 4, dot_shift: 2, dot_size: 1,\n"
    " grid_spacing: 5, window: 5, exposure_turns: [1, 8]}\n";

static const char sample[] =
    "{width: 8, height: 8, pitch_mm: 0.5, thickness_mm: 2, margin_points: 2, base: light,\n"
    " materials: [{name: light, scattering_per_mm: [2.4, 2.3, 2.1],\n"
    "              absorption_per_mm: [0.2, 0.3, 0.6]}]}\n";

/* Takes what the sensor's noise is, and the lamp. */
static const char station[] =
    "sample: {width: 8, height: 8, pitch_mm: 0.5}\n"
    "camera: {driver: virtual, width: 40, height: 40, bits: 10, bayer: RGGB, pedestal: 16%s}\n"
    "projector: {driver: virtual, wheel_hz: 30}\n"
    "trigger: {driver: virtual}\n"
    "white_reflectance: 0.9\n"
    "plan: plan.yaml\n"
    "virtual:\n"
    "  sample: sample.yaml\n"
    "  seed: 11\n"
    "  projector: {contrast: 2000, vignetting: 0.1%s}\n"
    "  camera: {elevation_deg: 12, pixels_per_point: 4}\n";

/* One kind of station and what an undisturbed scan on it gives. */
struct truth {
    char *station, *session, *developed;
};

/* Where kills found the scan. */
struct landings {
    int kills;       /* that ended a scan */
    int early, late; /* before its first file, after its last */
    int unmade;      /* of the early ones: before the session was made to the end */
    int writing;     /* while files were being written */
    int inside;      /* in the work: between files or while one was being written */
    int sessions, resumed;
    int measured, taken_over; /* patterns: by the runs that came to their end, and by runs before */
};

static bool can_mount;
static char *folder;
static struct truth quiet, noisy;
static int undisturbed_us, start_us; /* of a scan; of the program, until it begins a session */
static uint64_t random_state = 20261122;

void setUp(void)
{
}

void tearDown(void)
{
}

/* SplitMix64 (Steele, Lea and Flood 2014), scaled to below `limit`. */
static int draw(int limit)
{
    uint64_t z = random_state += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return (int)((z ^ z >> 31) % (uint64_t)limit);
}

static int64_t now_us(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000 + now.tv_nsec / 1000;
}

/* Scan, going on with what there is. */
static struct spawned scan(const char *session, const struct truth *truth,
                           const struct circumstances *around)
{
    bool begun = access(session, F_OK) == 0;
    const char *const arguments[] = {
        NACRE, "scan", session, "--station", truth->station, "--json", begun ? "--resume" : NULL,
        NULL};
    return spawn(arguments, around);
}

static void develop(const char *session, const char *output)
{
    const char *const arguments[] = {NACRE, "develop", session, "-o", output, "--quiet", NULL};
    struct spawned run = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    spawned_finish(&run);
}

/* Made before the tests, so what fails here ends the program. */
static struct truth make_truth(const char *name, const char *noise, const char *lamp)
{
    char *text = NULL;
    char *file = NULL;
    struct truth truth = {.session = path_join(folder, name)};
    if (asprintf(&text, station, noise, lamp) < 0 ||
        asprintf(&file, "%s.yaml", truth.session) < 0 ||
        asprintf(&truth.developed, "%s.exr", truth.session) < 0) {
        abort();
    }
    truth.station = file;
    text_write(file, text);
    free(text);
    return truth;
}

static void measure_truth(const struct truth *truth)
{
    int64_t began_us = now_us();
    struct spawned run = scan(truth->session, truth, NULL);
    int took_us = (int)(now_us() - began_us);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    TEST_ASSERT_EQUAL_INT(PATTERNS, told_count(run.output, "patterns"));
    TEST_ASSERT_EQUAL_INT(PATTERNS, session_files_count(truth->session).patterns);
    develop(truth->session, truth->developed);
    undisturbed_us = undisturbed_us == 0 || took_us < undisturbed_us ? took_us : undisturbed_us;
    spawned_finish(&run);
}

/* What a scan takes before it begins, by one that has nothing to measure. */
static void measure_start(const struct truth *truth)
{
    int64_t began_us = now_us();
    struct spawned run = scan(truth->session, truth, NULL);
    start_us = (int)(now_us() - began_us);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    TEST_ASSERT_EQUAL_INT(0, told_count(run.output, "patterns"));
    spawned_finish(&run);
}

static void undisturbed_scans_are_measured(void)
{
    measure_truth(&quiet);
    measure_truth(&noisy);
    measure_start(&noisy);
}

/* What a run that came to its end says must be what it found and what it left. */
static void expect_complete(const struct spawned *run, struct session_files before,
                            const char *session, const struct truth *truth,
                            struct landings *landings)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run->status, run->errors);
    int measured = told_count(run->output, "patterns");
    TEST_ASSERT_EQUAL_INT_MESSAGE(before.patterns, told_count(run->output, "measured_before"),
                                  session);
    TEST_ASSERT_EQUAL_INT_MESSAGE(PATTERNS - before.patterns, measured, session);
    TEST_ASSERT_EQUAL_INT(EXPOSURES * measured, told_count(run->output, "frames"));
    TEST_ASSERT_EQUAL_INT(0, told_count(run->output, "retries"));
    frames_expect_same(truth->session, session);
    landings->measured += measured;
    landings->taken_over += before.patterns;
    landings->resumed += before.patterns > 0;
    if (landings->sessions++ % DEVELOPED == 0) {
        char *developed = path_join(session, "../developed.exr");
        size_t size = 0;
        size_t wanted_size = 0;
        develop(session, developed);
        uint8_t *bytes = file_read(developed, &size);
        uint8_t *wanted = file_read(truth->developed, &wanted_size);
        TEST_ASSERT_TRUE(size > 0 && size == wanted_size && memcmp(bytes, wanted, size) == 0);
        free(bytes);
        free(wanted);
        free(developed);
    }
}

static void note_kill(struct session_files files, bool made, struct landings *landings)
{
    landings->kills++;
    landings->unmade += !made;
    landings->early += files.patterns == 0;
    landings->late += files.patterns == PATTERNS;
    landings->writing += files.unfinished > 0;
    landings->inside += files.unfinished > 0 || (files.patterns > 0 && files.patterns < PATTERNS);
}

/* When to send `number` to a run that still has `missing` patterns to measure: one in six at any moment, the others after
 * its start, which takes its time on a busy machine. */
static struct circumstances draw_moment(int number, int missing, const char *last_settings)
{
    int work_us = (undisturbed_us > start_us ? undisturbed_us - start_us : 0) / PATTERNS * missing;
    struct circumstances around = {.signal = number};
    if (draw(6) == 0) {
        around.interrupt_us = 1 + draw(start_us + work_us);
    } else if (access(last_settings, F_OK) != 0) {
        around.interrupt_path = last_settings;
        around.interrupt_us = draw(work_us + 1);
    } else {
        around.interrupt_us = start_us + draw(work_us + 1);
    }
    return around;
}

/* Measure one session, killing its runs by `number` at random moments until one comes to its end; the later ones, which
 * have less to do, at earlier moments. */
static void measure_and_kill(int number, int limit, const struct truth *truth,
                             struct landings *landings)
{
    char *below = folder_make();
    char *session = path_join(below, "session");
    char *last_settings = path_join(session, "plan.yaml");
    bool complete = false;
    for (int i = 0; !complete; i++) {
        struct session_files before = session_files_count(session);
        const struct circumstances around =
            draw_moment(number, PATTERNS - before.patterns, last_settings);
        bool disturbed = i < CHAIN && landings->kills < limit;
        struct spawned run = scan(session, truth, disturbed ? &around : NULL);
        complete = run.status == 0;
        if (complete) {
            expect_complete(&run, before, session, truth, landings);
        } else {
            bool by_signal =
                run.status == 128 + number || (number == SIGTERM && run.status == STOPPED);
            struct session_files files = session_files_count(session);
            TEST_ASSERT_TRUE_MESSAGE(disturbed && by_signal, run.errors);
            TEST_ASSERT_TRUE(files.patterns >= before.patterns);
            TEST_ASSERT_TRUE(number == SIGKILL || files.unfinished == 0);
            note_kill(files, access(last_settings, F_OK) == 0, landings);
        }
        spawned_finish(&run);
    }
    free(last_settings);
    free(session);
    folder_remove(below);
}

static struct landings kill_all(int number, int limit)
{
    struct landings landings = {0};
    for (int i = 0; landings.kills < limit; i++) {
        measure_and_kill(number, limit, i % 2 == 0 ? &quiet : &noisy, &landings);
    }
    printf("signal %d: %d scans ended by it: %d before the first pattern (%d before the session "
           "was made), %d between, "
           "%d after the last; %d while a file was being written. %d sessions, %d of them resumed, "
           "in which %d patterns "
           "were measured by the last run and %d before. An undisturbed scan: %d ms\n",
           number, landings.kills, landings.early, landings.unmade,
           landings.kills - landings.early - landings.late, landings.late, landings.writing,
           landings.sessions, landings.resumed, landings.measured, landings.taken_over,
           undisturbed_us / 1000);
    return landings;
}

static void scans_killed_at_any_moment_are_resumed(void)
{
    struct landings landings = kill_all(SIGKILL, KILLS);
    TEST_ASSERT_EQUAL_INT(KILLS, landings.kills);
    /* A fast machine shows all patterns before the first file is whole: these are in the middle too. */
    TEST_ASSERT_TRUE(landings.inside >= KILLS / 3);
    TEST_ASSERT_TRUE(landings.kills - landings.early - landings.late >= KILLS / 10);
    TEST_ASSERT_TRUE(landings.writing >= KILLS / 10);
}

static void scans_that_are_asked_to_stop_leave_whole_files(void)
{
    struct landings landings = kill_all(SIGTERM, STOPS);
    TEST_ASSERT_EQUAL_INT(STOPS, landings.kills);
    TEST_ASSERT_TRUE(landings.kills - landings.early - landings.late >= STOPS / 4);
}

/* Fill the disk to its last byte. */
static void fill(const char *path)
{
    static const char zeros[4096];
    int file = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    TEST_ASSERT_TRUE(file >= 0);
    while (write(file, zeros, sizeof zeros) > 0) {
    }
    TEST_ASSERT_EQUAL_INT(ENOSPC, errno);
    (void)close(file);
}

/* A disk that others fill when the scan has written `patterns` files. False where they came when it had ended: a busy machine
 * may not let them in for as long. */
static bool fill_while_scanning(const char *below, const char *session, int patterns)
{
    char *ballast = path_join(below, "ballast");
    struct landings landings = {0};
    pid_t filler = fork();
    TEST_ASSERT_TRUE(filler >= 0);
    if (filler == 0) {
        while (session_files_count(session).patterns < patterns) {
            (void)usleep(500);
        }
        fill(ballast);
        _exit(0);
    }
    struct spawned run = scan(session, &noisy, NULL);
    (void)waitpid(filler, NULL, 0);
    struct session_files files = session_files_count(session);
    if (files.patterns == PATTERNS) {
        spawned_finish(&run);
        free(ballast);
        return false;
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, run.status, run.errors);
    /* Noticed before a pattern is measured, or when it is written. */
    TEST_ASSERT_TRUE_MESSAGE(
        strstr(run.errors, "free some space") || strstr(run.errors, strerror(ENOSPC)), run.errors);
    TEST_ASSERT_TRUE(files.patterns >= patterns && files.patterns < PATTERNS);
    TEST_ASSERT_EQUAL_INT(0, files.unfinished);
    TEST_ASSERT_EQUAL_INT(0, unlink(ballast));
    struct spawned again = scan(session, &noisy, NULL);
    expect_complete(&again, files, session, &noisy, &landings);
    spawned_finish(&run);
    spawned_finish(&again);
    free(ballast);
    return true;
}

/* No file may grow beyond a few bytes: the first pattern is not written. */
static void scan_under_a_limit(const char *session)
{
    const struct circumstances limited = {.file_limit = 2000};
    struct landings landings = {0};
    struct spawned run = scan(session, &noisy, &limited);
    struct session_files files = session_files_count(session);
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, run.status, run.errors);
    TEST_ASSERT_EQUAL_INT(0, files.patterns + files.unfinished);
    struct spawned again = scan(session, &noisy, NULL);
    expect_complete(&again, files, session, &noisy, &landings);
    spawned_finish(&run);
    spawned_finish(&again);
}

static void scan_whose_disk_fills_up_is_resumed(void)
{
    static const int moments[] = {1, 7, 20};
    enum { MOMENTS = sizeof moments / sizeof *moments, TRIES = 40 };
    int filled = 0;
    for (int tries = 0; filled < MOMENTS; tries++) {
        char *below = folder_make();
        char *session = path_join(below, "session");
        TEST_ASSERT_TRUE_MESSAGE(tries < TRIES, "the scan ends before the disk is filled");
        if (can_mount) {
            TEST_ASSERT_TRUE(mounts_disk(below, 1 << 20));
            filled += fill_while_scanning(below, session, moments[filled]);
            mounts_remove(below);
        } else {
            scan_under_a_limit(session);
            filled++;
        }
        free(session);
        folder_remove(below);
    }
    printf("disk full: %s\n",
           can_mount ? "3 scans on a disk that others fill" : "3 scans under a limit");
}

static void finish_truth(struct truth *truth)
{
    free(truth->station);
    free(truth->session);
    free(truth->developed);
}

int main(void)
{
    can_mount = mounts_enter();
    folder = folder_make();
    char *plan_path = path_join(folder, "plan.yaml");
    char *sample_path = path_join(folder, "sample.yaml");
    text_write(plan_path, plan);
    text_write(sample_path, sample);
    quiet = make_truth("quiet", "", "");
    noisy = make_truth("noisy", ", read_noise: 0.5, electrons: 8",
                       ", lamp: {drift: 0.05, drift_hours: 0.01, flicker: 0.02, flicker_hz: 100}");
    UNITY_BEGIN();
    RUN_TEST(undisturbed_scans_are_measured);
    RUN_TEST(scans_killed_at_any_moment_are_resumed);
    RUN_TEST(scans_that_are_asked_to_stop_leave_whole_files);
    RUN_TEST(scan_whose_disk_fills_up_is_resumed);
    finish_truth(&quiet);
    finish_truth(&noisy);
    free(plan_path);
    free(sample_path);
    folder_remove(folder);
    return UNITY_END();
}
