/* Tests of the udev rules with systemd's udevd. */
#include "gpio_sim.h"
#include "guest.h"
#include "rig/camera_v4l2.h"
#include "rig/trigger_gpio.h"
#include "unity.h"
#include "vivid.h"

#include <fcntl.h>
#include <glob.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { GROUP = 4711, NOBODY = 65534 };
static const char camera_link[] = "/dev/nacre/camera";
static const char gpio_link[] = "/dev/nacre/gpio";
static const char *const names[] = {"shutter", NULL};
static struct vivid webcam;
static struct gpio_sim chip;
static struct clock system_clock;
static struct nacre_error error;

void setUp(void)
{
    error.text[0] = '\0';
    system_clock = clock_monotonic();
    webcam = vivid_plug("vivid", "");
    chip = gpio_sim_plug("lines", 2, names);
    guest_run("udevadm settle --timeout=20");
}

void tearDown(void)
{
    vivid_unplug(&webcam);
    gpio_sim_unplug(&chip);
    guest_run("udevadm settle --timeout=20");
}

/* What a link leads to, which is also reached by one with the device's place in its name. */
static void check_link(const char *link, const char *pattern, const char *device)
{
    char target[PATH_MAX];
    struct stat found;
    glob_t links;
    TEST_ASSERT_NOT_NULL_MESSAGE(realpath(link, target), link);
    TEST_ASSERT_EQUAL_STRING(device, target);
    TEST_ASSERT_EQUAL_INT(0, stat(link, &found));
    TEST_ASSERT_EQUAL_INT(GROUP, found.st_gid);
    TEST_ASSERT_EQUAL_HEX(0660, found.st_mode & 07777);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, glob(pattern, 0, NULL, &links), pattern);
    TEST_ASSERT_EQUAL_INT(1, links.gl_pathc);
    TEST_ASSERT_NOT_NULL(realpath(links.gl_pathv[0], target));
    globfree(&links);
    TEST_ASSERT_EQUAL_STRING(device, target);
}

static void devices_have_links_and_the_group(void)
{
    check_link(camera_link, "/dev/nacre/camera-?*", webcam.path);
    check_link(gpio_link, "/dev/nacre/gpio-?*", chip.path);
}

static void links_go_with_their_devices(void)
{
    tearDown();
    TEST_ASSERT_EQUAL_INT(-1, access(camera_link, F_OK));
    TEST_ASSERT_EQUAL_INT(-1, access(gpio_link, F_OK));
}

/* Try both devices as another user; writes what each came to. */
static void open_as(uid_t user, gid_t group, int *camera_status, int *trigger_status,
                    struct nacre_error *trigger_error)
{
    const struct camera_v4l2_settings camera_settings = {.stream = {.device = camera_link,
                                                                    .width = 320,
                                                                    .height = 180,
                                                                    .bayer = BAYER_RGGB,
                                                                    .bits = 8},
                                                         .region = {0, 0, 320, 180},
                                                         .gain = -1};
    const struct trigger_gpio_settings trigger_settings = {.output = {.name = "shutter"},
                                                           .jitter_ns = 1000000};
    struct camera *camera = NULL;
    struct trigger *trigger = NULL;
    TEST_ASSERT_EQUAL_INT(0, setegid(group));
    TEST_ASSERT_EQUAL_INT(0, seteuid(user));
    *camera_status = camera_v4l2_new(&camera_settings, &system_clock, &camera, &error);
    *trigger_status = trigger_gpio_new(&trigger_settings, &system_clock, &trigger, trigger_error);
    TEST_ASSERT_EQUAL_INT(0, seteuid(0));
    TEST_ASSERT_EQUAL_INT(0, setegid(0));
    if (camera) {
        camera->ops->close(camera);
    }
    if (trigger) {
        trigger->ops->close(trigger);
    }
}

static void group_may_use_the_devices(void)
{
    struct nacre_error trigger_error = {""};
    int camera_status;
    int trigger_status;
    open_as(NOBODY, GROUP, &camera_status, &trigger_status, &trigger_error);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera_status, error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, trigger_status, trigger_error.text);
}

static void others_may_not_and_are_told_the_remedy(void)
{
    struct nacre_error trigger_error = {""};
    int camera_status;
    int trigger_status;
    open_as(NOBODY, NOBODY, &camera_status, &trigger_status, &trigger_error);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, camera_status);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, trigger_status);
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "70-nacre-camera.rules, and be in the group nacre"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(trigger_error.text, "70-nacre-gpio.rules, and be in the group nacre"),
        trigger_error.text);
}

static void device_that_is_plugged_in_again_gets_its_link_again(void)
{
    tearDown();
    setUp();
    devices_have_links_and_the_group();
}

int main(void)
{
    guest_require();
    guest_run("echo nacre:x:%d: >>/etc/group && mkdir -p /run/udev/rules.d && cp %s/*.rules "
              "/run/udev/rules.d",
              GROUP, UDEV_RULES);
    guest_run("/lib/systemd/systemd-udevd --daemon");
    UNITY_BEGIN();
    RUN_TEST(devices_have_links_and_the_group);
    RUN_TEST(links_go_with_their_devices);
    RUN_TEST(group_may_use_the_devices);
    RUN_TEST(others_may_not_and_are_told_the_remedy);
    RUN_TEST(device_that_is_plugged_in_again_gets_its_link_again);
    return UNITY_END();
}
