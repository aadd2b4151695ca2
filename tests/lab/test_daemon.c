/* nacred as it is installed: under systemd with its unit, its policy on the system bus and its users, on devices of the
 * kernel's drivers. */
#include "gpio_sim.h"
#include "guest.h"
#include "rig/daemon/names.h"
#include "screen.h"
#include "unity.h"
#include "vivid.h"

#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <systemd/sd-bus.h>
#include <time.h>
#include <unistd.h>

/* Everything is slow in the guest; a scan takes some 20 s. */
enum { PATIENCE_S = 100 };

static const char *const names[] = {"shutter", NULL};
static sd_bus *bus;
static char printed[8192];

/* 128 units of 100 us are one turn; in the guest a pulse may be late by most of a second. */
static const char station[] =
    "sample: {width: 6, height: 5, pitch_mm: 0.5}\n"
    "camera: {driver: v4l2, width: 320, height: 180, bits: 8, bayer: BGGR, v4l2: {device: "
    "/dev/nacre/camera, mode: free, settle_frames: 1}}\n"
    "projector: {driver: egl, wheel_hz: 78.125, egl: {device: /dev/nacre/display, mode: "
    "1024x768}}\n"
    "trigger: {driver: gpio, gpio: {output: {line: shutter}, jitter_us: 900000}}\n"
    "plan: plan.yaml\n";
static const char plan[] =
    "{seed: 3, black_frames: 10, white_frames: 2, dot_spacing: 2, dot_shift: 2, dot_size: 1, "
    "grid_spacing: 2, window: 1, exposure_turns: [0.5, 1]}\n";

/* Before the first test: users, devices, files. */
static void prepare(void)
{
    guest_run("systemd-sysusers && useradd -M -G nacre olga");
    guest_run("systemctl daemon-reload && systemctl try-reload-or-restart dbus && systemctl "
              "restart systemd-udevd");
    struct vivid webcam = vivid_plug("vivid-exposure", "");
    vivid_set(&webcam, "Timestamp Source", 1);
    (void)gpio_sim_plug("lines", 2, names);
    (void)screen_plug("vkms", "vkms");
    guest_run("mkdir -p /etc/nacre /run/systemd/system/nacred.service.d");
    guest_write("/etc/nacre/station.yaml", station);
    guest_write("/etc/nacre/plan.yaml", plan);
    /* The unit's half a minute is shortened, to test it in less. */
    guest_write("/run/systemd/system/nacred.service.d/lab.conf",
                "[Service]\nWatchdogSec=4s\nTimeoutAbortSec=3s\n");
    guest_run("systemctl daemon-reload");
    guest_run("udevadm settle --timeout=20");
    TEST_ASSERT_TRUE(sd_bus_open_system(&bus) >= 0);
    const char *name = NULL; /* the bus hangs up on who does not introduce himself within seconds */
    TEST_ASSERT_TRUE(sd_bus_get_unique_name(bus, &name) >= 0);
}

void setUp(void)
{
    if (!bus) {
        prepare();
    }
}

void tearDown(void)
{
}

/* A line of shell as some user; its exit status. What it prints is kept. */
static int run_as(const char *user, const char *line)
{
    char whole[512];
    (void)snprintf(whole, sizeof whole, "runuser -u %s -- /bin/sh -c '%s' 2>&1", user, line);
    FILE *pipe = popen(whole, "re"); /* NOLINT(cert-env33-c): a shell is what is wanted */
    TEST_ASSERT_NOT_NULL(pipe);
    size_t size = fread(printed, 1, sizeof printed - 1, pipe);
    printed[size] = '\0';
    int status = pclose(pipe);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128;
}

static void expect(int status, const char *user, const char *line, const char *words)
{
    int got = run_as(user, line);
    TEST_ASSERT_EQUAL_INT_MESSAGE(status, got, printed);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(printed, words), printed);
}

/* A property of nacred's, in a static buffer; "" when it does not answer. */
static const char *text_of(const char *property)
{
    static char text[2048];
    char *value = NULL;
    int result = sd_bus_get_property_string(bus, STATION_SERVICE, STATION_OBJECT, STATION_INTERFACE,
                                            property, NULL, &value);
    (void)snprintf(text, sizeof text, "%s", result >= 0 ? value : "");
    free(value);
    return text;
}

static unsigned patterns_done(void)
{
    uint32_t number = 0;
    (void)sd_bus_get_property_trivial(bus, STATION_SERVICE, STATION_OBJECT, STATION_INTERFACE,
                                      "Pattern", NULL, 'u', &number); /* may be restarting */
    return number;
}

/* Whether the state becomes so within the time. vivid's picture does not show the white layer, so we insist. */
static bool reaches(const char *state, bool help)
{
    time_t end = time(NULL) + PATIENCE_S;
    bool reached = strcmp(text_of("State"), state) == 0; /* it may be another a moment later */
    while (!reached && time(NULL) < end) {
        if (help && strcmp(text_of("State"), "waiting") == 0) {
            (void)sd_bus_call_method(bus, STATION_SERVICE, STATION_OBJECT, STATION_INTERFACE,
                                     "Insist", NULL, NULL, ""); /* it may have been done */
        }
        (void)usleep(100000);
        reached = strcmp(text_of("State"), state) == 0;
    }
    return reached;
}

static void help_until(const char *state)
{
    TEST_ASSERT_TRUE_MESSAGE(reaches(state, true), text_of("Message"));
}

/* Measure until some patterns are done for which nobody is asked any more. */
static void measure_some(const char *name)
{
    char line[128];
    time_t end = time(NULL) + PATIENCE_S;
    (void)snprintf(line, sizeof line, "/usr/local/bin/nacre start %s --detach", name);
    expect(0, "olga", line, "");
    help_until("running");
    while (patterns_done() < 5 && time(NULL) < end) {
        (void)usleep(50000);
        help_until("running");
    }
    TEST_ASSERT_EQUAL_STRING("running", text_of("State"));
}

/* A property of the unit. */
static long unit_number(const char *property)
{
    char line[128];
    (void)snprintf(line, sizeof line, "systemctl show nacred -P %s", property);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run_as("root", line), printed);
    return strtol(printed, NULL, 10);
}

/* After nacred was killed systemd starts it again, which finds the session; it is measured to its end. */
static void expect_recovery(long restarts, const char *name)
{
    char line[128];
    time_t end = time(NULL) + PATIENCE_S;
    while (unit_number("NRestarts") == restarts && time(NULL) < end) {
        (void)usleep(500000);
        while (waitpid(-1, NULL, __WALL | WNOHANG) > 0) { /* threads that hang_job has stopped */
        }
    }
    TEST_ASSERT_EQUAL_INT(restarts + 1, unit_number("NRestarts"));
    TEST_ASSERT_TRUE(reaches("interrupted", false));
    (void)snprintf(line, sizeof line, "/usr/local/bin/nacre resume %s --detach", name);
    expect(0, "olga", line, "");
    help_until("done");
    (void)snprintf(line, sizeof line, "%s is complete: 17 patterns", name);
    TEST_ASSERT_EQUAL_STRING(line, text_of("Message"));
}

static void service_starts_in_its_sandbox(void)
{
    expect(0, "root", "systemctl start nacred; systemctl status --no-pager nacred",
           "Status: \"ready\"");
    expect(0, "root", "systemctl show nacred -P User", "nacre\n");
}

static void sandbox_is_tight(void)
{
    expect(0, "root", "systemd-analyze security --no-pager nacred | tail -1",
           "Overall exposure level");
    const char *level = strstr(printed, "nacred.service: ");
    TEST_ASSERT_NOT_NULL_MESSAGE(level, printed);
    double exposure = strtod(level + strlen("nacred.service: "), NULL);
    TEST_ASSERT_TRUE_MESSAGE(exposure > 0 && exposure <= 2.0, level);
}

static void everybody_may_look_and_only_the_group_may_act(void)
{
    expect(0, "nobody", "/usr/local/bin/nacre status", "state        idle");
    expect(1, "nobody", "/usr/local/bin/nacre start stone",
           "only members of the group nacre may tell nacred what to do");
    expect(1, "nobody", "/usr/local/bin/nacre cancel", "only members of the group nacre");
    expect(1, "olga", "/usr/local/bin/nacre cancel", "no scan is running");
    expect(1, "nobody",
           "busctl call org.nacre.Station1 /org/nacre/Station1 org.nacre.Station1 Pause", "denied");
    TEST_ASSERT_EQUAL_STRING("idle", text_of("State"));
}

static void scan_runs_to_its_end_on_real_drivers(void)
{
    expect(0, "olga", "/usr/local/bin/nacre start stone --detach", "");
    help_until("done");
    TEST_ASSERT_EQUAL_INT(17, patterns_done());
    expect(0, "root", "stat -c \"%a %U %G\" /var/lib/nacre/sessions/stone", "750 nacre nacre\n");
    expect(0, "olga", "ls /var/lib/nacre/sessions/stone/frames", "000003.exr");
    TEST_ASSERT_FALSE(run_as("nobody", "ls /var/lib/nacre/sessions") == 0);
    expect(0, "root", "journalctl --no-pager -o cat -u nacred NACRE_SESSION=stone",
           "stone is complete: 17 patterns");
}

static void killed_daemon_is_started_again_and_resumes(void)
{
    measure_some("killed");
    long restarts = unit_number("NRestarts");
    expect(0, "root", "systemctl kill -s KILL nacred", "");
    expect_recovery(restarts, "killed");
}

static void stopped_daemon_is_killed_by_the_watchdog(void)
{
    measure_some("stopped");
    long restarts = unit_number("NRestarts");
    expect(0, "root", "systemctl kill -s STOP nacred", "");
    expect_recovery(restarts, "stopped");
    expect(0, "root", "journalctl --no-pager -o cat -u nacred", "Watchdog timeout");
}

/* Stop every thread but the first, as a debugger does: the job hangs, and the loop goes on. */
static void hang_job(pid_t process)
{
    char path[64];
    int held = 0;
    (void)snprintf(path, sizeof path, "/proc/%d/task", (int)process);
    DIR *threads = opendir(path);
    TEST_ASSERT_NOT_NULL(threads);
    for (struct dirent *entry = readdir(threads); entry; entry = readdir(threads)) {
        pid_t thread = (pid_t)strtol(entry->d_name, NULL, 10);
        if (thread > 0 && thread != process) {
            TEST_ASSERT_EQUAL_INT(0, ptrace(PTRACE_SEIZE, thread, NULL, NULL));
            TEST_ASSERT_EQUAL_INT(0, ptrace(PTRACE_INTERRUPT, thread, NULL, NULL));
            held++;
        }
    }
    (void)closedir(threads);
    TEST_ASSERT_TRUE(held > 0);
}

static void hanging_scan_is_killed_by_the_watchdog(void)
{
    measure_some("hanging");
    long restarts = unit_number("NRestarts");
    hang_job((pid_t)unit_number("MainPID"));
    (void)sleep(3);
    TEST_ASSERT_EQUAL_STRING("running", text_of("State")); /* the loop answers */
    TEST_ASSERT_EQUAL_INT(restarts, unit_number("NRestarts"));
    expect_recovery(restarts, "hanging");
}

static void service_that_is_stopped_leaves_a_session_to_resume(void)
{
    measure_some("ended");
    expect(0, "root", "systemctl stop nacred; systemctl show nacred -P Result", "success");
    /* Asking for the state starts it again, by the bus. */
    expect(0, "nobody", "/usr/local/bin/nacre status", "state        interrupted");
    expect(0, "olga", "/usr/local/bin/nacre resume ended --detach", "");
    help_until("done");
}

static void unplugged_camera_is_named(void)
{
    guest_run("mv /dev/nacre/camera /dev/nacre/away");
    expect(1, "olga", "/usr/local/bin/nacre start blind --detach", "camera /dev/nacre/camera");
    TEST_ASSERT_EQUAL_STRING("failed", text_of("State"));
    guest_run("mv /dev/nacre/away /dev/nacre/camera");
}

int main(void)
{
    guest_require();
    (void)setvbuf(stdout, NULL, _IOLBF,
                  0); /* what a guest that runs out of time had done is seen */
    UNITY_BEGIN();
    RUN_TEST(service_starts_in_its_sandbox);
    RUN_TEST(sandbox_is_tight);
    RUN_TEST(everybody_may_look_and_only_the_group_may_act);
    RUN_TEST(scan_runs_to_its_end_on_real_drivers);
    RUN_TEST(killed_daemon_is_started_again_and_resumes);
    RUN_TEST(stopped_daemon_is_killed_by_the_watchdog);
    RUN_TEST(hanging_scan_is_killed_by_the_watchdog);
    RUN_TEST(service_that_is_stopped_leaves_a_session_to_resume);
    RUN_TEST(unplugged_camera_is_named);
    sd_bus_flush_close_unref(bus);
    return UNITY_END();
}
