/* Tests of station files. */
#include "rig/camera_v4l2.h"
#include "rig/station.h"

#include "stage.h"
#include "tests/docs.h"
#include "unity.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static struct nacre_error error;

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
}

static int read_text(const char *text, struct station *station)
{
    struct stage stage;
    stage_make(&stage, text, NULL);
    int status = station_read(stage.station, station, &error);
    stage_remove(&stage);
    return status;
}

static void refuses(const char *from, const char *to, const char *what)
{
    struct station station;
    char *text = text_replace(stage_station, from, to);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, read_text(text, &station));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, what), error.text);
    TEST_ASSERT_NULL(station.plan);
    free(text);
}

static void pitch_follows_from_the_measured_width(void)
{
    struct station station;
    char *text = text_replace(stage_station, "pitch_mm: 0.5", "size_mm: 4.5");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, read_text(text, &station), error.text);
    TEST_ASSERT_EQUAL_DOUBLE(0.75, station.sample.pitch_mm); /* 6 points */
    station_finish(&station);
    free(text);
    refuses(", pitch_mm: 0.5", "", "lacks pitch_mm");
    refuses("pitch_mm: 0.5", "pitch_mm: 0.5, size_mm: 4.5", "pitch of 0.75 mm");
    refuses("pitch_mm: 0.5", "size_mm: 0", "size_mm");
}

static void station_of_the_documentation_is_read(void)
{
    struct station station;
    char *text = docs_example("formats.md", "station.yaml");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, read_text(text, &station), error.text);
    TEST_ASSERT_EQUAL_INT(48, station.sample.width);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, station.sample.pitch_mm);
    TEST_ASSERT_EQUAL_INT(BAYER_RGGB, station.camera.bayer);
    TEST_ASSERT_EQUAL_DOUBLE(15, station.camera.electrons);
    TEST_ASSERT_EQUAL_DOUBLE(30, station.projector.wheel_hz);
    TEST_ASSERT_EQUAL_DOUBLE(0.95, station.white_reflectance[2]);
    TEST_ASSERT_EQUAL_DOUBLE(2000, station.simulated.projector.contrast);
    TEST_ASSERT_EQUAL_DOUBLE(20, station.simulated.camera.elevation_deg);
    TEST_ASSERT_EQUAL_DOUBLE(0.78, station.simulated.camera.response[2]);
    station_finish(&station);
    free(text);
}

static void real_station_of_the_documentation_is_read(void)
{
    struct station station;
    char *text = docs_example("station.md", "Station file");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, read_text(text, &station), error.text);
    TEST_ASSERT_EQUAL_INT(CAMERA_DRIVER_V4L2, station.camera.driver);
    TEST_ASSERT_EQUAL_INT(620, station.camera.v4l2.left);
    TEST_ASSERT_EQUAL_INT(PROJECTOR_DRIVER_EGL, station.projector.driver);
    TEST_ASSERT_EQUAL_DOUBLE(34, station.projector.egl.latency_ms);
    TEST_ASSERT_EQUAL_INT(TRIGGER_DRIVER_GPIO, station.trigger.driver);
    TEST_ASSERT_EQUAL_STRING("wheel", station.trigger.gpio.index.line);
    station_finish(&station);
    free(text);
}

static void what_a_station_does_not_name_is_absent(void)
{
    struct station station;
    char *quiet = text_replace(stage_station, "  read_noise: 1.5\n  electrons: 8\n", "");
    char *text = text_replace(quiet, "  projector: {contrast: 500, latency_ms: 16}\n", "");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, read_text(text, &station), error.text);
    TEST_ASSERT_EQUAL_DOUBLE(0, station.camera.read_noise);
    TEST_ASSERT_EQUAL_DOUBLE(0, station.camera.electrons);
    TEST_ASSERT_EQUAL_DOUBLE(0, station.simulated.projector.contrast);
    TEST_ASSERT_EQUAL_DOUBLE(0, station.simulated.camera.vignetting);
    TEST_ASSERT_NULL(station.simulated.sample);
    TEST_ASSERT_EQUAL_DOUBLE(0.9, station.white_reflectance[1]);
    TEST_ASSERT_EQUAL_DOUBLE(1, station.simulated.camera.response[1]);
    station_finish(&station);
    free(text);
    free(quiet);
}

static void station_refuses_what_it_does_not_know(void)
{
    refuses("  bits: 10", "  bitts: 10", "station.yaml:6:3: ");
    refuses("  bits: 10", "  bits: 7", "station.yaml:6:9: ");
    refuses("bits: 10", "bits: ten", "bits");
    refuses("bayer: GRBG", "bayer: RGBG", "bayer");
    refuses("  bits: 10\n", "", "bits");
    refuses("driver: virtual\n  width", "driver: v4l\n  width", "v4l2");
    refuses("trigger: {driver: virtual}", "trigger: {driver: gpio, gpio: {ouput: {line: a}}}",
            "station.yaml:12:32: ");
    refuses("trigger: {driver: virtual}", "trigger: {driver: gpio, gpio: {jitter_us: 0}}",
            "station.yaml:12:43: ");
    refuses("pitch_mm: 0.5", "pitch_mm: 0", "pitch_mm");
    refuses("width: 6", "width: 6.5", "width");
    refuses("elevation_deg: 20", "elevation_deg: 95", "elevation_deg");
    refuses("white_reflectance: 0.9", "white_reflectance: [0.9, 0.9]", "white_reflectance");
}

static void station_refuses_a_pedestal_at_saturation(void)
{
    refuses("pedestal: 32", "pedestal: 1023", "no range below saturation at 1023");
}

static const char v4l2_camera[] =
    "  driver: v4l2\n"
    "  v4l2: {subdevice: /dev/v4l-subdev2, frame_width: 64, frame_height: 48, left: 3,\n"
    "         top: 4, mode: free, shutter: rolling, gain: 12, stamp_delay_ms: 4.5}\n"
    "  width";

static void camera_of_v4l2_is_read(void)
{
    struct station station;
    char *text = text_replace(stage_station, "  driver: virtual\n  width", v4l2_camera);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, read_text(text, &station), error.text);
    const struct v4l2_settings *own = &station.camera.v4l2;
    TEST_ASSERT_EQUAL_INT(CAMERA_DRIVER_V4L2, station.camera.driver);
    TEST_ASSERT_FALSE(station_is_virtual(&station));
    TEST_ASSERT_EQUAL_STRING("/dev/nacre/camera", own->device);
    TEST_ASSERT_EQUAL_STRING("/dev/v4l-subdev2", own->subdevice);
    TEST_ASSERT_EQUAL_INT(64, own->frame_width);
    TEST_ASSERT_EQUAL_INT(3, own->left);
    TEST_ASSERT_EQUAL_INT(CAMERA_FREE, own->mode);
    TEST_ASSERT_EQUAL_INT(1, own->shutter);
    TEST_ASSERT_EQUAL_INT(12, own->gain);
    TEST_ASSERT_EQUAL_DOUBLE(4.5, own->stamp_delay_ms);
    TEST_ASSERT_EQUAL_INT(3, own->settle_frames);
    station_finish(&station);
    free(text);
}

static void projector_of_egl_is_read(void)
{
    struct station station;
    char *text = text_replace(
        stage_station, "projector: {driver: virtual, wheel_hz: 30}",
        "projector: {driver: egl, wheel_hz: 120, egl: {connector: DP-2, mode: 1280x800, top: 7}}");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, read_text(text, &station), error.text);
    const struct egl_settings *own = &station.projector.egl;
    TEST_ASSERT_EQUAL_INT(PROJECTOR_DRIVER_EGL, station.projector.driver);
    TEST_ASSERT_FALSE(station_is_virtual(&station));
    TEST_ASSERT_NULL(own->device);
    TEST_ASSERT_EQUAL_STRING("DP-2", own->connector);
    TEST_ASSERT_EQUAL_STRING("1280x800", own->mode);
    TEST_ASSERT_EQUAL_INT(0, own->left);
    TEST_ASSERT_EQUAL_INT(7, own->top);
    TEST_ASSERT_EQUAL_DOUBLE(50, own->latency_ms);
    station_finish(&station);
    free(text);
}

static void projectors_whose_mode_cannot_be_are_refused_with_their_line(void)
{
    refuses("projector: {driver: virtual, wheel_hz: 30}",
            "projector:\n  driver: egl\n  wheel_hz: 30\n  egl: {mode: 1280*800}",
            "station.yaml:14: projector.egl.mode: \"1280*800\" is no mode; write it as 1920x1080");
    refuses("projector: {driver: virtual, wheel_hz: 30}",
            "projector: {driver: egl, wheel_hz: 30, egl: {left: -1}}", "left");
}

static void trigger_of_gpio_is_read(void)
{
    struct station station;
    char *text = text_replace(
        stage_station, "trigger: {driver: virtual}",
        "trigger:\n  driver: gpio\n  gpio:\n    output: {line: shutter, active_low: true}\n"
        "    index: {chip: gpiochip1, offset: 5}\n    index_delay_us: 250");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, read_text(text, &station), error.text);
    const struct gpio_settings *own = &station.trigger.gpio;
    TEST_ASSERT_EQUAL_INT(TRIGGER_DRIVER_GPIO, station.trigger.driver);
    TEST_ASSERT_EQUAL_STRING("shutter", own->output.line);
    TEST_ASSERT_NULL(own->output.chip);
    TEST_ASSERT_TRUE(own->output.active_low);
    TEST_ASSERT_EQUAL_STRING("gpiochip1", own->index.chip);
    TEST_ASSERT_EQUAL_INT(5, own->index.offset);
    TEST_ASSERT_EQUAL_DOUBLE(250, own->index_delay_us);
    TEST_ASSERT_EQUAL_DOUBLE(200, own->jitter_us);
    station_finish(&station);
    free(text);
}

/* In place of the camera of the stage, whose v4l2 then stands in line 4. */
static void refuses_camera(const char *from, const char *to, const char *what)
{
    char *camera = text_replace(v4l2_camera, from, to);
    refuses("  driver: virtual\n  width", camera, what);
    free(camera);
}

static void cameras_that_cannot_be_are_refused_with_their_line(void)
{
    refuses_camera("mode: free", "mode: pulse",
                   "station.yaml:4: camera.v4l2: the rows of a rolling shutter");
    refuses_camera("left: 3", "left: 41",
                   "station.yaml:4: camera.v4l2: 24 x 20 pixels from (41, 4) on do not lie in");
    refuses_camera("frame_height: 48", "frame_height: 23", "do not lie in frames of 64 x 23");
    refuses_camera("mode: free", "mode: none", "mode");
    char *eleven = text_replace(stage_station, "bits: 10", "bits: 11");
    char *text = text_replace(eleven, "  driver: virtual\n  width", v4l2_camera);
    struct station station;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, read_text(text, &station));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "V4L2 has no raw format of 11 bits"),
                                 error.text);
    free(text);
    text = text_replace(stage_station, "  driver: virtual\n  width",
                        "  driver: v4l2\n  v4l2: {mode: edge}\n  width");
    char *untriggered = text_replace(text, "trigger: {driver: virtual}", "trigger: {driver: none}");
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, read_text(untriggered, &station));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, ":4: camera.v4l2: in mode edge nothing exposes"), error.text);
    free(untriggered);
    free(text);
    free(eleven);
}

static void triggers_without_a_line_are_refused(void)
{
    refuses("trigger: {driver: virtual}", "trigger: {driver: gpio, gpio: {index: {line: a}}}",
            "station.yaml:12: trigger.gpio.output: names no line");
    refuses("trigger: {driver: virtual}",
            "trigger: {driver: gpio, gpio: {output: {line: a, offset: 3}}}",
            "station.yaml:12: trigger.gpio.output: names its line twice");
}

static void station_refuses_a_missing_file(void)
{
    struct station station;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, station_read("/nowhere/s.yaml", &station, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "/nowhere/s.yaml"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "No such file"), error.text);
}

static void relative_paths_are_taken_from_the_file_and_become_absolute(void)
{
    struct stage stage;
    struct station station;
    char expected[160];
    char *text = text_replace(stage_station, "  seed: 5\n", "  sample: things/slab.yaml\n");
    char *before = getcwd(NULL, 0);
    stage_make(&stage, text, NULL);
    TEST_ASSERT_NOT_NULL(before);
    TEST_ASSERT_EQUAL_INT(0, chdir(stage.folder));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, station_read("station.yaml", &station, &error));
    TEST_ASSERT_EQUAL_INT(0, chdir(before));
    (void)snprintf(expected, sizeof expected, "%s/", stage.folder);
    TEST_ASSERT_EQUAL_INT(0, strncmp(expected, station.simulated.sample, strlen(expected)));
    TEST_ASSERT_NOT_NULL(strstr(station.simulated.sample, "things/slab.yaml"));
    TEST_ASSERT_TRUE(station.plan[0] == '/');
    station_finish(&station);
    stage_remove(&stage);
    free(text);
    free(before);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(pitch_follows_from_the_measured_width);
    RUN_TEST(station_of_the_documentation_is_read);
    RUN_TEST(real_station_of_the_documentation_is_read);
    RUN_TEST(what_a_station_does_not_name_is_absent);
    RUN_TEST(station_refuses_what_it_does_not_know);
    RUN_TEST(station_refuses_a_pedestal_at_saturation);
    RUN_TEST(camera_of_v4l2_is_read);
    RUN_TEST(projector_of_egl_is_read);
    RUN_TEST(projectors_whose_mode_cannot_be_are_refused_with_their_line);
    RUN_TEST(trigger_of_gpio_is_read);
    RUN_TEST(cameras_that_cannot_be_are_refused_with_their_line);
    RUN_TEST(triggers_without_a_line_are_refused);
    RUN_TEST(station_refuses_a_missing_file);
    RUN_TEST(relative_paths_are_taken_from_the_file_and_become_absolute);
    return UNITY_END();
}
