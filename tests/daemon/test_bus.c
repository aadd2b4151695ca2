/* Tests of nacred and its verbs on a bus of their own: to be run by dbus-run-session. The real nacred has real devices,
 * which are not here; what needs some runs on a nacred with a virtual station. */
#include "rig/daemon/names.h"
#include "rig/session.h"
#include "service.h"
#include "stage.h"
#include "tests/cmd/spawn.h"
#include "unity.h"

#include <jansson.h>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <systemd/sd-bus.h>
#include <time.h>
#include <unistd.h>

static const char *nacre, *nacred, *nacred_virtual;
static struct stage stage;
static struct service service;
static struct spawned run;

void setUp(void)
{
    stage_make(&stage, NULL, NULL);
}

void tearDown(void)
{
    (void)service_end(&service, SIGKILL);
    spawned_finish(&run);
    stage_remove(&stage);
}

/* nacre VERB --user ARGUMENT..., to its end; the list ends with NULL. */
static void ask(const char *verb, ...)
{
    const char *arguments[12] = {nacre, verb, "--user"};
    va_list rest;
    va_start(rest, verb);
    for (size_t i = 3; i < 11; i++) {
        /* NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): it is initialized */
        arguments[i] = va_arg(rest, const char *);
        if (!arguments[i]) {
            break;
        }
    }
    va_end(rest);
    spawned_finish(&run);
    run = spawn(arguments, NULL);
}

static void expect_success(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
}

static void expect_refusal(const char *words)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, run.status, run.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.errors, words), run.errors);
}

/* A member of the status: a text, in a static buffer. */
static const char *state_of(const char *member)
{
    static char text[1600];
    ask("status", "--json", NULL);
    expect_success();
    json_t *root = json_loads(run.output, 0, NULL);
    json_t *value = json_object_get(root, member);
    if (json_is_integer(value)) {
        (void)snprintf(text, sizeof text, "%" JSON_INTEGER_FORMAT, json_integer_value(value));
    } else {
        TEST_ASSERT_TRUE_MESSAGE(json_is_string(value), member);
        (void)snprintf(text, sizeof text, "%s", json_string_value(value));
    }
    json_decref(root);
    return text;
}

/* The state, asked without a program: what is waited for may last a moment only. */
static const char *state_now(void)
{
    static char text[32];
    char *state = NULL;
    sd_bus *bus = NULL;
    TEST_ASSERT_TRUE(sd_bus_open_user(&bus) >= 0);
    int result = sd_bus_get_property_string(bus, STATION_SERVICE, STATION_OBJECT, STATION_INTERFACE,
                                            "State", NULL, &state);
    (void)snprintf(text, sizeof text, "%s", result >= 0 ? state : "none");
    free(state);
    sd_bus_flush_close_unref(bus);
    return text;
}

static time_t deadline(void)
{
    return time(NULL) + 60; /* nothing takes so long */
}

static void wait_for_state(const char *state)
{
    time_t end = deadline();
    while (strcmp(state_now(), state) != 0 && time(NULL) < end) {
        (void)usleep(10000);
    }
    TEST_ASSERT_EQUAL_STRING(state, state_now());
}

static void begin_virtual(const char *slow_ms, const char *hang_at, long watchdog_us)
{
    const char *arguments[] = {nacred_virtual, stage.station, stage.folder, slow_ms, hang_at, NULL};
    TEST_ASSERT_TRUE(service_start(&service, arguments, watchdog_us));
}

static void begin_real(void)
{
    const char *arguments[] = {nacred,    "--user",     "--station", stage.station,
                               "--state", stage.folder, NULL};
    TEST_ASSERT_TRUE(service_start(&service, arguments, 0));
}

/* Confirm whatever is asked until no scan is running. */
static void help_to_the_end(void)
{
    time_t end = deadline();
    while (time(NULL) < end) {
        const char *state = state_now();
        if (strcmp(state, "waiting") == 0) {
            ask("confirm", NULL); /* it may have been done */
        } else if (strcmp(state, "running") != 0 && strcmp(state, "preparing") != 0 &&
                   strcmp(state, "paused") != 0) { /* which it is for a moment after resume */
            return;
        }
        (void)usleep(10000);
    }
    TEST_FAIL_MESSAGE(state_now());
}

static void check_complete(const char *name)
{
    char path[160];
    struct session session;
    struct nacre_error error;
    struct sequence_needs needs;
    (void)snprintf(path, sizeof path, "%s/sessions/%s", stage.folder, name);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_open(path, &session, &error), error.text);
    TEST_ASSERT_EQUAL_INT(
        NACRE_OK, sequence_estimate(&session.station, &session.plan, &session, &needs, &error));
    TEST_ASSERT_EQUAL_INT(0, needs.patterns);
    session_finish(&session);
}

/* A file of the stage's holds these words. */
static void check_text(const char *name, const char *words)
{
    size_t size;
    char *path = path_join(stage.folder, name);
    char *text = (char *)file_read(path, &size);
    TEST_ASSERT_NOT_NULL_MESSAGE(text, path);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, words), text);
    free(text);
    free(path);
}

static void verbs_say_when_nacred_does_not_run(void)
{
    ask("status", NULL);
    expect_refusal("nacred is not running; start it (systemctl start nacred)");
    ask("start", "stone", NULL);
    expect_refusal("nacred is not running");
}

static void scan_is_begun_helped_and_done_by_verbs(void)
{
    begin_virtual("0", NULL, 0);
    TEST_ASSERT_EQUAL_STRING("idle", state_of("state"));
    ask("start", "stone-1", "--detach", NULL);
    expect_success();
    wait_for_state("waiting");
    TEST_ASSERT_NOT_NULL(strstr(state_of("message"), "lay the white diffuse layer"));
    TEST_ASSERT_EQUAL_STRING("stone-1", state_of("session"));
    help_to_the_end();
    TEST_ASSERT_EQUAL_STRING("done", state_of("state"));
    TEST_ASSERT_EQUAL_STRING("stone-1 is complete: 16 patterns", state_of("message"));
    check_complete("stone-1");
    ask("status", "--follow", NULL);
    expect_success();
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.output, "patterns     16 of 16 measured"), run.output);
}

static void start_follows_the_scan_to_its_end(void)
{
    char line[512];
    char path[160];
    begin_virtual("0", NULL, 0);
    (void)snprintf(line, sizeof line,
                   "(%s start stone --user --json >%s/output 2>%s/errors; echo $? >%s/ended) &",
                   nacre, stage.folder, stage.folder, stage.folder);
    TEST_ASSERT_EQUAL_INT(0, system(line)); /* NOLINT(cert-env33-c): a shell is what is wanted */
    wait_for_state("waiting");
    help_to_the_end();
    (void)snprintf(path, sizeof path, "%s/ended", stage.folder);
    for (int i = 0; i < 200 && access(path, F_OK) != 0; i++) {
        (void)usleep(50000);
    }
    check_text("ended", "0\n");
    check_text("output", "\"state\": \"done\"");
    check_text("errors", "then confirm: run nacre confirm\n");
    check_complete("stone");
}

/* Read from a terminal until `words` have been said. */
static void read_until(int terminal, const char *words)
{
    char said[4096] = "";
    size_t length = 0;
    while (!strstr(said, words)) {
        struct pollfd source = {.fd = terminal, .events = POLLIN};
        TEST_ASSERT_EQUAL_INT_MESSAGE(1, poll(&source, 1, 60000), said);
        ssize_t got = read(terminal, said + length, sizeof said - 1 - length);
        TEST_ASSERT_TRUE_MESSAGE(got > 0, said);
        length += (size_t)got;
        said[length] = '\0';
    }
}

/* Enter is pressed once for the layer and once more, idly, while patterns are measured on it. */
static void enter_before_the_question_does_not_answer_it(void)
{
    int terminal;
    int status = -1;
    begin_virtual("60", NULL, 0);
    pid_t child = forkpty(&terminal, NULL, NULL, NULL);
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        (void)execl(nacre, nacre, "start", "stone", "--user", NULL);
        _exit(127);
    }
    read_until(terminal, "lay the white diffuse layer on the sample, then confirm: press Enter");
    TEST_ASSERT_EQUAL_INT(1, write(terminal, "\n", 1));
    wait_for_state("running");
    TEST_ASSERT_EQUAL_INT(1, write(terminal, "\n", 1));
    read_until(terminal, "take the white diffuse layer off the sample, then confirm: press Enter");
    (void)usleep(500000); /* the answer to the first question took much less */
    TEST_ASSERT_EQUAL_STRING("waiting", state_now());
    TEST_ASSERT_EQUAL_INT(1, write(terminal, "\n", 1));
    read_until(terminal, "stone is complete");
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
    (void)close(terminal);
}

static void requests_are_refused_with_the_reason(void)
{
    begin_virtual("20", NULL, 0);
    ask("start", "../stone", NULL);
    expect_refusal("'../stone' cannot be a session's name");
    ask("start", ".stone", NULL);
    expect_refusal("cannot be a session's name");
    ask("start", "", NULL);
    expect_refusal("cannot be a session's name");
    stage_write(&stage, "bad.yaml", "seed: 1\nwindow: 3\ngrid_spasing: 3\n");
    char *path = path_join(stage.folder, "bad.yaml");
    ask("start", "stone", "--plan", path, NULL);
    expect_refusal("bad.yaml:3:1: unknown key 'grid_spasing'");
    free(path);
    ask("resume", "stone", NULL);
    expect_refusal("there is no session stone");
    ask("resume", NULL);
    expect_refusal("no session is incomplete");
    ask("pause", NULL);
    expect_refusal("no scan is running");
    ask("start", "stone", "-d", NULL);
    expect_success();
    ask("start", "other", NULL);
    expect_refusal("stone is being measured");
    ask("resume", "other", NULL);
    expect_refusal("stone is being measured");
    ask("resume", "stone", NULL);
    expect_refusal("stone is not paused");
    ask("cancel", NULL);
    expect_success();
    ask("start", "stone", NULL);
    expect_refusal("there is a session stone already; go on with it (nacre resume stone)");
    ask("confirm", NULL);
    expect_refusal("no scan is running");
}

static void plan_of_a_file_is_measured(void)
{
    char *plan = text_replace(stage_plan, "black_frames: 2", "black_frames: 4");
    char *path = path_join(stage.folder, "more.yaml");
    stage_write(&stage, "more.yaml", plan);
    begin_virtual("0", NULL, 0);
    ask("start", "stone", "--plan", path, "--detach", NULL);
    expect_success();
    TEST_ASSERT_EQUAL_STRING("18", state_of("patterns"));
    help_to_the_end();
    check_complete("stone");
    free(path);
    free(plan);
}

static void scan_is_paused_and_goes_on(void)
{
    begin_virtual("30", NULL, 0);
    ask("start", "stone", "--detach", NULL);
    expect_success();
    wait_for_state("waiting");
    ask("confirm", NULL);
    expect_success();
    ask("pause", NULL);
    expect_success();
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.output, "paused before pattern"), run.output);
    TEST_ASSERT_EQUAL_STRING("paused", state_of("state"));
    ask("resume", "stone", "--detach", NULL);
    expect_success();
    help_to_the_end();
    check_complete("stone");
}

static void interrupted_client_leaves_the_scan_running(void)
{
    begin_virtual("30", NULL, 0);
    const char *const arguments[] = {nacre, "start", "stone", "--user", NULL};
    char *begun = path_join(stage.folder, "sessions/stone/plan.yaml");
    const struct circumstances stop = {.interrupt_path = begun, .interrupt_ms = 100};
    run = spawn(arguments, &stop);
    free(begun);
    TEST_ASSERT_EQUAL_INT(130, run.status);
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(run.errors, "stone is still being measured; nacre status --follow shows it again"),
        run.errors);
    TEST_ASSERT_EQUAL_STRING("waiting", state_of("state"));
    help_to_the_end();
    check_complete("stone");
}

static void killed_daemon_finds_the_session_and_goes_on(void)
{
    begin_virtual("30", NULL, 0);
    ask("start", "stone", "--detach", NULL);
    expect_success();
    wait_for_state("waiting");
    ask("confirm", NULL);
    expect_success();
    while (strtol(state_of("pattern"), NULL, 10) < 4) {
        (void)usleep(10000);
    }
    TEST_ASSERT_EQUAL_INT(128 + SIGKILL, service_end(&service, SIGKILL));
    begin_virtual("0", NULL, 0);
    TEST_ASSERT_EQUAL_STRING("interrupted", state_of("state"));
    TEST_ASSERT_EQUAL_STRING("stone", state_of("session"));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(state_of("message"), "of 16 patterns; `nacre resume stone` goes on"), run.output);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.output, "\"incomplete\": [\n    \"stone\"\n  ]"),
                                 run.output);
    TEST_ASSERT_TRUE(strtol(state_of("pattern"), NULL, 10) >=
                     1); /* some were still to be written */
    ask("resume", "--detach", NULL);
    expect_success();
    help_to_the_end();
    TEST_ASSERT_EQUAL_STRING("done", state_of("state"));
    check_complete("stone");
}

static void daemon_that_is_stopped_ends_its_scan_between_patterns(void)
{
    begin_virtual("30", NULL, 0);
    ask("start", "stone", "--detach", NULL);
    expect_success();
    wait_for_state("waiting");
    ask("confirm", NULL);
    expect_success();
    TEST_ASSERT_EQUAL_INT(0, kill(service.process, SIGTERM));
    TEST_ASSERT_NOT_NULL(service_hear(&service, "STOPPING=1", 10000));
    TEST_ASSERT_EQUAL_INT(0, service_end(&service, 0));
    begin_virtual("0", NULL, 0);
    TEST_ASSERT_EQUAL_STRING("interrupted", state_of("state"));
}

static void status_is_told_to_the_service_manager(void)
{
    begin_virtual("20", NULL, 0);
    ask("start", "stone", "--detach", NULL);
    expect_success();
    TEST_ASSERT_NOT_NULL(service_hear(&service, "STATUS=opening the devices for stone", 10000));
    TEST_ASSERT_NOT_NULL(service_hear(&service, "STATUS=lay the white diffuse layer", 10000));
    ask("confirm", NULL);
    expect_success();
    TEST_ASSERT_NOT_NULL(
        service_hear(&service, "STATUS=measuring white 0, pattern 1 of 16, ", 10000));
}

/* A job of the stage may be silent for 6.2 s and the watchdog's 0.6 s; see test_job.c. */
static void daemon_whose_camera_hangs_shows_no_life(void)
{
    begin_virtual("0", "3", 600000);
    TEST_ASSERT_NOT_NULL(service_hear(&service, "WATCHDOG=1", 5000));
    ask("start", "stone", "--detach", NULL);
    expect_success();
    wait_for_state("waiting");
    for (int i = 0; i < 8; i++) {
        TEST_ASSERT_NOT_NULL_MESSAGE(service_hear(&service, "WATCHDOG=1", 5000), "while it waits");
    }
    ask("confirm", NULL);
    expect_success();
    TEST_ASSERT_NOT_NULL_MESSAGE(service_hear(&service, "WATCHDOG=1", 5000), "soon after");
    int turns = 0; /* of 0.15 s at least */
    while (turns < 100 && service_hear(&service, "WATCHDOG=1", 2000)) {
        turns++;
    }
    TEST_ASSERT_TRUE_MESSAGE(turns < 100, "it shows life although its camera hangs");
    TEST_ASSERT_EQUAL_STRING("running", state_of("state"));
}

struct heard {
    int asked, finished;
    int good;
    char name[64];
};

static int hear_asked(sd_bus_message *message, void *context, sd_bus_error *error)
{
    (void)message;
    (void)error;
    ((struct heard *)context)->asked++;
    return 0;
}

static int hear_finished(sd_bus_message *message, void *context, sd_bus_error *error)
{
    struct heard *heard = context;
    const char *name;
    const char *text;
    (void)error;
    TEST_ASSERT_TRUE(sd_bus_message_read(message, "sbs", &name, &heard->good, &text) > 0);
    (void)snprintf(heard->name, sizeof heard->name, "%s", name);
    heard->finished++;
    return 0;
}

static void listeners_hear_questions_and_the_end(void)
{
    struct heard heard = {0};
    sd_bus *bus = NULL;
    begin_virtual("0", NULL, 0);
    TEST_ASSERT_TRUE(sd_bus_open_user(&bus) >= 0);
    TEST_ASSERT_TRUE(sd_bus_match_signal(bus, NULL, NULL, STATION_OBJECT, STATION_INTERFACE,
                                         "Asked", hear_asked, &heard) >= 0);
    TEST_ASSERT_TRUE(sd_bus_match_signal(bus, NULL, NULL, STATION_OBJECT, STATION_INTERFACE,
                                         "Finished", hear_finished, &heard) >= 0);
    ask("start", "stone", "--detach", NULL);
    expect_success();
    help_to_the_end();
    for (int i = 0; i < 100 && heard.finished == 0; i++) {
        while (sd_bus_process(bus, NULL) > 0) {
        }
        (void)sd_bus_wait(bus, 100000);
    }
    sd_bus_flush_close_unref(bus);
    TEST_ASSERT_TRUE(heard.asked >= 2);
    TEST_ASSERT_EQUAL_INT(1, heard.finished);
    TEST_ASSERT_TRUE(heard.good);
    TEST_ASSERT_EQUAL_STRING("stone", heard.name);
}

/* Begin a scan on a bus of one's own: no program is as fast. */
static void start_on(sd_bus *bus, const char *name)
{
    int result = -1;
    time_t end = deadline();
    while (result < 0 && time(NULL) < end) {
        sd_bus_error error = SD_BUS_ERROR_NULL;
        result = sd_bus_call_method(bus, STATION_SERVICE, STATION_OBJECT, STATION_INTERFACE,
                                    "Start", &error, NULL, "ss", name, "");
        /* The one before may not have ended yet. */
        TEST_ASSERT_TRUE_MESSAGE(result >= 0 || sd_bus_error_has_name(&error, STATION_ERROR_BUSY),
                                 error.message);
        sd_bus_error_free(&error);
    }
    TEST_ASSERT_TRUE(result >= 0);
}

static const char real_station[] =
    "sample: {width: 6, height: 5, pitch_mm: 0.5}\n"
    "camera: {driver: v4l2, width: 24, height: 20, bits: 10, bayer: GRBG, v4l2: {device: "
    "/dev/nacre/none}}\n"
    "projector: {driver: egl, wheel_hz: 30, egl: {device: /dev/dri/none}}\n"
    "trigger: {driver: gpio, gpio: {output: {line: shutter}}}\n"
    "plan: plan.yaml\n";

/* A scan without devices may have failed before anybody looks at its state, which is what it was before. */
static void every_end_is_heard_however_soon_it_comes(void)
{
    enum { STARTS = 30 };
    struct heard heard = {0};
    char name[32];
    sd_bus *bus = NULL;
    stage_write(&stage, "station.yaml", real_station);
    begin_real();
    TEST_ASSERT_TRUE(sd_bus_open_user(&bus) >= 0);
    TEST_ASSERT_TRUE(sd_bus_match_signal(bus, NULL, NULL, STATION_OBJECT, STATION_INTERFACE,
                                         "Finished", hear_finished, &heard) >= 0);
    for (int i = 0; i < STARTS; i++) {
        (void)snprintf(name, sizeof name, "stone-%d", i);
        start_on(bus, name);
    }
    for (int i = 0; i < 50 && heard.finished < STARTS; i++) {
        while (sd_bus_process(bus, NULL) > 0) {
        }
        (void)sd_bus_wait(bus, 100000);
    }
    sd_bus_flush_close_unref(bus);
    TEST_ASSERT_EQUAL_INT(STARTS, heard.finished);
    TEST_ASSERT_FALSE(heard.good);
    TEST_ASSERT_EQUAL_STRING(name, heard.name);
}

static void second_daemon_is_refused(void)
{
    const char *arguments[] = {nacred_virtual, stage.station, stage.folder, NULL};
    begin_virtual("0", NULL, 0);
    run = spawn(arguments, NULL);
    expect_refusal("cannot take the name org.nacre.Station1; another nacred may hold it");
}

static void start_fails_with_what_the_devices_say(void)
{
    stage_write(&stage, "station.yaml", real_station);
    begin_real();
    ask("start", "stone", NULL);
    expect_refusal("/dev/dri/none");
    TEST_ASSERT_EQUAL_STRING("failed", state_of("state"));
    TEST_ASSERT_NULL_MESSAGE(strstr(state_of("message"), "nacre resume"), run.output);
    ask("resume", "stone", NULL);
    expect_refusal("there is no session stone");
}

static void real_daemon_refuses_a_virtual_station(void)
{
    begin_real();
    ask("start", "stone", "--detach", NULL);
    expect_refusal("nacred measures with real devices alone");
}

static void missing_station_file_is_named(void)
{
    begin_real();
    TEST_ASSERT_EQUAL_INT(0, unlink(stage.station));
    ask("start", "stone", NULL);
    expect_refusal("station.yaml: ");
    TEST_ASSERT_EQUAL_STRING("idle", state_of("state"));
}

static void daemon_knows_its_options(void)
{
    const char *const help[] = {nacred, "--help", NULL};
    const char *const wrong[] = {nacred, "--stations", "x", NULL};
    run = spawn(help, NULL);
    TEST_ASSERT_EQUAL_INT(0, run.status);
    TEST_ASSERT_NOT_NULL(strstr(run.output, "--station FILE"));
    spawned_finish(&run);
    run = spawn(wrong, NULL);
    TEST_ASSERT_EQUAL_INT(2, run.status);
}

int main(int argc, char **argv)
{
    if (argc != 4 || !getenv("DBUS_SESSION_BUS_ADDRESS")) {
        (void)fprintf(stderr, "usage: dbus-run-session -- %s NACRE NACRED NACRED_VIRTUAL\n",
                      argv[0]);
        return 2;
    }
    nacre = argv[1];
    nacred = argv[2];
    nacred_virtual = argv[3];
    UNITY_BEGIN();
    RUN_TEST(verbs_say_when_nacred_does_not_run);
    RUN_TEST(scan_is_begun_helped_and_done_by_verbs);
    RUN_TEST(start_follows_the_scan_to_its_end);
    RUN_TEST(enter_before_the_question_does_not_answer_it);
    RUN_TEST(requests_are_refused_with_the_reason);
    RUN_TEST(plan_of_a_file_is_measured);
    RUN_TEST(scan_is_paused_and_goes_on);
    RUN_TEST(interrupted_client_leaves_the_scan_running);
    RUN_TEST(killed_daemon_finds_the_session_and_goes_on);
    RUN_TEST(daemon_that_is_stopped_ends_its_scan_between_patterns);
    RUN_TEST(status_is_told_to_the_service_manager);
    RUN_TEST(daemon_whose_camera_hangs_shows_no_life);
    RUN_TEST(listeners_hear_questions_and_the_end);
    RUN_TEST(every_end_is_heard_however_soon_it_comes);
    RUN_TEST(second_daemon_is_refused);
    RUN_TEST(start_fails_with_what_the_devices_say);
    RUN_TEST(real_daemon_refuses_a_virtual_station);
    RUN_TEST(missing_station_file_is_named);
    RUN_TEST(daemon_knows_its_options);
    return UNITY_END();
}
