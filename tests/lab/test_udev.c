/* Tests of the udev rules with systemd's udevd. */
#include "gpio_sim.h"
#include "guest.h"
#include "rig/camera_v4l2.h"
#include "rig/projector_egl.h"
#include "rig/trigger_gpio.h"
#include "screen.h"
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
static const char display_link[] = "/dev/nacre/display";
static const char *const names[] = {"shutter", NULL};
static struct vivid webcam;
static struct gpio_sim chip;
static struct screen screen;
static struct clock system_clock;

void setUp(void)
{
    system_clock = clock_monotonic();
    webcam = vivid_plug("vivid", "");
    chip = gpio_sim_plug("lines", 2, names);
    screen = screen_plug("vkms", "vkms");
    guest_run("udevadm settle --timeout=20");
}

void tearDown(void)
{
    vivid_unplug(&webcam);
    gpio_sim_unplug(&chip);
    screen_unplug(&screen);
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
    check_link(display_link, "/dev/nacre/display-?*", screen.path);
}

static void links_go_with_their_devices(void)
{
    tearDown();
    TEST_ASSERT_EQUAL_INT(-1, access(camera_link, F_OK));
    TEST_ASSERT_EQUAL_INT(-1, access(gpio_link, F_OK));
    TEST_ASSERT_EQUAL_INT(-1, access(display_link, F_OK));
}

/* What opening each device came to. */
struct attempt {
    int status;
    struct nacre_error error;
};

static struct attempt try_camera(void)
{
    const struct camera_v4l2_settings settings = {.stream = {.device = camera_link,
                                                             .width = 320,
                                                             .height = 180,
                                                             .bayer = BAYER_RGGB,
                                                             .bits = 8},
                                                  .region = {0, 0, 320, 180},
                                                  .gain = -1};
    struct attempt attempt = {.error = {""}};
    struct camera *camera = NULL;
    attempt.status = camera_v4l2_new(&settings, &system_clock, &camera, &attempt.error);
    if (camera) {
        camera->ops->close(camera);
    }
    return attempt;
}

static struct attempt try_trigger(void)
{
    const struct trigger_gpio_settings settings = {.output = {.name = "shutter"},
                                                   .jitter_ns = 1000000};
    struct attempt attempt = {.error = {""}};
    struct trigger *trigger = NULL;
    attempt.status = trigger_gpio_new(&settings, &system_clock, &trigger, &attempt.error);
    if (trigger) {
        trigger->ops->close(trigger);
    }
    return attempt;
}

static struct attempt try_projector(void)
{
    const struct projector_egl_settings settings = {
        .display = {.device = display_link}, .region = {0, 0, 9, 7}, .period_ns = 1000000};
    struct attempt attempt = {.error = {""}};
    struct projector *projector = NULL;
    attempt.status = projector_egl_new(&settings, &system_clock, &projector, &attempt.error);
    if (projector) {
        projector->ops->close(projector);
    }
    return attempt;
}

/* Try all devices as another user. */
static void open_as(uid_t user, gid_t group, struct attempt attempts[3])
{
    TEST_ASSERT_EQUAL_INT(0, setegid(group));
    TEST_ASSERT_EQUAL_INT(0, seteuid(user));
    attempts[0] = try_camera();
    attempts[1] = try_trigger();
    attempts[2] = try_projector();
    TEST_ASSERT_EQUAL_INT(0, seteuid(0));
    TEST_ASSERT_EQUAL_INT(0, setegid(0));
}

static void group_may_use_the_devices(void)
{
    struct attempt attempts[3];
    open_as(NOBODY, GROUP, attempts);
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, attempts[i].status, attempts[i].error.text);
    }
}

static void others_may_not_and_are_told_the_remedy(void)
{
    static const char *const remedies[] = {"70-nacre-camera.rules, and be in the group nacre",
                                           "70-nacre-gpio.rules, and be in the group nacre",
                                           "70-nacre-display.rules, and be in the group nacre"};
    struct attempt attempts[3];
    open_as(NOBODY, NOBODY, attempts);
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, attempts[i].status);
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(attempts[i].error.text, remedies[i]),
                                     attempts[i].error.text);
    }
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
