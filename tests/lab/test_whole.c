/* A whole scan by `nacre scan` with V4L2 camera, EGL projector and GPIO trigger together, in which the camera sees the
 * screen: the same frames and responses as of a virtual station, whatever goes wrong on the way. */
#include "feeder.h"
#include "gpio_sim.h"
#include "guest.h"
#include "screen.h"
#include "tests/cmd/frames.h"
#include "tests/cmd/spawn.h"
#include "tests/cmd/told.h"
#include "unity.h"

#include <fcntl.h>
#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { LEFT = 301, TOP = 203, LIMIT_S = 200 };
/* 1 white, 4 dots, 2 black, 16 grids. */
enum { PATTERNS = 23, EXPOSURES = 2 * PATTERNS };

static const char folder[] = "/run/whole";
static const char *const names[] = {"shutter", NULL};
static struct screen screen;
static struct gpio_sim chip;
static struct feeder feeder;
static pid_t child; /* that scans; 0: none does */
static int
    forgets; /* the question after which the person says that it is done, and it is not; 0: none */

/* 50 and 200 ms: the emulated machine's pulses may be some milliseconds too long. */
static const char plan_text[] =
    "{seed: 5, black_frames: 2, white_frames: 1, dot_spacing: 4, dot_shift: 2, dot_size: 1,\n"
    " grid_spacing: 4, window: 3, exposure_turns: [1, 4]}\n";

static const char sample_text[] =
    "{width: 8, height: 8, pitch_mm: 0.5, thickness_mm: 2, margin_points: 2, base: light,\n"
    " materials: [{name: light, scattering_per_mm: [2.4, 2.3, 2.1],\n"
    "              absorption_per_mm: [0.2, 0.3, 0.6]}]}\n";

static const char common_text[] = "sample: {width: 8, height: 8, pitch_mm: 0.5}\n"
                                  "white_reflectance: 0.9\n"
                                  "plan: plan.yaml\n";

static const char virtual_text[] =
    "camera: {driver: virtual, width: 48, height: 48, bits: 8, bayer: RGGB, pedestal: 8}\n"
    "projector: {driver: virtual, wheel_hz: 20}\n"
    "trigger: {driver: virtual}\n"
    "virtual:\n"
    "  sample: sample.yaml\n"
    "  projector: {contrast: 500}\n"
    "  camera: {elevation_deg: 12, pixels_per_point: 5, full_scale_s: 0.25}\n";

static const char real_text[] =
    "camera: {driver: v4l2, width: 48, height: 48, bits: 8, bayer: RGGB, pedestal: 8, "
    "tolerance_ms: 20,\n"
    "         v4l2: {device: /dev/video0, stamp_delay_ms: 10}}\n"
    "projector: {driver: egl, wheel_hz: 20,\n"
    "            egl: {device: %s, mode: 640x480, left: %d, top: %d, latency_ms: 0}}\n"
    "trigger: {driver: gpio, gpio: {output: {line: shutter}, jitter_us: 900000}}\n";

/* What happened in one run of `nacre scan`. */
struct outcome {
    int status;
    char *output, *errors;
    int asked; /* how often the person was asked for the layer */
    double seconds;
};

/* What happens when so many pulses of the run have come; NULL: nothing. */
struct event {
    int pulse;
    void (*happen)(void);
};

void setUp(void)
{
}

void tearDown(void)
{
    if (child > 0) {
        (void)kill(child, SIGKILL);
        (void)waitpid(child, NULL, 0);
        child = 0;
    }
}

static double now_s(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

static char *path_of(const char *name)
{
    return path_join(folder, name);
}

static void write_settings(void)
{
    char text[1024];
    char own[512];
    (void)snprintf(own, sizeof own, real_text, screen.path, LEFT, TOP);
    char *station = path_of("station.yaml");
    char *simulated = path_of("virtual.yaml");
    char *plan = path_of("plan.yaml");
    char *sample = path_of("sample.yaml");
    (void)snprintf(text, sizeof text, "%s%s", common_text, own);
    text_write(station, text);
    (void)snprintf(text, sizeof text, "%s%s", common_text, virtual_text);
    text_write(simulated, text);
    text_write(plan, plan_text);
    text_write(sample, sample_text);
    free(station);
    free(simulated);
    free(plan);
    free(sample);
}

static void plug_camera(void)
{
    char *station = path_of("virtual.yaml");
    feeder_begin(&feeder, station, &screen, &chip);
    feeder.left = LEFT;
    feeder.top = TOP;
    feeder.stamp_delay_ns = 10000000;
    feeder.exposures_ns[0] = 50000000;
    feeder.exposures_ns[1] = 200000000;
    free(station);
}

static void plug_trigger(void)
{
    chip = gpio_sim_plug("lines", 2, names);
}

static void nacre(const char *const *arguments)
{
    struct spawned run = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    spawned_finish(&run);
}

/* The same plan on the same sample without any device. */
static void virtual_scan_is_measured(void)
{
    char *station = path_of("virtual.yaml");
    char *session = path_of("virtual");
    char *scan = path_of("virtual.exr");
    nacre((const char *const[]){NACRE, "scan", session, "--station", station, NULL});
    nacre((const char *const[]){NACRE, "develop", session, "-o", scan, NULL});
    TEST_ASSERT_EQUAL_INT(PATTERNS, session_files_count(session).patterns);
    free(station);
    free(session);
    free(scan);
}

/* Start the program; what it says goes into these files. */
static void start(const char *const *arguments, const char *output, const char *errors)
{
    (void)unlink(errors); /* of the run before, whose questions are not asked again */
    (void)fflush(stdout);
    child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        (void)dup2(open("/dev/null", O_RDONLY | O_CLOEXEC), STDIN_FILENO);
        (void)dup2(open(output, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600), STDOUT_FILENO);
        (void)dup2(open(errors, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600), STDERR_FILENO);
        (void)execv(NACRE, (char *const *)arguments);
        _exit(99);
    }
}

/* Do what the program asks for, once for each time it asks. */
static void answer(const char *errors, struct outcome *outcome)
{
    size_t size = 0;
    char *text = (char *)file_read(errors, &size);
    char *last = NULL;
    int asked = 0;
    for (char *found = text; found && (found = strstr(found, "white diffuse layer")); found++) {
        last = found;
        asked++;
    }
    if (asked > outcome->asked && strchr(last, '\n')) {
        outcome->asked = asked;
        if (asked != forgets) {
            feeder_lay_white(&feeder, last - text >= 8 && strncmp(last - 8, "Lay the ", 8) == 0);
        }
        TEST_ASSERT_EQUAL_INT(0, kill(child, SIGUSR1));
    }
    free(text);
}

/* Scan, being the sample, the camera and the person. */
static struct outcome scan(const char *session, const char *retries, struct event event)
{
    char *output = path_of("output");
    char *errors = path_of("errors");
    struct outcome outcome = {.status = -1};
    size_t size = 0;
    int status = 0;
    int before = feeder.pulses;
    double began_s = now_s();
    char *station = path_of("station.yaml");
    const char *const arguments[] = {
        NACRE,       "scan",  session,
        "--station", station, "--json",
        "--retries", retries, access(session, F_OK) == 0 ? "--resume" : NULL,
        NULL};
    start(arguments, output, errors);
    while (waitpid(child, &status, WNOHANG) == 0) {
        feeder_step(&feeder);
        if (event.happen && feeder.pulses - before >= event.pulse) {
            event.happen();
            event.happen = NULL;
        }
        answer(errors, &outcome);
        if (now_s() - began_s > LIMIT_S) {
            (void)kill(child, SIGKILL);
        }
        (void)usleep(1000);
    }
    child = 0;
    outcome.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    outcome.output = (char *)file_read(output, &size);
    outcome.errors = (char *)file_read(errors, &size);
    outcome.seconds = now_s() - began_s;
    TEST_ASSERT_EQUAL_UINT_MESSAGE(0, feeder.missed, outcome.errors);
    free(output);
    free(errors);
    free(station);
    return outcome;
}

static void outcome_finish(struct outcome *outcome)
{
    free(outcome->output);
    free(outcome->errors);
}

/* The session's frames are those of the virtual scan bit for bit, and so is what is developed from them. */
static void expect_same_as_virtual(const char *session)
{
    char *expected = path_of("virtual");
    char *wanted_scan = path_of("virtual.exr");
    char *scan_path = path_of("real.exr");
    size_t wanted_size = 0;
    size_t size = 0;
    frames_expect_same_patterns(expected, session);
    nacre((const char *const[]){NACRE, "develop", session, "-o", scan_path, NULL});
    uint8_t *wanted = file_read(wanted_scan, &wanted_size);
    uint8_t *bytes = file_read(scan_path, &size);
    TEST_ASSERT_TRUE(size > 0 && size == wanted_size && memcmp(bytes, wanted, size) == 0);
    free(wanted);
    free(bytes);
    free(expected);
    free(wanted_scan);
    free(scan_path);
}

/* Frames were taken again by these causes, and at most two that were late in earnest, as the guest's clock is the host's
 * while it waits. */
static void expect_retakes(const struct outcome *outcome, int late, int early, int lost, int gap)
{
    int slow = told_count(outcome->output, "retaken.late") - late;
    TEST_ASSERT_TRUE_MESSAGE(slow >= 0 && slow <= 2, outcome->output);
    TEST_ASSERT_EQUAL_INT(early, told_count(outcome->output, "retaken.early"));
    TEST_ASSERT_EQUAL_INT(lost, told_count(outcome->output, "retaken.lost"));
    TEST_ASSERT_EQUAL_INT(gap, told_count(outcome->output, "retaken.gap"));
    TEST_ASSERT_EQUAL_INT_MESSAGE(late + early + lost + gap + slow,
                                  told_count(outcome->output, "retries"), outcome->output);
}

static void camera_sees_what_the_projector_shows(void)
{
    char *session = path_of("sound");
    struct outcome outcome = scan(session, "3", (struct event){0, NULL});
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, outcome.status, outcome.errors);
    expect_retakes(&outcome, 0, 0, 0, 0);
    TEST_ASSERT_EQUAL_INT(EXPOSURES, told_count(outcome.output, "frames"));
    TEST_ASSERT_EQUAL_INT(2, outcome.asked);
    expect_same_as_virtual(session);
    printf("whole scan: %d patterns, %d pulses, %.1f s of the guest\n", PATTERNS, feeder.pulses,
           outcome.seconds);
    outcome_finish(&outcome);
    free(session);
}

/* And the person forgets to take the layer off. */
static void frames_that_go_wrong_are_taken_again(void)
{
    static const struct feeder_injection injections[] = {
        {6, FEEDER_LATE},      {13, FEEDER_DAMAGED}, {17, FEEDER_PREVIOUS}, {22, FEEDER_LOST},
        {27, FEEDER_REPEATED}, {33, FEEDER_SKIPPED}, {38, FEEDER_TORN},     {42, FEEDER_PREVIOUS},
        {43, FEEDER_LATE},     {0, FEEDER_SOUND}};
    char *session = path_of("faulty");
    feeder.pulses = 0;
    feeder.injected = 0;
    feeder.injections = injections;
    forgets = 2;
    struct outcome outcome = scan(session, "3", (struct event){0, NULL});
    feeder.injections = NULL;
    forgets = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, outcome.status, outcome.errors);
    TEST_ASSERT_EQUAL_INT(9, feeder.injected);
    TEST_ASSERT_EQUAL_INT_MESSAGE(3, outcome.asked, outcome.errors);
    expect_retakes(&outcome, 2, 2, 3, 2);
    TEST_ASSERT_EQUAL_INT(EXPOSURES, told_count(outcome.output, "frames"));
    expect_same_as_virtual(session);
    printf("9 faults injected and their frames taken again, a forgotten layer asked for again, "
           "%.1f s of the "
           "guest\n",
           outcome.seconds);
    outcome_finish(&outcome);
    free(session);
}

static double delay_of(const json_t *root, const char *which)
{
    const json_t *figure = json_object_get(json_object_get(root, "delays"), which);
    const json_t *median = json_object_get(figure, "median_ms");
    TEST_ASSERT_TRUE_MESSAGE(json_is_number(median), which);
    return json_number_value(median);
}

/* The camera's stamps come 10 ms late, which the file denies; pulses in the emulated machine are some milliseconds off.
 * The screen changes within an exposure of its flip. Whether delays are as they should be is not asked here. */
static void doctor_measures_delays_and_stores_them(void)
{
    char *station = path_of("ill.yaml");
    char *output = path_of("output");
    char *errors = path_of("errors");
    char text[1024];
    char own[512];
    size_t size = 0;
    int status = 0;
    (void)snprintf(own, sizeof own, real_text, screen.path, LEFT, TOP);
    char *delay = strstr(own, "stamp_delay_ms: 10");
    TEST_ASSERT_NOT_NULL(delay);
    memcpy(delay, "stamp_delay_ms: 00", 18);
    (void)snprintf(text, sizeof text, "# my station\n%s%s", common_text, own);
    text_write(station, text);
    const char *const arguments[] = {NACRE,     "doctor", "--station", station, "--store",
                                     "--flips", "10",     "--json",    NULL};
    feeder_lay_white(&feeder, true);
    feeder.exposures_ns[1] = 100000000;
    double began_s = now_s();
    start(arguments, output, errors);
    while (waitpid(child, &status, WNOHANG) == 0) {
        feeder_step(&feeder);
        if (now_s() - began_s > LIMIT_S) {
            (void)kill(child, SIGKILL);
        }
        (void)usleep(1000);
    }
    child = 0;
    feeder_lay_white(&feeder, false);
    feeder.exposures_ns[1] = 200000000;
    char *said = (char *)file_read(output, &size);
    char *complained = (char *)file_read(errors, &size);
    json_t *root = json_loads(said, 0, NULL);
    TEST_ASSERT_NOT_NULL_MESSAGE(root, complained);
    double stamps_ms = delay_of(root, "stamps");
    double latency_ms = delay_of(root, "latency");
    char *stored = (char *)file_read(station, &size);
    printf("doctor: stamps %.2f ms late, light %.2f ms after a flip, %.1f s of the guest\n",
           stamps_ms, latency_ms, now_s() - began_s);
    TEST_ASSERT_DOUBLE_WITHIN(8, 10, stamps_ms);
    TEST_ASSERT_TRUE(latency_ms >= 0 && latency_ms <= 100);
    TEST_ASSERT_NOT_NULL(strstr(stored, "# my station"));
    const char *kept = strstr(stored, "stamp_delay_ms: ");
    TEST_ASSERT_NOT_NULL_MESSAGE(kept, stored);
    TEST_ASSERT_DOUBLE_WITHIN(0.001, stamps_ms, strtod(kept + strlen("stamp_delay_ms: "), NULL));
    json_decref(root);
    free(said);
    free(complained);
    free(stored);
    free(station);
    free(output);
    free(errors);
}

static void unplug_camera(void)
{
    feeder_unplug(&feeder);
}

static void unplug_trigger(void)
{
    gpio_sim_unplug(&chip);
}

static void unplug_projector(void)
{
    guest_write(screen.status, "off");
}

/* The scan stops with a message about the device, and keeps what it has. */
static int expect_stop(const char *session, struct event event, const char *message)
{
    int before = session_files_count(session).patterns;
    struct outcome outcome = scan(session, "1", event);
    int kept = session_files_count(session).patterns;
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, outcome.status, outcome.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(outcome.errors, message), outcome.errors);
    TEST_ASSERT_TRUE(kept > before && kept < PATTERNS);
    TEST_ASSERT_EQUAL_INT(0, session_files_count(session).unfinished);
    const char *said = strstr(outcome.errors, "nacre scan: ");
    printf("unplugged: %.1f s, %d patterns kept: %s", outcome.seconds, kept,
           said ? said : outcome.errors);
    outcome_finish(&outcome);
    return kept;
}

static void scan_whose_devices_are_unplugged_is_resumed(void)
{
    char *session = path_of("unplugged");
    (void)expect_stop(session, (struct event){9, unplug_camera}, "camera /dev/video0");
    feeder_finish(&feeder);
    plug_camera();
    (void)expect_stop(session, (struct event){9, unplug_trigger}, "GPIO");
    plug_trigger();
    int kept = expect_stop(session, (struct event){9, unplug_projector}, "projector Virtual-1");
    guest_write(screen.status, "on");
    struct outcome outcome = scan(session, "3", (struct event){0, NULL});
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, outcome.status, outcome.errors);
    TEST_ASSERT_EQUAL_INT(kept, told_count(outcome.output, "measured_before"));
    TEST_ASSERT_EQUAL_INT(PATTERNS - kept, told_count(outcome.output, "patterns"));
    expect_same_as_virtual(session);
    outcome_finish(&outcome);
    free(session);
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    guest_run("mkdir -p %s", folder);
    guest_run("modprobe -r vkms v4l2loopback");
    screen = screen_plug("vkms", "vkms");
    plug_trigger();
    write_settings();
    RUN_TEST(virtual_scan_is_measured);
    plug_camera();
    RUN_TEST(camera_sees_what_the_projector_shows);
    RUN_TEST(doctor_measures_delays_and_stores_them);
    RUN_TEST(frames_that_go_wrong_are_taken_again);
    RUN_TEST(scan_whose_devices_are_unplugged_is_resumed);
    return UNITY_END();
}
