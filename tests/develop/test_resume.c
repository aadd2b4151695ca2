/* Developing that is killed or stopped at any moment goes on to the same scan, and what it left is believed only where it
 * is whole and of the same session. */
#include "made.h"
#include "rig/develop/develop.h"
#include "tests/files.h"
#include "unity.h"

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

void omp_set_num_threads(int count); /* of libgomp, whose header only gcc finds */

static const char plan_text[] = "seed: 5\nblack_frames: 4\nwhite_frames: 2\ndot_spacing: 8\n"
                                "dot_shift: 4\ndot_size: 2\ngrid_spacing: 7\nwindow: 7\n"
                                "exposure_turns: [1, 4, 16, 64]\n";
enum { GRIDS = 49, RESPONSE_BYTES = 3 * 7 * 7 * 4, POINTS = 20 * 16 };

static const struct develop_options usual = {.black = BLACK_SUBTRACT,
                                             .confidence = 0.99,
                                             .demosaic = DEMOSAIC_FIT,
                                             .store = NACRE_FLOAT,
                                             .flat = FLAT_PAPER,
                                             .resume = true};
static struct made_station station;
static struct nacre_error error;
static char *folder, *session_path, *scan_path, *work_path;
static uint8_t *truth; /* the scan of an undisturbed development */
static size_t truth_size;

void setUp(void)
{
    memset(&error, 0, sizeof error);
}

void tearDown(void)
{
    (void)unlink(scan_path); /* the next test begins without */
    (void)unlink(work_path);
}

static bool exists(const char *path)
{
    return access(path, F_OK) == 0;
}

/* Develop to the end; the scan must be the true one, and nothing else be left. Returns how many grids were taken over. */
static int finish(const struct develop_options *options)
{
    struct develop_report report;
    size_t size;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, develop_session(session_path, options, scan_path, NULL, &report, &error),
        error.text);
    uint8_t *bytes = file_read(scan_path, &size);
    TEST_ASSERT_NOT_NULL_MESSAGE(bytes, scan_path);
    TEST_ASSERT_EQUAL_UINT(truth_size, size);
    TEST_ASSERT_EQUAL_MEMORY(truth, bytes, size);
    TEST_ASSERT_FALSE(exists(work_path));
    TEST_ASSERT_EQUAL_INT(GRIDS, report.patterns);
    TEST_ASSERT_EQUAL_UINT(POINTS, report.responses);
    free(bytes);
    return report.taken_over;
}

/* Develop in a process that dies when a file of its would pass `bytes`: in the middle of writing. */
static void die_at(size_t bytes)
{
    pid_t child = fork();
    int status;
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        const struct rlimit none = {0, 0};
        const struct rlimit limit = {bytes, bytes};
        omp_set_num_threads(1); /* the parent's other threads are not here */
        (void)setrlimit(RLIMIT_CORE, &none);
        (void)setrlimit(RLIMIT_FSIZE, &limit);
        (void)signal(SIGXFSZ, SIG_DFL);
        _exit(develop_session(session_path, &usual, scan_path, NULL, NULL, NULL) == NACRE_OK ? 1
                                                                                             : 2);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGXFSZ);
    TEST_ASSERT_FALSE(exists(scan_path));
}

/* A work file in which about this share of the grids is done. */
static void die_after(double share)
{
    /* A header of 24 bytes and 64 a record come first, then the responses of all points. */
    die_at((size_t)(24 + GRIDS * 64 + share * POINTS * RESPONSE_BYTES));
}

static void killed_at_any_byte_it_goes_on_to_the_same_scan(void)
{
    const double shares[] = {0.01, 0.3, 0.31, 0.9, 0.999};
    for (size_t i = 0; i < sizeof shares / sizeof *shares; i++) {
        die_after(shares[i]);
        TEST_ASSERT_TRUE(exists(work_path));
    }
    int taken_over = finish(&usual);
    /* All but the grid in which it died. */
    TEST_ASSERT_TRUE(taken_over == GRIDS - 1);
}

static void killed_before_the_first_grid_it_begins_anew(void)
{
    die_at(1000); /* in the records or in what is tried at the output's place */
    TEST_ASSERT_EQUAL_INT(0, finish(&usual));
}

static void without_resume_it_begins_anew(void)
{
    struct develop_options options = usual;
    options.resume = false;
    die_after(0.5);
    TEST_ASSERT_EQUAL_INT(0, finish(&options));
}

static void note_time(int number)
{
    (void)number;
    (void)raise(SIGINT);
}

/* Develop in a process that gets Ctrl-C after so much processor time. */
static int stop_after(int milliseconds)
{
    pid_t child = fork();
    int status;
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        const struct itimerval soon = {{0, 0}, {0, milliseconds * 1000}};
        omp_set_num_threads(1);
        progress_catch_signals();
        (void)signal(SIGPROF, note_time);
        (void)setitimer(ITIMER_PROF, &soon, NULL);
        _exit(-develop_session(session_path, &usual, scan_path, NULL, NULL, NULL));
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_TRUE(WIFEXITED(status));
    return -WEXITSTATUS(status);
}

static void stopped_by_ctrl_c_it_goes_on_to_the_same_scan(void)
{
    int left = 0;
    for (int milliseconds = 10; milliseconds < 990; milliseconds += 30) {
        int status = stop_after(milliseconds);
        if (status == NACRE_OK) {
            break;
        }
        TEST_ASSERT_EQUAL_INT(NACRE_CANCELLED, status);
        TEST_ASSERT_FALSE(exists(scan_path));
        left += exists(work_path) ? 1 : 0;
    }
    TEST_ASSERT_TRUE(left > 0);
    (void)finish(&usual);
}

static void other_options_are_refused_and_lose_nothing(void)
{
    struct develop_options options = usual;
    die_after(0.5);
    options.black = BLACK_CLIP;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          develop_session(session_path, &options, scan_path, NULL, NULL, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "other options"), error.text);
    TEST_ASSERT_TRUE(finish(&usual) > 0);
}

static void damaged_responses_are_developed_again(void)
{
    die_after(0.6);
    FILE *file = fopen(work_path, "r+b");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_INT(0, fseek(file, -POINTS * RESPONSE_BYTES / 4, SEEK_END));
    TEST_ASSERT_TRUE(fputs("damage", file) >= 0);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    int taken_over = finish(&usual);
    TEST_ASSERT_TRUE(taken_over > 0.4 * GRIDS && taken_over < 0.62 * GRIDS);
}

static void frames_measured_again_are_developed_again(void)
{
    struct session session = {.path = session_path};
    char *path = session_pattern_path(&session, (struct pattern){PATTERN_GRID, 3});
    const struct timespec times[2] = {{.tv_nsec = UTIME_OMIT}, {.tv_sec = 1000000000}};
    struct stat before;
    die_after(0.999);
    TEST_ASSERT_EQUAL_INT(0, stat(path, &before));
    TEST_ASSERT_EQUAL_INT(0, utimensat(AT_FDCWD, path, times, 0));
    TEST_ASSERT_EQUAL_INT(GRIDS - 2, finish(&usual));
    free(path);
}

/* A frame file that is no frame file, until it is put back. */
static char *spoil_grid(int number, bool spoilt)
{
    struct session session = {.path = session_path};
    char *path = session_pattern_path(&session, (struct pattern){PATTERN_GRID, number});
    char *kept = NULL;
    TEST_ASSERT_TRUE(asprintf(&kept, "%s.kept", path) > 0);
    if (spoilt) {
        TEST_ASSERT_EQUAL_INT(0, rename(path, kept));
        TEST_ASSERT_EQUAL_INT(0, close(creat(path, 0666)));
    } else {
        TEST_ASSERT_EQUAL_INT(0, rename(kept, path));
    }
    free(kept);
    return path;
}

static void damaged_frame_loses_nothing_that_was_developed(void)
{
    struct develop_options options = usual;
    options.resume = false;
    char *path = spoil_grid(40, true);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          develop_session(session_path, &options, scan_path, NULL, NULL, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, path), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "--resume"), error.text);
    free(path);
    free(spoil_grid(40, false));
    TEST_ASSERT_EQUAL_INT(40, finish(&usual)); /* grids are taken in order */
}

static void full_disk_loses_nothing_that_was_developed(void)
{
    const struct rlimit limit = {24 + GRIDS * 64 + POINTS * RESPONSE_BYTES / 2, RLIM_INFINITY};
    const struct rlimit none = {RLIM_INFINITY, RLIM_INFINITY};
    void (*before)(int) = signal(SIGXFSZ, SIG_IGN); /* writing fails instead */
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &limit));
    int status = develop_session(session_path, &usual, scan_path, NULL, NULL, &error);
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &none));
    (void)signal(SIGXFSZ, before);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "cannot write the work file"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "--resume"), error.text);
    int taken_over = finish(&usual);
    TEST_ASSERT_TRUE(taken_over > 0.4 * GRIDS && taken_over < 0.52 * GRIDS);
}

static void development_done_once_leaves_nothing(void)
{
    struct develop_options options = usual;
    options.once = true;
    free(spoil_grid(40, true));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          develop_session(session_path, &options, scan_path, NULL, NULL, &error));
    TEST_ASSERT_NULL_MESSAGE(strstr(error.text, "--resume"), error.text);
    TEST_ASSERT_FALSE(exists(work_path));
    free(spoil_grid(40, false));
}

static void two_at_once_are_refused(void)
{
    die_after(0.5);
    int file = open(work_path, O_RDWR);
    TEST_ASSERT_EQUAL_INT(0, flock(file, LOCK_EX));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          develop_session(session_path, &usual, scan_path, NULL, NULL, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "another program"), error.text);
    TEST_ASSERT_EQUAL_INT(0, close(file));
    TEST_ASSERT_TRUE(finish(&usual) > 0);
}

int main(void)
{
    UNITY_BEGIN();
    folder = folder_make();
    station = made_station_usual();
    station.width = 20;
    station.height = 16;
    station.camera_width = 104;
    station.camera_height = 90;
    station.reach = 0.55;
    session_path = made_session(&station, folder, plan_text);
    if (asprintf(&scan_path, "%s/scan.exr", folder) < 0 ||
        asprintf(&work_path, "%s.work", scan_path) < 0 ||
        develop_session(session_path, &usual, scan_path, NULL, NULL, NULL) != NACRE_OK) {
        return EXIT_FAILURE;
    }
    truth = file_read(scan_path, &truth_size);
    (void)unlink(scan_path);
    RUN_TEST(killed_at_any_byte_it_goes_on_to_the_same_scan);
    RUN_TEST(killed_before_the_first_grid_it_begins_anew);
    RUN_TEST(without_resume_it_begins_anew);
    RUN_TEST(stopped_by_ctrl_c_it_goes_on_to_the_same_scan);
    RUN_TEST(other_options_are_refused_and_lose_nothing);
    RUN_TEST(damaged_responses_are_developed_again);
    RUN_TEST(frames_measured_again_are_developed_again);
    RUN_TEST(damaged_frame_loses_nothing_that_was_developed);
    RUN_TEST(full_disk_loses_nothing_that_was_developed);
    RUN_TEST(development_done_once_leaves_nothing);
    RUN_TEST(two_at_once_are_refused);
    free(truth);
    free(session_path);
    free(scan_path);
    free(work_path);
    folder_remove(folder);
    return UNITY_END();
}
