/* A whole scan through the sequencer with a real camera, a real trigger, and a projector whose patterns vivid shows: what
 * each frame holds tells whether it is its pattern's. */
#include "gpio_sim.h"
#include "guest.h"
#include "rig/devices.h"
#include "rig/sequence.h"
#include "unity.h"
#include "vivid.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 320, HEIGHT = 180, PATTERNS = 9, EXPOSURES = 2 * PATTERNS };

static const char *const names[] = {"shutter", NULL};
static struct vivid webcam;
static struct gpio_sim chip;
static struct clock system_clock;
static struct nacre_error error;
static struct session session;
static struct devices devices;
static struct sequence_result result;

/* Flat pictures stand for the patterns: black, white, and red for those of single points. */
static enum vivid_pattern picture_of(const uint8_t *levels, int count)
{
    int lit = 0;
    for (int i = 0; i < count; i++) {
        lit += levels[i] != 0;
    }
    return lit == 0 ? VIVID_BLACK : lit == count ? VIVID_WHITE : VIVID_RED;
}

static int show(struct projector *projector, const uint8_t *levels, int64_t *flip_ns,
                struct nacre_error *failure)
{
    (void)failure;
    vivid_set(&webcam, "Test Pattern", picture_of(levels, projector->width * projector->height));
    *flip_ns = clock_now_ns(&system_clock);
    return NACRE_OK;
}

static int lay_white_layer(void *context, bool on, struct nacre_error *failure)
{
    (void)context;
    (void)on;
    (void)failure;
    return NACRE_OK;
}

static const struct projector_ops projector_ops = {.name = "vivid", .show = show};
/* 128 units of 100 us are one turn, at which the picture is as bright as stock vivid's. */
static struct projector projector = {&projector_ops, 6, 5, 12800000};

/* The trigger's pulse, where there is one, begins before the exposure that counts. */
static const char station_text[] = "sample: {width: 6, height: 5, pitch_mm: 0.5}\n"
                                   "camera: {driver: v4l2, width: 320, height: 180, bits: 8, "
                                   "bayer: BGGR, v4l2: {device: /dev/video0, mode: free, "
                                   "settle_frames: 1}}\n"
                                   "projector: {driver: virtual, wheel_hz: 78.125}\n"
                                   "trigger: {driver: %s}\n";
static const char plan_text[] =
    "{seed: 3, black_frames: 2, white_frames: 2, dot_spacing: 2, dot_shift: 2, dot_size: 1, "
    "grid_spacing: 2, window: 1, exposure_turns: [0.5, 1]}\n";

void setUp(void)
{
    error.text[0] = '\0';
    system_clock = clock_monotonic();
    webcam = vivid_plug("vivid-exposure", "");
    vivid_set(&webcam, "Timestamp Source", 1);
    chip = gpio_sim_plug("lines", 2, names);
    guest_run("rm -rf /run/scan && mkdir /run/scan");
}

static void begin(const char *trigger)
{
    char text[512];
    (void)snprintf(text, sizeof text, station_text, trigger);
    guest_write("/run/scan/station.yaml", text);
    guest_write("/run/scan/plan.yaml", plan_text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK,
                                  session_create("/run/scan/session", "/run/scan/station.yaml",
                                                 "/run/scan/plan.yaml", false, &session, &error),
                                  error.text);
    devices = (struct devices){.projector = &projector, .clock = &system_clock};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, devices_open_camera(&session.station, &system_clock, &devices.camera, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, devices_open_trigger(&session.station, &system_clock, &devices.trigger, &error),
        error.text);
}

void tearDown(void)
{
    if (devices.camera) {
        devices.camera->ops->close(devices.camera);
    }
    if (devices.trigger) {
        devices.trigger->ops->close(devices.trigger);
    }
    devices = (struct devices){.camera = NULL};
    session_finish(&session);
    vivid_unplug(&webcam);
    gpio_sim_unplug(&chip);
}

static int scan(int retries)
{
    const struct sequence_operator person = {.white_layer = lay_white_layer};
    const struct sequence_options options = {.retries = retries, .tolerance_ns = 0};
    return sequence_run(&devices, &session, &person, &options, NULL, &result, &error);
}

/* Every frame shows its own pattern: the longer exposure exactly, the shorter one as much darker as each other. */
static void check_frames(bool pulses)
{
    struct pattern *patterns = NULL;
    size_t count = 0;
    int dim[3] = {-1, -1, -1};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&session.plan, &patterns, &count, &error));
    TEST_ASSERT_EQUAL_INT(PATTERNS, count);
    for (size_t i = 0; i < count; i++) {
        struct pattern_frames frames;
        TEST_ASSERT_EQUAL_INT_MESSAGE(
            NACRE_OK, session_read(&session, patterns[i], &frames, &error), error.text);
        int kind = patterns[i].kind == PATTERN_BLACK   ? 0
                   : patterns[i].kind == PATTERN_WHITE ? 1
                                                       : 2;
        for (size_t k = 0; k < frames.count; k++) {
            const struct exposure *exposure = &frames.exposures[k];
            TEST_ASSERT_TRUE(exposure->flip_ns <= exposure->trigger_ns &&
                             exposure->trigger_ns <= exposure->frame_ns);
            TEST_ASSERT_EQUAL_INT(pulses, exposure->pulse_ns >=
                                              exposure->exposure_ns - exposure->pulse_doubt_ns);
            for (int p = 0; p < WIDTH * HEIGHT && k == 1; p++) {
                int red = bayer_channel(BAYER_BGGR, p % WIDTH, p / WIDTH) == 0;
                TEST_ASSERT_EQUAL_INT(kind == 1 || (kind == 2 && red) ? 255 : 0, exposure->raw[p]);
            }
            if (k == 0) {
                int value = exposure->raw[WIDTH + 1]; /* red, with the filters BGGR */
                dim[kind] = dim[kind] < 0 ? value : dim[kind];
                TEST_ASSERT_EQUAL_INT(dim[kind], value);
            }
        }
        pattern_frames_finish(&frames);
    }
    free(patterns);
    TEST_ASSERT_TRUE(dim[1] > 0 && dim[1] < 255);
}

static void every_frame_shows_its_pattern(void)
{
    begin("none");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(3), error.text);
    TEST_ASSERT_EQUAL_INT(PATTERNS, result.patterns);
    TEST_ASSERT_EQUAL_INT(EXPOSURES, result.exposures);
    check_frames(false);
}

static void pulses_are_recorded_with_their_frames(void)
{
    begin("gpio, gpio: {output: {line: shutter}, jitter_us: 900000}");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(20), error.text);
    check_frames(true);
}

static void damaged_and_dropped_frames_are_taken_again(void)
{
    begin("none");
    vivid_set(&webcam, "Percentage of Dropped Buffers", 40);
    vivid_set(&webcam, "Inject V4L2_BUF_FLAG_ERROR", 1);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(5), error.text);
    vivid_set(&webcam, "Percentage of Dropped Buffers", 0);
    TEST_ASSERT_EQUAL_INT(EXPOSURES, result.exposures);
    check_frames(false);
}

static void broken_camera_stops_the_scan_which_is_resumed(void)
{
    begin("none");
    vivid_set(&webcam, "Inject Fatal Streaming Error", 1);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan(0));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "camera /dev/video0: its stream broke"),
                                 error.text);
    TEST_ASSERT_EQUAL_INT(0, result.patterns);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(3), error.text);
    TEST_ASSERT_EQUAL_INT(PATTERNS, result.patterns);
    check_frames(false);
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    RUN_TEST(every_frame_shows_its_pattern);
    RUN_TEST(pulses_are_recorded_with_their_frames);
    RUN_TEST(damaged_and_dropped_frames_are_taken_again);
    RUN_TEST(broken_camera_stops_the_scan_which_is_resumed);
    return UNITY_END();
}
