/* Tests of exposure and gain by controls, on devices with the controls of real ones. */
#include "rig/camera_exposure.h"

#include "unity.h"

#include <errno.h>
#include <linux/v4l2-controls.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

struct control {
    uint32_t id; /* 0: the end */
    struct camera_control_range range;
    int64_t value;
    bool read_only;
};

/* A device; as with image sensors, an exposure ends before its frame. */
struct device {
    struct camera_controls base;
    struct control *controls;
    int rows; /* of a frame; 0: exposures do not depend on it */
};

static struct nacre_error error;

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
}

static struct control *find(struct camera_controls *controls, uint32_t id)
{
    struct control *control = ((struct device *)controls)->controls;
    while (control->id != 0 && control->id != id) {
        control++;
    }
    return control->id ? control : NULL;
}

static int query(struct camera_controls *controls, uint32_t id, struct camera_control_range *range)
{
    const struct device *device = (const struct device *)controls;
    const struct control *control = find(controls, id);
    if (!control) {
        return EINVAL;
    }
    *range = control->range;
    if (id == V4L2_CID_EXPOSURE && device->rows > 0) {
        range->maximum = device->rows + find(controls, V4L2_CID_VBLANK)->value - 4;
    }
    return 0;
}

static int get(struct camera_controls *controls, uint32_t id, int64_t *value)
{
    const struct control *control = find(controls, id);
    *value = control ? control->value : 0;
    return control ? 0 : EINVAL;
}

static int set(struct camera_controls *controls, uint32_t id, int64_t value)
{
    struct camera_control_range range = {0};
    struct control *control = find(controls, id);
    if (!control) {
        return EINVAL;
    }
    if (control->read_only) {
        return EACCES;
    }
    (void)query(controls, id, &range);
    if (value < range.minimum || value > range.maximum) {
        return ERANGE;
    }
    control->value = value - (value - range.minimum) % range.step;
    return 0;
}

static const struct camera_controls_ops ops = {query, get, set};

/* 1456 x 1088 pixels at 118.8 MHz, 304 pixels of blanking: a row takes 1760 / 118.8 us = 14.814 us. */
static struct control sensor[] = {{V4L2_CID_PIXEL_RATE, {118800000, 118800000, 1}, 118800000, true},
                                  {V4L2_CID_HBLANK, {304, 304, 1}, 304, true},
                                  {V4L2_CID_VBLANK, {30, 1000000, 1}, 30, false},
                                  {V4L2_CID_EXPOSURE, {1, 1000, 1}, 1000, false},
                                  {V4L2_CID_ANALOGUE_GAIN, {0, 480, 1}, 0, false},
                                  {0, {0, 0, 0}, 0, false}};
/* As USB cameras have it. */
static struct control usb[] = {{V4L2_CID_EXPOSURE_AUTO, {0, 3, 1}, 3, false},
                               {V4L2_CID_AUTO_WHITE_BALANCE, {0, 1, 1}, 1, false},
                               {V4L2_CID_EXPOSURE_ABSOLUTE, {1, 5000, 5}, 157, false},
                               {V4L2_CID_GAIN, {16, 64, 1}, 32, false},
                               {0, {0, 0, 0}, 0, false}};
static struct control bare[] = {{V4L2_CID_EXPOSURE, {0, 255, 1}, 3, false},
                                {0, {0, 0, 0}, 0, false}};
static struct control stubborn[] = {{V4L2_CID_EXPOSURE_AUTO, {0, 3, 1}, 3, true},
                                    {0, {0, 0, 0}, 0, false}};

static struct camera_exposure find_exposure(struct device *device)
{
    struct camera_exposure exposure;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, camera_exposure_find(&device->base, 1456, 1088, &exposure, &error), error.text);
    return exposure;
}

static void sensors_count_in_rows(void)
{
    struct device device = {{&ops}, sensor, 1088};
    struct camera_exposure exposure = find_exposure(&device);
    TEST_ASSERT_EQUAL_INT(V4L2_CID_EXPOSURE, exposure.id);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 14814.81, exposure.unit_ns);
    /* 10 ms are 675 rows exactly; the frame need not be longer. */
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera_exposure_set(&exposure, 10000000, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT(675, sensor[3].value);
    TEST_ASSERT_EQUAL_INT(30, sensor[2].value);
}

static void long_exposures_stretch_the_frame(void)
{
    struct device device = {{&ops}, sensor, 1088};
    struct camera_exposure exposure = find_exposure(&device);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera_exposure_set(&exposure, 500000000, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT(33750, sensor[3].value);
    TEST_ASSERT_TRUE(sensor[2].value + 1088 > 33750);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera_exposure_set(&exposure, 2000000, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT(30, sensor[2].value);
}

static void usb_cameras_count_in_a_tenth_of_a_millisecond(void)
{
    struct device device = {{&ops}, usb, 0};
    struct camera_exposure exposure = find_exposure(&device);
    TEST_ASSERT_EQUAL_INT(V4L2_CID_EXPOSURE_ABSOLUTE, exposure.id);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera_exposure_set(&exposure, 133333333, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT(1331, usb[2].value);
}

static void what_works_by_itself_is_turned_off(void)
{
    struct device device = {{&ops}, usb, 0};
    usb[0].value = 3;
    usb[1].value = 1;
    (void)find_exposure(&device);
    TEST_ASSERT_EQUAL_INT(V4L2_EXPOSURE_MANUAL, usb[0].value);
    TEST_ASSERT_EQUAL_INT(0, usb[1].value);
}

static void automatic_exposure_that_stays_on_is_refused(void)
{
    struct device device = {{&ops}, stubborn, 0};
    struct camera_exposure exposure;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          camera_exposure_find(&device.base, 640, 480, &exposure, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "automatic exposure cannot be turned off"),
                                 error.text);
}

static void exposures_that_are_not_to_be_had_are_refused(void)
{
    struct device camera = {{&ops}, usb, 0};
    struct device chip = {{&ops}, sensor, 1088};
    struct camera_exposure exposure = find_exposure(&camera);
    /* Steps of 0.5 ms from 0.1 ms on: 0.8 ms becomes 0.6 ms. */
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera_exposure_set(&exposure, 800000, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "0.8000 ms is not to be had, the nearest is 0.6000 ms"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "0.1000 to 500.0000 ms"), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera_exposure_set(&exposure, 2000000000, &error));
    exposure = find_exposure(&chip);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera_exposure_set(&exposure, 100000000000, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "exposure_turns"), error.text);
}

static void exposure_without_a_known_unit_counts_for_none(void)
{
    struct device device = {{&ops}, bare, 0};
    TEST_ASSERT_EQUAL_INT(0, find_exposure(&device).id);
}

static void gain_is_set_within_its_range(void)
{
    struct device chip = {{&ops}, sensor, 1088};
    struct device camera = {{&ops}, usb, 0};
    struct device nothing = {{&ops}, bare, 0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera_exposure_set_gain(&chip.base, 120, &error));
    TEST_ASSERT_EQUAL_INT(120, sensor[4].value);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera_exposure_set_gain(&camera.base, 16, &error));
    TEST_ASSERT_EQUAL_INT(16, usb[3].value);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera_exposure_set_gain(&camera.base, 15, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "gain 15 is outside its range 16 to 64"),
                                 error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera_exposure_set_gain(&nothing.base, 1, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no control for the gain"), error.text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(sensors_count_in_rows);
    RUN_TEST(long_exposures_stretch_the_frame);
    RUN_TEST(usb_cameras_count_in_a_tenth_of_a_millisecond);
    RUN_TEST(what_works_by_itself_is_turned_off);
    RUN_TEST(automatic_exposure_that_stays_on_is_refused);
    RUN_TEST(exposures_that_are_not_to_be_had_are_refused);
    RUN_TEST(exposure_without_a_known_unit_counts_for_none);
    RUN_TEST(gain_is_set_within_its_range);
    return UNITY_END();
}
