/* A whole scan by `nacre scan` with V4L2 camera, EGL projector and the trigger board on a real bus, in which the camera sees
 * the screen: the same frames and responses as of a virtual station, also when the board is unplugged in an exposure. */
#include "board_server.h"
#include "feeder.h"
#include "guest.h"
#include "screen.h"
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

enum { LEFT = 301, TOP = 203, LIMIT_S = 100, PATTERNS = 23, KILL_AT = 9 };

static const char folder[] = "/run/whole";
static const char *elf;
static struct screen screen;
static struct feeder feeder;
static struct board_server board;
static pid_t child; /* that scans; 0: none does */

static const char plan_text[] =
    "{seed: 5, black_frames: 2, white_frames: 1, dot_spacing: 4, dot_shift: 2, dot_size: 1,\n"
    " grid_spacing: 4, window: 3, exposure_turns: [1, 4]}\n";

static const char sample_text[] =
    "{width: 8, height: 8, pitch_mm: 0.5, thickness_mm: 2, margin_points: 2, base: light,\n"
    " materials: [{name: light, scattering_per_mm: [2.4, 2.3, 2.1],\n"
    "              absorption_per_mm: [0.2, 0.3, 0.6]}]}\n";

static const char virtual_text[] =
    "sample: {width: 8, height: 8, pitch_mm: 0.5}\nwhite_reflectance: 0.9\nplan: plan.yaml\n"
    "camera: {driver: virtual, width: 48, height: 48, bits: 8, bayer: RGGB, pedestal: 8}\n"
    "projector: {driver: virtual, wheel_hz: 20}\n"
    "trigger: {driver: virtual}\n"
    "virtual:\n"
    "  sample: sample.yaml\n"
    "  projector: {contrast: 500}\n"
    "  camera: {elevation_deg: 12, pixels_per_point: 5, full_scale_s: 0.25}\n";

static const char real_text[] =
    "sample: {width: 8, height: 8, pitch_mm: 0.5}\nwhite_reflectance: 0.9\nplan: plan.yaml\n"
    "camera: {driver: v4l2, width: 48, height: 48, bits: 8, bayer: RGGB, pedestal: 8, "
    "tolerance_ms: 45,\n"
    "         v4l2: {device: /dev/video0, stamp_delay_ms: 10}}\n"
    "projector: {driver: egl, wheel_hz: 20,\n"
    "            egl: {device: %s, mode: 640x480, left: %d, top: %d, latency_ms: 0}}\n"
    "trigger: {driver: usb}\n";

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

static bool look(struct feeder_line *line)
{
    if (!board.view) {
        return false;
    }
    *line = (struct feeder_line){.level = board.view->level,
                                 .rises = board.view->rises,
                                 .rise_ns = board.view->rise_ns,
                                 .fall_ns = board.view->fall_ns};
    return true;
}

static void plug_board(void)
{
    board = board_server_plug((struct board_server_settings){.elf = elf, .wheel_hz = 20});
}

static void write_settings(void)
{
    char text[1024];
    (void)snprintf(text, sizeof text, real_text, screen.path, LEFT, TOP);
    text_write("/run/whole/station.yaml", text);
    text_write("/run/whole/virtual.yaml", virtual_text);
    text_write("/run/whole/plan.yaml", plan_text);
    text_write("/run/whole/sample.yaml", sample_text);
}

static void nacre(const char *const *arguments)
{
    struct spawned run = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    spawned_finish(&run);
}

static void start(const char *session, bool resume)
{
    (void)unlink("/run/whole/errors"); /* of the run before, whose questions are not asked again */
    (void)fflush(stdout);
    child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        (void)dup2(open("/dev/null", O_RDONLY | O_CLOEXEC), STDIN_FILENO);
        (void)dup2(open("/run/whole/errors", O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600),
                   STDERR_FILENO);
        (void)execl(NACRE, NACRE, "scan", session, "--station", "/run/whole/station.yaml",
                    "--quiet", resume ? "--resume" : NULL, (char *)NULL);
        _exit(99);
    }
}

/* Do what the program asks for, once for each time it asks; how often it has asked. */
static int answer(int answered)
{
    size_t size = 0;
    char *text = (char *)file_read("/run/whole/errors", &size);
    char *last = NULL;
    int asked = 0;
    for (char *found = text; found && (found = strstr(found, "white diffuse layer")); found++) {
        last = found;
        asked++;
    }
    if (asked > answered && strchr(last, '\n')) {
        feeder_lay_white(&feeder, last - text >= 8 && strncmp(last - 8, "Lay the ", 8) == 0);
        TEST_ASSERT_EQUAL_INT(0, kill(child, SIGUSR1));
        answered = asked;
    }
    free(text);
    return answered;
}

/* Scan, being the sample, the camera and the person; pull the board out in the pulse `kill_at`, if that is not 0. The exit
 * status; what was said is in /run/whole/errors. */
static int scan(const char *session, int kill_at)
{
    int status = 0;
    int asked = 0;
    int before = feeder.pulses;
    time_t began = time(NULL);
    start(session, access(session, F_OK) == 0);
    while (waitpid(child, &status, WNOHANG) == 0) {
        feeder_step(&feeder);
        if (kill_at > 0 && feeder.pulses - before >= kill_at && board.view->level) {
            board_server_unplug(&board);
            kill_at = 0;
        }
        asked = answer(asked);
        if (time(NULL) - began > LIMIT_S) {
            (void)kill(child, SIGKILL);
        }
        (void)usleep(1000);
    }
    child = 0;
    printf("scan with the trigger board: %d pulses, %d s of the guest\n", feeder.pulses - before,
           (int)(time(NULL) - began));
    TEST_ASSERT_EQUAL_UINT(0, feeder.missed);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

static char *errors(void)
{
    size_t size = 0;
    char *text = (char *)file_read("/run/whole/errors", &size);
    TEST_ASSERT_NOT_NULL(text);
    return text;
}

static void must_scan(const char *session)
{
    int status = scan(session, 0);
    char *text = errors();
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, status, text);
    free(text);
}

/* The session's frames are those of the virtual scan bit for bit, and so is what is developed from them. */
static void expect_same_as_virtual(const char *session)
{
    size_t wanted_size = 0;
    size_t size = 0;
    frames_expect_same_patterns("/run/whole/virtual", session);
    nacre((const char *const[]){NACRE, "develop", session, "-o", "/run/whole/real.exr", NULL});
    uint8_t *wanted = file_read("/run/whole/virtual.exr", &wanted_size);
    uint8_t *bytes = file_read("/run/whole/real.exr", &size);
    TEST_ASSERT_TRUE(size > 0 && size == wanted_size && memcmp(bytes, wanted, size) == 0);
    free(wanted);
    free(bytes);
}

static void a_scan_with_the_board_is_the_virtual_one(void)
{
    nacre((const char *const[]){NACRE, "scan", "/run/whole/virtual", "--station",
                                "/run/whole/virtual.yaml", NULL});
    nacre((const char *const[]){NACRE, "develop", "/run/whole/virtual", "-o",
                                "/run/whole/virtual.exr", NULL});
    must_scan("/run/whole/sound");
    TEST_ASSERT_EQUAL_INT(PATTERNS, session_files_count("/run/whole/sound").patterns);
    expect_same_as_virtual("/run/whole/sound");
}

static void a_scan_whose_board_is_unplugged_in_an_exposure_is_resumed(void)
{
    static const char session[] = "/run/whole/unplugged";
    int status = scan(session, KILL_AT);
    int kept = session_files_count(session).patterns;
    char *text = errors();
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, status, text);
    const char *said = strstr(text, "trigger board: ");
    TEST_ASSERT_NOT_NULL_MESSAGE(said, text);
    printf("%d patterns kept: %s", kept, said);
    free(text);
    TEST_ASSERT_TRUE(kept > 0 && kept < PATTERNS);
    TEST_ASSERT_EQUAL_INT(0, session_files_count(session).unfinished);
    feeder_step(&feeder); /* sees that the board is gone */
    plug_board();
    must_scan(session);
    expect_same_as_virtual(session);
}

int main(int argc, char **argv)
{
    guest_require();
    if (argc != 2) {
        (void)fprintf(stderr, "usage: %s trigger.elf\n", argv[0]);
        return 2;
    }
    elf = argv[1];
    UNITY_BEGIN();
    guest_run("mkdir -p %s", folder);
    guest_run("modprobe vhci-hcd");
    screen = screen_plug("vkms", "vkms");
    write_settings();
    plug_board();
    feeder_begin(&feeder, "/run/whole/virtual.yaml", &screen, NULL);
    feeder.look = look;
    feeder.left = LEFT;
    feeder.top = TOP;
    feeder.stamp_delay_ns = 10000000;
    feeder.exposures_ns[0] = 50000000;
    feeder.exposures_ns[1] = 200000000;
    RUN_TEST(a_scan_with_the_board_is_the_virtual_one);
    RUN_TEST(a_scan_whose_board_is_unplugged_in_an_exposure_is_resumed);
    board_server_unplug(&board);
    return UNITY_END();
}
