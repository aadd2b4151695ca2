/* Tests of a station file's real devices, opened and used together. */
#include "rig/devices.h"

#include "gpio_sim.h"
#include "guest.h"
#include "unity.h"
#include "vivid.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static const char path[] = "/run/station.yaml";
static const char *const names[] = {"shutter", NULL};
static struct vivid webcam;
static struct gpio_sim chip;
static struct clock system_clock;
static struct nacre_error error;
static struct station station;

void setUp(void)
{
    error.text[0] = '\0';
    system_clock = clock_monotonic();
}

void tearDown(void)
{
    station_finish(&station);
}

static void read_station(const char *camera, const char *trigger)
{
    char text[1024];
    (void)snprintf(text, sizeof text,
                   "sample: {width: 6, height: 5, pitch_mm: 0.5}\n"
                   "camera: {width: 300, height: 160, bits: 10, bayer: GBRG, %s}\n"
                   "projector: {driver: virtual, wheel_hz: 30}\n"
                   "trigger: {%s}\n",
                   camera, trigger);
    guest_write(path, text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, station_read(path, &station, &error), error.text);
}

static const char v4l2_camera[] =
    "driver: v4l2, v4l2: {device: /dev/video0, frame_width: 320, frame_height: 180, left: 7, "
    "top: 4, gain: 9}";
static const char gpio_trigger[] =
    "driver: gpio, gpio: {output: {line: shutter}, jitter_us: 900000}";

static void camera_and_trigger_of_a_station_expose_together(void)
{
    struct camera *camera = NULL;
    struct trigger *trigger = NULL;
    struct camera_frame frame;
    int64_t trigger_ns = 0;
    webcam = vivid_plug("vivid", "");
    vivid_set(&webcam, "Test Pattern", VIVID_RED);
    chip = gpio_sim_plug("lines", 2, names);
    read_station(v4l2_camera, gpio_trigger);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, devices_open_camera(&station, &system_clock, &camera, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, devices_open_trigger(&station, &system_clock, &trigger, &error), error.text);
    TEST_ASSERT_EQUAL_INT(300, camera->width);
    TEST_ASSERT_EQUAL_INT(160, camera->height);
    TEST_ASSERT_EQUAL_INT(9, vivid_get(&webcam, "Gain"));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->arm(camera, 33000000, &error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, trigger->ops->fire(trigger, 33000000, &trigger_ns, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera->ops->take(camera, 5000000000, &frame, &error),
                                  error.text);
    TEST_ASSERT_TRUE(trigger->pulse.width_ns >= 33000000 - trigger->pulse.doubt_ns);
    for (int i = 0; i < 300 * 160; i++) {
        int red = bayer_channel(BAYER_GBRG, i % 300, i / 300) == 0;
        TEST_ASSERT_EQUAL_INT(red ? 1023 : 0, frame.raw[i]);
    }
    camera->ops->close(camera);
    trigger->ops->close(trigger);
    gpio_sim_unplug(&chip);
    vivid_unplug(&webcam);
}

static void trigger_none_tells_the_time(void)
{
    struct trigger *trigger = NULL;
    int64_t trigger_ns = 0;
    read_station("driver: v4l2, v4l2: {mode: free}", "driver: none");
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          devices_open_trigger(&station, &system_clock, &trigger, &error));
    int64_t before_ns = clock_now_ns(&system_clock);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger->ops->fire(trigger, 5000000000, &trigger_ns, &error));
    TEST_ASSERT_TRUE(trigger_ns >= before_ns && trigger_ns <= clock_now_ns(&system_clock));
    trigger->ops->close(trigger);
}

static void devices_that_are_not_there_are_told(void)
{
    struct camera *camera = NULL;
    struct trigger *trigger = NULL;
    read_station(v4l2_camera, gpio_trigger);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          devices_open_camera(&station, &system_clock, &camera, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "camera /dev/video0: is not there"),
                                 error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          devices_open_trigger(&station, &system_clock, &trigger, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no GPIO chip"), error.text);
    station_finish(&station);
    read_station(v4l2_camera, "driver: usb");
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          devices_open_trigger(&station, &system_clock, &trigger, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "trigger board"), error.text);
}

static void virtual_devices_are_not_mixed_with_real_ones(void)
{
    struct camera *camera = NULL;
    struct trigger *trigger = NULL;
    read_station("driver: virtual", "driver: virtual");
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          devices_open_camera(&station, &system_clock, &camera, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "camera: the driver virtual works with virtual devices alone"),
        error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          devices_open_trigger(&station, &system_clock, &trigger, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "trigger: the driver virtual"), error.text);
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    RUN_TEST(camera_and_trigger_of_a_station_expose_together);
    RUN_TEST(trigger_none_tells_the_time);
    RUN_TEST(devices_that_are_not_there_are_told);
    RUN_TEST(virtual_devices_are_not_mixed_with_real_ones);
    return UNITY_END();
}
