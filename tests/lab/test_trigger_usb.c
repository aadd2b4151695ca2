/* Tests of the USB trigger on a real bus: the kernel's vhci-hcd, libusb and the udev rule with the firmware's portable
 * half as the board, until its process is killed. */
#include "rig/trigger_usb.h"

#include "board_server.h"
#include "guest.h"
#include "unity.h"

#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { GROUP = 4711, NOBODY = 65534, OLD_PROTOCOL = 77 };

static const char link_path[] = "/dev/nacre/trigger";
static const int64_t turn_ns = 50000000; /* 20 Hz */

static struct nacre_error error;
static struct board_server board, second;
static struct trigger *trigger;
static struct clock system_clock;

static void settle_devices(void)
{
    guest_run("udevadm settle --timeout=30");
}

static struct board_server plug(int port, int protocol)
{
    struct board_server plugged = board_server_plug(
        (struct board_server_settings){.port = port, .wheel_hz = 20, .protocol = protocol});
    return plugged;
}

/* Until libusb lists so many. */
static void wait_for_boards(size_t wanted)
{
    size_t count = wanted + 1;
    for (int i = 0; i < 200 && count != wanted; i++) {
        struct usb_place *places = NULL;
        TEST_ASSERT_EQUAL_INT_MESSAGE(
            NACRE_OK, usb_libusb_list(&trigger_usb_kind, &places, &count, &error), error.text);
        free(places);
        (void)usleep(50000);
    }
    TEST_ASSERT_EQUAL_UINT64(wanted, count);
    settle_devices();
}

void setUp(void)
{
    error.text[0] = '\0';
    system_clock = clock_monotonic();
    board = plug(0, 0);
    wait_for_boards(1);
}

static double ms(long long ns)
{
    return (double)ns * 1e-6;
}

static void close_trigger(void)
{
    if (trigger) {
        trigger->ops->close(trigger);
        trigger = NULL;
    }
}

void tearDown(void)
{
    close_trigger();
    if (board.process) {
        TEST_ASSERT_FALSE_MESSAGE(board.view->broken, "the server refused what the kernel sent");
    }
    board_server_unplug(&board);
    board_server_unplug(&second);
    wait_for_boards(0);
}

static int make(void)
{
    struct usb_port *port = NULL;
    int status = usb_libusb_port(&trigger_usb_kind, NULL, &port, &error);
    return status == NACRE_OK ? trigger_usb_new(port, &system_clock, &trigger, &error) : status;
}

static void must_make(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, make(), error.text);
}

static void refuses_to_open(const char *why)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, make());
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
    TEST_ASSERT_NULL(trigger);
}

static int64_t fire(int turns)
{
    int64_t trigger_ns = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, trigger->ops->fire(trigger, turns * turn_ns, &trigger_ns, &error), error.text);
    return trigger_ns;
}

static void fails_to_fire(int turns, const char *why)
{
    int64_t trigger_ns = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          trigger->ops->fire(trigger, turns * turn_ns, &trigger_ns, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
}

static void the_rule_gives_the_board_a_link_and_the_group(void)
{
    char target[PATH_MAX];
    struct stat found;
    TEST_ASSERT_NOT_NULL_MESSAGE(realpath(link_path, target), link_path);
    TEST_ASSERT_EQUAL_STRING_LEN("/dev/bus/usb/", target, 13);
    TEST_ASSERT_EQUAL_INT(0, stat(target, &found));
    TEST_ASSERT_EQUAL_INT(GROUP, found.st_gid);
    TEST_ASSERT_EQUAL_HEX(0660, found.st_mode & 07777);
    board_server_unplug(&board);
    wait_for_boards(0);
    TEST_ASSERT_EQUAL_INT(-1, access(link_path, F_OK));
}

static void make_as(uid_t user, gid_t group, int expected, const char *text)
{
    TEST_ASSERT_EQUAL_INT(0, setegid(group));
    TEST_ASSERT_EQUAL_INT(0, seteuid(user));
    int status = make();
    close_trigger();
    TEST_ASSERT_EQUAL_INT(0, seteuid(0));
    TEST_ASSERT_EQUAL_INT(0, setegid(0));
    TEST_ASSERT_EQUAL_INT_MESSAGE(expected, status, error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, text), error.text);
}

static void the_group_may_use_it_and_others_are_told_the_remedy(void)
{
    make_as(NOBODY, GROUP, NACRE_OK, "");
    make_as(NOBODY, NOBODY, NACRE_FAILED,
            "permission denied; install udev/70-nacre-trigger.rules, plug the board in again, and "
            "be in the group nacre");
}

static void exposures_are_whole_turns_and_their_beginning_is_told(void)
{
    must_make();
    (void)fire(1); /* waits for the loop to settle */
    for (int turns = 1; turns <= 4; turns++) {
        int64_t asked_ns = clock_now_ns(&system_clock);
        int64_t trigger_ns = fire(turns);
        int64_t done_ns = clock_now_ns(&system_clock);
        const struct board_view *view = board.view;
        long long length = (long long)(view->fall_tick - view->rise_tick);
        long long off_ns = trigger_ns - view->rise_ns;
        printf("USB: %d turns: %lld cycles, rise told %.2f ms off, fire took %.1f ms\n", turns,
               length, ms(off_ns), ms(done_ns - asked_ns));
        TEST_ASSERT_EQUAL_UINT(1 + turns, view->rises);
        /* A steady wheel, and prediction rounded to a tick at both ends. */
        TEST_ASSERT_INT64_WITHIN(1, turns * 800000, length);
        /* Half of an answer's way on the emulated bus: a millisecond, or 17 where the host is busy. */
        TEST_ASSERT_INT64_WITHIN(100000000, 0, off_ns);
        TEST_ASSERT_TRUE(trigger_ns > asked_ns && trigger_ns < done_ns);
    }
}

static void status_and_settings_pass(void)
{
    struct board_status status;
    struct board_settings settings = {.gain = 2, .coast = 3};
    must_make();
    (void)fire(1);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger_usb_set(trigger, &settings, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger_usb_status(trigger, &status, &error));
    TEST_ASSERT_EQUAL_UINT8(2, status.settings.gain);
    /* Jitter of 2 us is 40 ppm of a turn. */
    TEST_ASSERT_DOUBLE_WITHIN(0.001, 20, trigger_usb_wheel_hz(&status));
    settings.gain = 9;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, trigger_usb_set(trigger, &settings, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "gains are 1 to 6"), error.text);
}

static long long killed_ns;

static void *kill_in_exposure(void *unused)
{
    (void)unused;
    while (board.view->level == 0) {
        (void)usleep(1000);
    }
    (void)usleep(200000);
    killed_ns = clock_now_ns(&system_clock);
    (void)kill(board.process, SIGKILL);
    return NULL;
}

static void *plug_again(void *unused)
{
    (void)unused;
    (void)usleep(500000);
    board = plug(0, 0);
    while (board.view) {
        (void)usleep(10000);
    }
    return NULL;
}

static void a_board_that_is_unplugged_in_an_exposure_is_told_and_used_again_when_it_is_back(void)
{
    pthread_t thread;
    must_make();
    (void)fire(1);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, kill_in_exposure, NULL));
    fails_to_fire(100, "trigger board: was unplugged");
    printf("USB: told %.0f ms after the unplug: %s\n", ms(clock_now_ns(&system_clock) - killed_ns),
           error.text);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    board_server_unplug(&board);
    fails_to_fire(1, "trigger board: none is plugged in");
    /* And while it is waited for. */
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, plug_again, NULL));
    (void)fire(2);
    TEST_ASSERT_EQUAL_UINT(1, board.view->rises);
    board_server_unplug(&board);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
}

static void *stop_wheel(void *unused)
{
    (void)unused;
    while (board.view->level == 0) {
        (void)usleep(1000);
    }
    board.view->wheel_stops = true;
    return NULL;
}

static void a_wheel_that_stops_in_an_exposure_is_told(void)
{
    pthread_t thread;
    must_make();
    (void)fire(1);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, stop_wheel, NULL));
    fails_to_fire(100, "lost the colour wheel during the exposure");
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_EQUAL_INT(0, board.view->level);
    fails_to_fire(1, "finds no colour wheel");
}

static void of_two_boards_none_is_taken(void)
{
    second = plug(1, 0);
    wait_for_boards(2);
    refuses_to_open("trigger board: 2 are plugged in, at ");
    board_server_unplug(&board);
    wait_for_boards(1);
    must_make();
    (void)fire(1);
    TEST_ASSERT_EQUAL_UINT(1, second.view->rises);
}

static void a_board_with_old_firmware_is_refused(void)
{
    board_server_unplug(&board);
    wait_for_boards(0);
    board = plug(0, OLD_PROTOCOL);
    wait_for_boards(1);
    refuses_to_open("its firmware speaks protocol 77 and this program 1; write the firmware anew");
}

static void a_board_that_another_program_uses_is_refused(void)
{
    must_make();
    struct trigger *first = trigger;
    trigger = NULL;
    refuses_to_open("is in use by another program");
    trigger = first;
    (void)fire(1);
}

/* What `nacre doctor` says of the board, at a station whose camera and projector are not there. */
static void doctor_says(int wheel_hz, const char *verdict, const char *text)
{
    char station[512];
    (void)snprintf(station, sizeof station,
                   "sample: {width: 8, height: 8, pitch_mm: 0.5}\n"
                   "camera: {driver: v4l2, width: 48, height: 48, bits: 8, bayer: RGGB,\n"
                   "         v4l2: {device: /dev/video9}}\n"
                   "projector: {driver: egl, wheel_hz: %d}\n"
                   "trigger: {driver: usb}\n",
                   wheel_hz);
    guest_write("/run/station.yaml", station);
    guest_run("! %s doctor --station /run/station.yaml >/run/doctor.txt 2>&1; grep -E ' board ' "
              "/run/doctor.txt; grep -qE '^ok +trigger ' /run/doctor.txt && grep -qE '^%s +board "
              "+%s' /run/doctor.txt",
              NACRE, verdict, text);
}

static void doctor_and_devices_tell_of_the_board(void)
{
    must_make();
    (void)fire(1);
    close_trigger();
    doctor_says(20, "ok", "is locked to a wheel of (20.000|19.999) Hz, gain 3, which takes 3.2 s");
    doctor_says(10, "ok", "is locked to a wheel of (20.000|19.999) Hz");
    doctor_says(30, "wrong",
                "is locked to a wheel of .*, where projector.wheel_hz is 30; correct it");
    guest_run("%s devices >/run/devices.txt && grep -qE 'locked to a wheel of (20.000|19.999) Hz, "
              "gain 3' /run/devices.txt",
              NACRE);
    board.view->wheel_stops = true;
    (void)sleep(1);
    doctor_says(20, "wrong", "finds no colour wheel");
}

int main(void)
{
    guest_require();
    guest_run("echo nacre:x:%d: >>/etc/group && mkdir -p /run/udev/rules.d && cp %s/*.rules "
              "/run/udev/rules.d",
              GROUP, UDEV_RULES);
    guest_run("/lib/systemd/systemd-udevd --daemon");
    guest_run("modprobe vhci-hcd");
    UNITY_BEGIN();
    RUN_TEST(the_rule_gives_the_board_a_link_and_the_group);
    RUN_TEST(the_group_may_use_it_and_others_are_told_the_remedy);
    RUN_TEST(exposures_are_whole_turns_and_their_beginning_is_told);
    RUN_TEST(status_and_settings_pass);
    RUN_TEST(a_board_that_is_unplugged_in_an_exposure_is_told_and_used_again_when_it_is_back);
    RUN_TEST(a_wheel_that_stops_in_an_exposure_is_told);
    RUN_TEST(of_two_boards_none_is_taken);
    RUN_TEST(a_board_with_old_firmware_is_refused);
    RUN_TEST(a_board_that_another_program_uses_is_refused);
    RUN_TEST(doctor_and_devices_tell_of_the_board);
    return UNITY_END();
}
