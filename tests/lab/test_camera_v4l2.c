/* Tests of the V4L2 camera on vivid. */
#include "rig/camera_v4l2.h"

#include "guest.h"
#include "unity.h"
#include "vivid.h"

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

enum { WIDTH = 320, HEIGHT = 180 };
static const int64_t MS = 1000000;
/* The webcam's slowest rate is one frame a second. */
static const int64_t WAIT_NS = 5000000000;

static struct vivid webcam;
static struct clock system_clock;
static struct nacre_error error;
static struct camera *camera;
static struct camera_frame frame;

void setUp(void)
{
    error.text[0] = '\0';
    system_clock = clock_monotonic();
    if (!webcam.path[0]) {
        webcam = vivid_plug("vivid", "");
    }
}

static void close_camera(void)
{
    if (camera) {
        camera->ops->close(camera);
        camera = NULL;
    }
}

void tearDown(void)
{
    close_camera();
}

static struct camera_v4l2_settings settings(int bits, enum bayer bayer)
{
    return (struct camera_v4l2_settings){.stream = {.device = webcam.path,
                                                    .width = WIDTH,
                                                    .height = HEIGHT,
                                                    .bayer = bayer,
                                                    .bits = bits},
                                         .region = {0, 0, WIDTH, HEIGHT},
                                         .mode = CAMERA_PULSE,
                                         .gain = -1};
}

static void open_camera(const struct camera_v4l2_settings *chosen)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera_v4l2_new(chosen, &system_clock, &camera, &error),
                                  error.text);
}

static void refuses(const struct camera_v4l2_settings *chosen, const char *text)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera_v4l2_new(chosen, &system_clock, &camera, &error));
    TEST_ASSERT_NULL(camera);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, text), error.text);
}

static int expose(int64_t exposure_ns)
{
    int status = camera->ops->arm(camera, exposure_ns, &error);
    return status == NACRE_OK ? camera->ops->take(camera, WAIT_NS, &frame, &error) : status;
}

static void must_expose(int64_t exposure_ns)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, expose(exposure_ns), error.text);
}

/* Every pixel of the frame, by its colour. */
static void check_flat(int red, int green, int blue)
{
    int expected[] = {red, green, blue};
    for (int y = 0; y < camera->height; y++) {
        for (int x = 0; x < camera->width; x++) {
            TEST_ASSERT_EQUAL_INT(expected[bayer_channel(camera->bayer, x, y)],
                                  frame.raw[y * camera->width + x]);
        }
    }
}

static void flat_patterns_are_exact_in_every_format(void)
{
    static const int depths[] = {8, 10, 12, 16};
    for (int i = 0; i < 4; i++) {
        for (int bayer = BAYER_RGGB; bayer <= BAYER_GBRG; bayer++) {
            struct camera_v4l2_settings chosen = settings(depths[i], (enum bayer)bayer);
            int full = (1 << depths[i]) - 1;
            vivid_set(&webcam, "Test Pattern", VIVID_RED);
            open_camera(&chosen);
            must_expose(10 * MS);
            check_flat(full, 0, 0);
            close_camera();
        }
    }
}

static void each_colour_is_where_the_filters_are(void)
{
    struct camera_v4l2_settings chosen = settings(10, BAYER_GRBG);
    open_camera(&chosen);
    vivid_set(&webcam, "Test Pattern", VIVID_GREEN);
    must_expose(10 * MS);
    check_flat(0, 1023, 0);
    vivid_set(&webcam, "Test Pattern", VIVID_BLUE);
    must_expose(10 * MS);
    check_flat(0, 0, 1023);
    vivid_set(&webcam, "Test Pattern", VIVID_WHITE);
    must_expose(10 * MS);
    check_flat(1023, 1023, 1023);
    vivid_set(&webcam, "Test Pattern", VIVID_BLACK);
    must_expose(10 * MS);
    check_flat(0, 0, 0);
}

static void part_of_a_frame_begins_with_the_filter_it_is_said_to(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_GBRG);
    chosen.region = (struct camera_region){11, 6, 50, 31};
    vivid_set(&webcam, "Test Pattern", VIVID_BLUE);
    open_camera(&chosen);
    TEST_ASSERT_EQUAL_INT(50, camera->width);
    TEST_ASSERT_EQUAL_INT(31, camera->height);
    TEST_ASSERT_EQUAL_INT(BAYER_GBRG, camera->bayer);
    must_expose(10 * MS);
    check_flat(0, 0, 255);
}

static void devices_of_several_planes_stream_too(void)
{
    struct camera_v4l2_settings chosen = settings(10, BAYER_RGGB);
    vivid_unplug(&webcam);
    webcam = vivid_plug("vivid", "multiplanar=2");
    vivid_set(&webcam, "Test Pattern", VIVID_RED);
    open_camera(&chosen);
    must_expose(10 * MS);
    check_flat(1023, 0, 0);
    close_camera();
    vivid_unplug(&webcam);
}

/* The frame is of a pattern that was set after earlier ones had filled every buffer. */
static void frames_from_before_arming_are_thrown_away(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    vivid_set(&webcam, "Test Pattern", VIVID_RED);
    open_camera(&chosen);
    must_expose(MS);
    (void)usleep(600000);
    vivid_set(&webcam, "Test Pattern", VIVID_BLUE);
    (void)usleep(100000);
    must_expose(MS);
    check_flat(0, 0, 255);
}

/* Stamps at a frame's end lie the exposure and the delay after its beginning, and others the delay alone; both are long
 * here, so that the frame of a second at most, by which vivid stamps in advance, does not matter. */
static void beginning_is_told_from_the_stamp(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    chosen.stamp_delay_ns = 7000 * MS;
    open_camera(&chosen);
    for (int beginning = 0; beginning <= 1; beginning++) {
        int64_t delay_ns = beginning ? 7000 * MS : 27000 * MS;
        vivid_set(&webcam, "Timestamp Source", beginning);
        (void)expose(20000 * MS);
        int64_t before_ns = clock_now_ns(&system_clock) - delay_ns;
        must_expose(20000 * MS);
        int64_t after_ns = clock_now_ns(&system_clock) - delay_ns + 1000 * MS;
        TEST_ASSERT_TRUE(frame.frame_ns >= before_ns && frame.frame_ns <= after_ns);
    }
    vivid_set(&webcam, "Timestamp Source", 0);
}

static void frames_are_counted_by_the_driver(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    open_camera(&chosen);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->arm(camera, MS, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->take(camera, WAIT_NS, &frame, &error));
    /* Not armed in between, so that none is thrown away. */
    for (uint32_t next = frame.sequence + 1, i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera->ops->take(camera, WAIT_NS, &frame, &error),
                                      error.text);
        TEST_ASSERT_EQUAL_UINT32(next++, frame.sequence);
    }
}

static void dropped_frames_leave_a_gap_in_the_count(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    int gaps = 0;
    open_camera(&chosen);
    must_expose(MS);
    uint32_t last = frame.sequence;
    vivid_set(&webcam, "Percentage of Dropped Buffers", 60);
    for (int i = 0; i < 8; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera->ops->take(camera, WAIT_NS, &frame, &error),
                                      error.text);
        TEST_ASSERT_TRUE(frame.sequence > last);
        gaps += frame.sequence > last + 1;
        last = frame.sequence;
    }
    vivid_set(&webcam, "Percentage of Dropped Buffers", 0);
    /* That none of eight frames follows a gap has a chance of 0.4^8, 0.07 %. */
    TEST_ASSERT_TRUE(gaps > 0);
}

/* Take frames until one fails. */
static void fail_to_take(void)
{
    int status = NACRE_OK;
    for (int i = 0; i < 6 && status == NACRE_OK; i++) {
        status = camera->ops->take(camera, WAIT_NS, &frame, &error);
    }
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
}

static void damaged_frame_fails_and_the_next_is_good(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    open_camera(&chosen);
    vivid_set(&webcam, "Test Pattern", VIVID_RED);
    must_expose(MS);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->arm(camera, MS, &error));
    vivid_set(&webcam, "Inject V4L2_BUF_FLAG_ERROR", 1);
    fail_to_take();
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "is damaged"), error.text);
    must_expose(MS);
    check_flat(255, 0, 0);
}

static void broken_stream_is_opened_anew(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    open_camera(&chosen);
    must_expose(MS);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->arm(camera, MS, &error));
    vivid_set(&webcam, "Inject Fatal Streaming Error", 1);
    fail_to_take();
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "its stream broke"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, webcam.path), error.text);
    must_expose(MS);
}

static void camera_that_refuses_to_stream_is_told(void)
{
    static const char *const faults[] = {"Inject VIDIOC_REQBUFS Error", "Inject VIDIOC_QBUF Error",
                                         "Inject VIDIOC_STREAMON Error"};
    static const char *const texts[] = {"gives no buffers", "refuses a buffer",
                                        "does not start to stream"};
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    for (int i = 0; i < 3; i++) {
        vivid_set(&webcam, faults[i], 1);
        refuses(&chosen, texts[i]);
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, webcam.path), error.text);
    }
    open_camera(&chosen);
    must_expose(MS);
}

static void unplugged_camera_is_told_until_it_is_back(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    int other = open(webcam.path, O_RDWR); /* vivid comes back when nobody has it open */
    open_camera(&chosen);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->arm(camera, MS, &error));
    vivid_set(&webcam, "Disconnect", 1);
    fail_to_take();
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "was unplugged; plug it in again"), error.text);
    int64_t began_ns = clock_now_ns(&system_clock);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera->ops->arm(camera, MS, &error));
    /* It waits three seconds for the camera to come back. */
    TEST_ASSERT_TRUE(clock_now_ns(&system_clock) - began_ns < 10000 * MS);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "is not there; plug it in"), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera->ops->take(camera, WAIT_NS, &frame, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "is not armed"), error.text);
    TEST_ASSERT_EQUAL_INT(0, close(other));
    vivid_set(&webcam, "Test Pattern", VIVID_GREEN);
    must_expose(MS);
    check_flat(0, 255, 0);
}

static void camera_whose_driver_was_loaded_anew_goes_on(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    open_camera(&chosen);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->arm(camera, MS, &error));
    vivid_set(&webcam, "Disconnect", 1);
    fail_to_take();
    vivid_unplug(&webcam);
    webcam = vivid_plug("vivid", "");
    vivid_set(&webcam, "Test Pattern", VIVID_GREEN);
    must_expose(MS);
    check_flat(0, 255, 0);
}

static void wrong_formats_and_sizes_are_told(void)
{
    struct camera_v4l2_settings chosen = settings(14, BAYER_RGGB);
    refuses(&chosen, "has no format RG14, which camera.bits and camera.bayer ask for; it offers");
    chosen = settings(9, BAYER_RGGB);
    refuses(&chosen, "there is no format of 9 bits");
    chosen = settings(8, BAYER_RGGB);
    chosen.stream.width = 330;
    chosen.region.width = 320;
    refuses(&chosen, "makes frames of 320 x 180 pixels in format RGGB in place of 330 x 180");
    chosen = settings(8, BAYER_RGGB);
    chosen.region.left = 1;
    refuses(&chosen, "is not inside its frames of 320 x 180");
    chosen = settings(8, BAYER_RGGB);
    chosen.rolling = true;
    refuses(&chosen, "rolling shutter");
}

static void devices_that_are_no_camera_are_told(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    chosen.stream.device = "/dev/nacre/camera";
    refuses(&chosen, "camera /dev/nacre/camera: is not there");
    chosen.stream.device = "/dev/null";
    refuses(&chosen, "camera /dev/null: is no V4L2 device");
    chosen = settings(8, BAYER_RGGB);
    chosen.stream.subdevice = "/dev/v4l-subdev7";
    refuses(&chosen, "camera /dev/v4l-subdev7: is not there");
}

static void node_that_does_not_capture_is_told(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    vivid_unplug(&webcam);
    guest_run("modprobe vivid n_devs=1 node_types=0x100");
    chosen.stream.device = "/dev/video0";
    refuses(&chosen, "does not stream pictures");
    guest_run("rmmod vivid");
}

static void camera_without_permission_names_the_remedy(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    TEST_ASSERT_EQUAL_INT(0, chmod(webcam.path, 0600));
    TEST_ASSERT_EQUAL_INT(0, seteuid(65534));
    int status = camera_v4l2_new(&chosen, &system_clock, &camera, &error);
    TEST_ASSERT_EQUAL_INT(0, seteuid(0));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "may not be opened; install udev/70-nacre-camera.rules"), error.text);
}

static void busy_camera_names_its_holder(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    char holder[64];
    int told[2];
    char byte = 0;
    TEST_ASSERT_EQUAL_INT(0, pipe(told));
    pid_t child = fork();
    if (child == 0) {
        struct camera *held = NULL;
        int status = camera_v4l2_new(&chosen, &system_clock, &held, &error);
        (void)!write(told[1], status == NACRE_OK ? "y" : "n", 1);
        (void)pause();
        _exit(0);
    }
    TEST_ASSERT_EQUAL_INT(1, read(told[0], &byte, 1));
    TEST_ASSERT_EQUAL_INT('y', byte);
    (void)snprintf(holder, sizeof holder, "(process %ld); stop that", (long)child);
    int status = camera_v4l2_new(&chosen, &system_clock, &camera, &error);
    (void)kill(child, SIGKILL);
    (void)waitpid(child, NULL, 0);
    (void)close(told[0]);
    (void)close(told[1]);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "is in use by test_lab_camera"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, holder), error.text);
}

static void camera_without_an_exposure_control_must_be_triggered_by_pulses(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    chosen.mode = CAMERA_FREE;
    refuses(&chosen, "there is no control for the exposure");
    chosen.mode = CAMERA_EDGE;
    refuses(&chosen, "there is no control for the exposure");
}

static void gain_is_set_or_refused(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    chosen.gain = 256;
    refuses(&chosen, "gain 256 is outside its range 0 to 255");
    chosen.gain = 17;
    open_camera(&chosen);
    TEST_ASSERT_EQUAL_INT(17, vivid_get(&webcam, "Gain"));
}

/* The exposure makes the picture of the patched vivid brighter: by 128 of its units of 100 us as stock vivid's. */
static void exposure_is_set_on_a_camera_that_has_it(void)
{
    static const enum camera_mode modes[] = {CAMERA_EDGE, CAMERA_FREE};
    uint16_t values[4];
    vivid_unplug(&webcam);
    webcam = vivid_plug("vivid-exposure", "");
    vivid_set(&webcam, "Test Pattern", VIVID_WHITE);
    vivid_set(&webcam, "Contrast", 64);
    for (int m = 0; m < 2; m++) {
        static const int64_t exposures[] = {64, 128, 64, 32};
        struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
        chosen.mode = modes[m];
        chosen.settle_frames = 2;
        open_camera(&chosen);
        TEST_ASSERT_EQUAL_INT(modes[m] == CAMERA_FREE, camera->free_running);
        for (int i = 0; i < 4; i++) {
            must_expose(exposures[i] * MS / 10);
            TEST_ASSERT_EQUAL_INT(exposures[i], vivid_get(&webcam, "Exposure Time, Absolute"));
            check_flat(frame.raw[0], frame.raw[0], frame.raw[0]);
            values[i] = frame.raw[0];
        }
        TEST_ASSERT_EQUAL_INT(values[0], values[2]);
        TEST_ASSERT_TRUE(values[3] < values[0] && values[0] < values[1]);
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, expose(1000 * MS));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "the nearest is 255.0000 ms"), error.text);
        must_expose(exposures[0] * MS / 10);
        TEST_ASSERT_EQUAL_INT(values[0], frame.raw[0]);
        close_camera();
    }
    vivid_unplug(&webcam);
}

/* Frames of a camera that runs freely are counted as they are delivered, and each begins after it was asked for. */
static void free_camera_gives_frames_that_began_after_arming(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    vivid_unplug(&webcam);
    webcam = vivid_plug("vivid-exposure", "");
    chosen.mode = CAMERA_FREE;
    chosen.settle_frames = 1;
    open_camera(&chosen);
    for (uint32_t i = 0; i < 4; i++) {
        int64_t before_ns = clock_now_ns(&system_clock);
        must_expose(200 * MS);
        TEST_ASSERT_TRUE(frame.frame_ns >= before_ns);
        TEST_ASSERT_EQUAL_UINT32(i, frame.sequence);
        (void)usleep(150000);
    }
    close_camera();
    vivid_unplug(&webcam);
}

static void silent_camera_is_told_in_time(void)
{
    struct camera_v4l2_settings chosen = settings(8, BAYER_RGGB);
    open_camera(&chosen);
    must_expose(MS);
    vivid_set(&webcam, "Percentage of Dropped Buffers", 100);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->arm(camera, MS, &error));
    int64_t began_ns = clock_now_ns(&system_clock);
    int status = NACRE_OK;
    for (int i = 0; i < 5 && status == NACRE_OK; i++) {
        status = camera->ops->take(camera, 600 * MS, &frame, &error);
    }
    int64_t took_ns = clock_now_ns(&system_clock) - began_ns;
    vivid_set(&webcam, "Percentage of Dropped Buffers", 0);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_TRUE(took_ns >= 600 * MS && took_ns < 6000 * MS);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no frame within 600 ms"), error.text);
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    RUN_TEST(flat_patterns_are_exact_in_every_format);
    RUN_TEST(each_colour_is_where_the_filters_are);
    RUN_TEST(part_of_a_frame_begins_with_the_filter_it_is_said_to);
    RUN_TEST(devices_of_several_planes_stream_too);
    RUN_TEST(frames_from_before_arming_are_thrown_away);
    RUN_TEST(beginning_is_told_from_the_stamp);
    RUN_TEST(frames_are_counted_by_the_driver);
    RUN_TEST(dropped_frames_leave_a_gap_in_the_count);
    RUN_TEST(damaged_frame_fails_and_the_next_is_good);
    RUN_TEST(broken_stream_is_opened_anew);
    RUN_TEST(camera_that_refuses_to_stream_is_told);
    RUN_TEST(unplugged_camera_is_told_until_it_is_back);
    RUN_TEST(camera_whose_driver_was_loaded_anew_goes_on);
    RUN_TEST(wrong_formats_and_sizes_are_told);
    RUN_TEST(devices_that_are_no_camera_are_told);
    RUN_TEST(node_that_does_not_capture_is_told);
    RUN_TEST(camera_without_permission_names_the_remedy);
    RUN_TEST(busy_camera_names_its_holder);
    RUN_TEST(camera_without_an_exposure_control_must_be_triggered_by_pulses);
    RUN_TEST(gain_is_set_or_refused);
    RUN_TEST(silent_camera_is_told_in_time);
    RUN_TEST(exposure_is_set_on_a_camera_that_has_it);
    RUN_TEST(free_camera_gives_frames_that_began_after_arming);
    vivid_unplug(&webcam);
    return UNITY_END();
}
