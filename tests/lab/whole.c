/* A whole scan by the program in the lab's guest, and the virtual one that it must equal. */
#include "whole.h"

#include "guest.h"
#include "tests/cmd/frames.h"
#include "tests/cmd/spawn.h"
#include "unity.h"

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { LEFT = 301, TOP = 203, LIMIT_S = 200 };

/* 50 and 200 ms: the emulated machine's pulses may be some milliseconds too long. */
static const char plan_text[] =
    "{seed: 5, black_frames: 2, white_frames: 1, dot_spacing: 4, dot_shift: 2, dot_size: 1,\n"
    " grid_spacing: 4, window: 3, exposure_turns: [1, 4]}\n";

static const char sample_text[] =
    "{width: 8, height: 8, pitch_mm: 0.5, thickness_mm: 2, margin_points: 2, base: light,\n"
    " materials: [{name: light, scattering_per_mm: [2.4, 2.3, 2.1],\n"
    "              absorption_per_mm: [0.2, 0.3, 0.6]}]}\n";

#define COMMON                                                                                     \
    "# my station\n"                                                                               \
    "sample: {width: 8, height: 8, pitch_mm: 0.5}\n"                                               \
    "white_reflectance: 0.9\n"                                                                     \
    "plan: plan.yaml\n"

static const char virtual_text[] =
    COMMON "camera: {driver: virtual, width: 48, height: 48, bits: 8, bayer: RGGB, pedestal: 8}\n"
           "projector: {driver: virtual, wheel_hz: 20}\n"
           "trigger: {driver: virtual}\n"
           "virtual:\n"
           "  sample: sample.yaml\n"
           "  projector: {contrast: 500}\n"
           "  camera: {elevation_deg: 12, pixels_per_point: 5, full_scale_s: 0.25}\n";

static const char real_text[] =
    COMMON "camera: {driver: v4l2, width: 48, height: 48, bits: 8, bayer: RGGB, pedestal: 8,\n"
           "         tolerance_ms: %d, v4l2: {device: /dev/video0, stamp_delay_ms: %d}}\n"
           "projector: {driver: egl, wheel_hz: 20,\n"
           "            egl: {device: %s, mode: 640x480, left: %d, top: %d, latency_ms: 0}}\n"
           "trigger: %s\n";

void whole_write_station(const struct whole *whole, const char *path,
                         const struct whole_station *station)
{
    char text[1024];
    int length = snprintf(text, sizeof text, real_text, station->tolerance_ms,
                          station->stamp_delay_ms, whole->screen.path, LEFT, TOP, station->trigger);
    TEST_ASSERT_TRUE(length > 0 && (size_t)length < sizeof text);
    text_write(path, text);
}

void whole_write(const struct whole *whole, const struct whole_station *station)
{
    guest_run("mkdir -p " WHOLE);
    whole_write_station(whole, WHOLE_STATION, station);
    text_write(WHOLE_VIRTUAL, virtual_text);
    text_write(WHOLE "/plan.yaml", plan_text);
    text_write(WHOLE "/sample.yaml", sample_text);
}

void whole_plug_camera(struct whole *whole, const struct gpio_sim *chip,
                       bool (*look)(struct feeder_line *))
{
    struct feeder *feeder = &whole->feeder;
    feeder_begin(feeder, WHOLE_VIRTUAL, &whole->screen, chip);
    feeder->look = look;
    feeder->left = LEFT;
    feeder->top = TOP;
    feeder->stamp_delay_ns = 10000000;
    feeder->exposures_ns[0] = 50000000;
    feeder->exposures_ns[1] = 200000000;
}

static const char virtual_session[] = WHOLE "/virtual", virtual_scan[] = WHOLE "/virtual.exr";
static const char real_scan[] = WHOLE "/real.exr";

static void nacre(const char *const *arguments)
{
    struct spawned run = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    spawned_finish(&run);
}

void whole_scan_virtual(void)
{
    nacre((const char *const[]){NACRE, "scan", virtual_session, "--station", WHOLE_VIRTUAL, NULL});
    nacre((const char *const[]){NACRE, "develop", virtual_session, "-o", virtual_scan, NULL});
    TEST_ASSERT_EQUAL_INT(WHOLE_PATTERNS, session_files_count(virtual_session).patterns);
}

void whole_expect_same_as_virtual(const char *session)
{
    size_t wanted_size = 0;
    size_t size = 0;
    frames_expect_same_patterns(virtual_session, session);
    nacre((const char *const[]){NACRE, "develop", session, "-o", real_scan, NULL});
    uint8_t *wanted = file_read(virtual_scan, &wanted_size);
    uint8_t *bytes = file_read(real_scan, &size);
    TEST_ASSERT_TRUE(size > 0 && size == wanted_size && memcmp(bytes, wanted, size) == 0);
    free(wanted);
    free(bytes);
}

static const char output_path[] = WHOLE "/output", errors_path[] = WHOLE "/errors";

static pid_t start(const char *const *arguments)
{
    (void)unlink(errors_path); /* of the run before, whose questions are not asked again */
    (void)fflush(stdout);
    pid_t child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        (void)dup2(open("/dev/null", O_RDONLY | O_CLOEXEC), STDIN_FILENO);
        (void)dup2(open(output_path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600),
                   STDOUT_FILENO);
        (void)dup2(open(errors_path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600),
                   STDERR_FILENO);
        (void)execv(arguments[0], (char *const *)arguments);
        _exit(99);
    }
    return child;
}

/* Do what the program asks for, once for each time it asks. */
static void answer(struct whole *whole, struct whole_outcome *outcome)
{
    size_t size = 0;
    char *text = (char *)file_read(errors_path, &size);
    char *last = NULL;
    int asked = 0;
    for (char *found = text; found && (found = strstr(found, "white diffuse layer")); found++) {
        last = found;
        asked++;
    }
    if (asked > outcome->asked && strchr(last, '\n')) {
        outcome->asked = asked;
        if (asked != whole->forgets) {
            feeder_lay_white(&whole->feeder,
                             last - text >= 8 && strncmp(last - 8, "Lay the ", 8) == 0);
        }
        TEST_ASSERT_EQUAL_INT(0, kill(whole->child, SIGUSR1));
    }
    free(text);
}

static double now_s(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

struct whole_outcome whole_run(struct whole *whole, const char *const *arguments,
                               struct whole_event event)
{
    struct whole_outcome outcome = {.status = -1};
    size_t size = 0;
    int status = 0;
    int before = whole->feeder.pulses;
    double began_s = now_s();
    whole->child = start(arguments);
    while (waitpid(whole->child, &status, WNOHANG) == 0) {
        feeder_step(&whole->feeder);
        if (event.happen && whole->feeder.pulses - before >= event.pulse && event.happen()) {
            event.happen = NULL;
        }
        answer(whole, &outcome);
        if (now_s() - began_s > LIMIT_S) {
            (void)kill(whole->child, SIGKILL);
        }
        (void)usleep(1000);
    }
    whole->child = 0;
    outcome.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    outcome.output = (char *)file_read(output_path, &size);
    outcome.errors = (char *)file_read(errors_path, &size);
    outcome.pulses = whole->feeder.pulses - before;
    outcome.seconds = now_s() - began_s;
    TEST_ASSERT_EQUAL_UINT_MESSAGE(0, whole->feeder.missed, outcome.errors);
    return outcome;
}

void whole_outcome_finish(struct whole_outcome *outcome)
{
    free(outcome->output);
    free(outcome->errors);
}

struct whole_outcome whole_scan(struct whole *whole, const char *session, const char *retries,
                                struct whole_event event)
{
    const char *const arguments[] = {
        NACRE,       "scan",        session,
        "--station", WHOLE_STATION, "--json",
        "--retries", retries,       access(session, F_OK) == 0 ? "--resume" : NULL,
        NULL};
    return whole_run(whole, arguments, event);
}

void whole_end(struct whole *whole)
{
    if (whole->child > 0) {
        (void)kill(whole->child, SIGKILL);
        (void)waitpid(whole->child, NULL, 0);
        whole->child = 0;
    }
}
