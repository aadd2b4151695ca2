/* Tests of the virtual station behind its seams. */
#include "rig/virtual/virtual.h"

#include "unity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static struct nacre_error error;
static struct station settings;
static struct virtual_station *station;

/* Of rig/samples/small.yaml. */
enum { SMALL_WIDTH = 12, SMALL_HEIGHT = 10 };
static const double small_pitch_mm = 0.5;

enum { WIDTH = 40, HEIGHT = 32, PIXELS = WIDTH * HEIGHT, POINTS = 8 * 6 };

/* No noise, no fall-off; the sample fills the frame. */
void setUp(void)
{
    error.text[0] = '\0';
    station = NULL;
    settings = (struct station){.sample = {.width = 8, .height = 6, .pitch_mm = 0.5},
                                .camera = {.width = WIDTH,
                                           .height = HEIGHT,
                                           .bits = 12,
                                           .bayer = BAYER_RGGB,
                                           .pedestal = 64},
                                .projector = {.wheel_hz = 40},
                                .white_reflectance = {0.9, 0.8, 0.7}};
    settings.simulated.projector.latency_ms = 3;
    settings.simulated.camera = (struct virtual_camera_settings){.distance_mm = 200,
                                                                 .pixels_per_point = 7,
                                                                 .full_scale_s = 0.1,
                                                                 .response = {0.5, 1, 0.75},
                                                                 .readout_ms = 4};
}

void tearDown(void)
{
    virtual_station_free(station);
}

static void build(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, virtual_station_new(&settings, &station, &error),
                                  error.text);
}

static void show(uint8_t level)
{
    struct projector *projector = virtual_station_projector(station);
    uint8_t levels[POINTS];
    int64_t flip_ns;
    memset(levels, level, sizeof levels);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, projector->ops->show(projector, levels, &flip_ns, &error));
}

static struct camera_frame expose(int64_t exposure_ns)
{
    struct camera *camera = virtual_station_camera(station);
    struct trigger *trigger = virtual_station_trigger(station);
    struct camera_frame frame;
    int64_t trigger_ns;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->arm(camera, exposure_ns, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger->ops->fire(trigger, exposure_ns, &trigger_ns, &error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera->ops->take(camera, 1000000000, &frame, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT64(trigger_ns, frame.frame_ns);
    return frame;
}

static void devices_are_as_the_settings_say(void)
{
    build();
    TEST_ASSERT_EQUAL_INT(WIDTH, virtual_station_camera(station)->width);
    TEST_ASSERT_EQUAL_INT(12, virtual_station_camera(station)->bits);
    TEST_ASSERT_EQUAL_INT(6, virtual_station_projector(station)->height);
    TEST_ASSERT_EQUAL_INT64(25000000, virtual_station_projector(station)->period_ns);
}

/* Raw = pedestal + range x reflectance x response x exposure / full scale, within half a step of quantisation. */
static void white_layer_is_lambertian_of_its_reflectance(void)
{
    static const double response[3] = {0.5, 1, 0.75};
    build();
    virtual_station_set_white_layer(station, 1);
    show(255);
    struct camera_frame frame = expose(25000000);
    for (int i = 0; i < PIXELS; i++) {
        int c = bayer_channel(BAYER_RGGB, i % WIDTH, i / WIDTH);
        double expected =
            64 + (4095 - 64) * settings.white_reflectance[c] * response[c] * 0.025 / 0.1;
        TEST_ASSERT_DOUBLE_WITHIN(0.501, expected, frame.raw[i]);
    }
}

static void signal_grows_with_exposure_until_it_saturates(void)
{
    build();
    virtual_station_set_white_layer(station, 1);
    show(255);
    int green = 1; /* pixel (1, 0) */
    TEST_ASSERT_DOUBLE_WITHIN(0.501, 64 + 4031 * 0.8 * 0.5, expose(50000000).raw[green]);
    TEST_ASSERT_DOUBLE_WITHIN(0.501, 64 + 4031 * 0.8, expose(100000000).raw[green]);
    TEST_ASSERT_EQUAL_INT(4095, expose(125000000).raw[green]);
}

static void black_is_the_pedestal_and_with_contrast_the_black_level(void)
{
    build();
    show(0);
    TEST_ASSERT_EQUAL_INT(64, expose(100000000).raw[1]);
    virtual_station_free(station);
    settings.simulated.projector.contrast = 100;
    build();
    show(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.501, 64 + 4031 * 0.8 / 100, expose(100000000).raw[1]);
}

static void time_passes_in_refreshes_exposures_and_readouts(void)
{
    struct projector *projector;
    struct clock *clock;
    uint8_t levels[POINTS] = {0};
    int64_t flip_ns;
    build();
    projector = virtual_station_projector(station);
    clock = virtual_station_clock(station);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, projector->ops->show(projector, levels, &flip_ns, &error));
    TEST_ASSERT_EQUAL_INT64(3000000, flip_ns); /* the refresh at 0, and the latency */
    TEST_ASSERT_EQUAL_INT64(3000000, clock_now_ns(clock));
    struct camera_frame frame = expose(50000000);
    TEST_ASSERT_EQUAL_INT(0, frame.sequence);
    TEST_ASSERT_EQUAL_INT64(57000000, clock_now_ns(clock));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, projector->ops->show(projector, levels, &flip_ns, &error));
    TEST_ASSERT_EQUAL_INT64(78000000, flip_ns); /* the refresh at 75 ms */
    TEST_ASSERT_EQUAL_INT(1, expose(1).sequence);
    clock_sleep_until_ns(clock, 500000000);
    TEST_ASSERT_EQUAL_INT64(500000000, clock_now_ns(clock));
    clock_sleep_until_ns(clock, 1);
    TEST_ASSERT_EQUAL_INT64(500000000, clock_now_ns(clock));
}

static void frame_that_was_not_triggered_never_comes(void)
{
    struct camera *camera;
    struct camera_frame frame;
    int64_t trigger_ns;
    build();
    camera = virtual_station_camera(station);
    struct trigger *trigger = virtual_station_trigger(station);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->arm(camera, 25000000, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera->ops->take(camera, 40000000, &frame, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no frame within 40 ms"), error.text);
    TEST_ASSERT_EQUAL_INT64(40000000, clock_now_ns(virtual_station_clock(station)));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger->ops->fire(trigger, 25000000, &trigger_ns, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->take(camera, 40000000, &frame, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera->ops->take(camera, 40000000, &frame, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera->ops->arm(camera, 0, &error));
}

static void copy_frame(enum pattern_kind kind, int number, uint16_t *raw)
{
    virtual_station_begin_pattern(station, (struct pattern){kind, number});
    show(0);
    memcpy(raw, expose(25000000).raw, PIXELS * sizeof *raw);
}

static void noise_depends_on_pattern_and_seed_and_not_on_the_order(void)
{
    uint16_t first[PIXELS], again[PIXELS], other[PIXELS];
    settings.camera.read_noise = 9;
    settings.simulated.seed = 1;
    build();
    copy_frame(PATTERN_BLACK, 0, first);
    copy_frame(PATTERN_BLACK, 1, other);
    TEST_ASSERT_TRUE(memcmp(first, other, sizeof first) != 0);
    copy_frame(PATTERN_GRID, 0, other);
    TEST_ASSERT_TRUE(memcmp(first, other, sizeof first) != 0);
    memcpy(other, expose(50000000).raw, sizeof other); /* another exposure of the same pattern */
    TEST_ASSERT_TRUE(memcmp(first, other, sizeof first) != 0);
    copy_frame(PATTERN_BLACK, 0, again);
    TEST_ASSERT_EQUAL_MEMORY(first, again, sizeof first);
    virtual_station_free(station);
    settings.simulated.seed = 2;
    build();
    copy_frame(PATTERN_BLACK, 0, other);
    TEST_ASSERT_TRUE(memcmp(first, other, sizeof first) != 0);
}

static void sample_is_seen_when_the_layer_is_off(void)
{
    uint16_t layer;
    settings.simulated.sample = (char[]){SAMPLES "/small.yaml"};
    settings.sample.width = SMALL_WIDTH;
    settings.sample.height = SMALL_HEIGHT;
    settings.sample.pitch_mm = small_pitch_mm;
    settings.simulated.camera.pixels_per_point = 60. / SMALL_WIDTH;
    settings.camera.bayer = BAYER_MONO;
    build();
    struct projector *projector = virtual_station_projector(station);
    uint8_t *levels = calloc(SMALL_WIDTH, SMALL_HEIGHT);
    int64_t flip_ns;
    TEST_ASSERT_NOT_NULL(levels);
    memset(levels, 255, (size_t)SMALL_WIDTH * SMALL_HEIGHT);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, projector->ops->show(projector, levels, &flip_ns, &error));
    virtual_station_set_white_layer(station, 1);
    layer = expose(25000000).raw[PIXELS / 2];
    virtual_station_set_white_layer(station, 0);
    uint16_t sample = expose(25000000).raw[PIXELS / 2];
    /* Something real that is no mirror: it sends back light, and less than the layer. */
    TEST_ASSERT_TRUE(sample > 64 + 10);
    TEST_ASSERT_TRUE(sample < layer);
    free(levels);
}

static void sample_of_another_size_is_refused(void)
{
    settings.simulated.sample = (char[]){SAMPLES "/small.yaml"};
    settings.sample.width = SMALL_WIDTH + 1;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, virtual_station_new(&settings, &station, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "make them the same"), error.text);
    TEST_ASSERT_NULL(station);
}

static void sample_that_is_missing_is_refused(void)
{
    settings.simulated.sample = (char[]){"/nowhere/slab.yaml"};
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, virtual_station_new(&settings, &station, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "/nowhere/slab.yaml"), error.text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(devices_are_as_the_settings_say);
    RUN_TEST(white_layer_is_lambertian_of_its_reflectance);
    RUN_TEST(signal_grows_with_exposure_until_it_saturates);
    RUN_TEST(black_is_the_pedestal_and_with_contrast_the_black_level);
    RUN_TEST(time_passes_in_refreshes_exposures_and_readouts);
    RUN_TEST(frame_that_was_not_triggered_never_comes);
    RUN_TEST(noise_depends_on_pattern_and_seed_and_not_on_the_order);
    RUN_TEST(sample_is_seen_when_the_layer_is_off);
    RUN_TEST(sample_of_another_size_is_refused);
    RUN_TEST(sample_that_is_missing_is_refused);
    return UNITY_END();
}
