/* Tests of listing devices, by `nacre devices`. */
#include "gpio_sim.h"
#include "guest.h"
#include "rig/trigger_gpio.h"
#include "screen.h"
#include "unity.h"
#include "vivid.h"

#include <jansson.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

static const char *const names[] = {"shutter", NULL};
/* No OpenCL: its libraries take long to load here. */
static const char command[] = "env OCL_ICD_VENDORS=/nowhere " NACRE " devices";
static struct vivid webcam;
static struct gpio_sim chip;
static struct screen screen;

void setUp(void)
{
    webcam = vivid_plug("vivid", "");
    chip = gpio_sim_plug("lines", 3, names);
    screen = screen_plug("vkms", "vkms");
}

void tearDown(void)
{
    vivid_unplug(&webcam);
    gpio_sim_unplug(&chip);
    screen_unplug(&screen);
}

static json_t *list(void)
{
    char line[256];
    json_error_t fault;
    (void)snprintf(line, sizeof line, "%s --json", command);
    /* NOLINTNEXTLINE(cert-env33-c): a shell is what is wanted */
    FILE *output = popen(line, "r");
    TEST_ASSERT_NOT_NULL(output);
    json_t *root = json_loadf(output, 0, &fault);
    TEST_ASSERT_EQUAL_INT(0, pclose(output));
    TEST_ASSERT_NOT_NULL_MESSAGE(root, fault.text);
    return root;
}

/* The entry of a list whose `key` is the text. */
static json_t *find(const json_t *entries, const char *key, const char *text)
{
    size_t i;
    json_t *entry;
    json_array_foreach(entries, i, entry)
    {
        const char *value = json_string_value(json_object_get(entry, key));
        if (value && strcmp(value, text) == 0) {
            return entry;
        }
    }
    TEST_FAIL_MESSAGE(text);
    return NULL;
}

static void cameras_are_listed_with_their_raw_formats(void)
{
    json_t *root = list();
    const json_t *camera = find(json_object_get(root, "cameras"), "device", webcam.path);
    const json_t *formats = json_object_get(camera, "formats");
    /* vivid has four orders of 8, 10, 12 and 16 bits, and grey of 8, 10, 12 and 16. */
    TEST_ASSERT_TRUE(json_array_size(formats) >= 16);
    const json_t *format = find(formats, "code", "RG10");
    TEST_ASSERT_EQUAL_STRING("RGGB", json_string_value(json_object_get(format, "bayer")));
    TEST_ASSERT_EQUAL_INT(10, json_integer_value(json_object_get(format, "bits")));
    TEST_ASSERT_EQUAL_STRING("vivid", json_string_value(json_object_get(camera, "card")));
    json_decref(root);
}

static void displays_are_listed_with_connectors_and_modes(void)
{
    guest_write(screen.status, "off");
    json_t *root = list();
    const json_t *card = find(json_object_get(root, "displays"), "device", screen.path);
    TEST_ASSERT_EQUAL_STRING("vkms", json_string_value(json_object_get(card, "driver")));
    const json_t *connector = find(json_object_get(card, "connectors"), "name", "Virtual-1");
    TEST_ASSERT_TRUE(json_is_false(json_object_get(connector, "connected")));
    TEST_ASSERT_EQUAL_INT(0, json_array_size(json_object_get(connector, "modes")));
    json_decref(root);
    guest_write(screen.status, "on");
    root = list();
    card = find(json_object_get(root, "displays"), "device", screen.path);
    connector = find(json_object_get(card, "connectors"), "name", "Virtual-1");
    TEST_ASSERT_TRUE(json_is_true(json_object_get(connector, "connected")));
    bool there = false;
    size_t i;
    json_t *mode;
    json_array_foreach(json_object_get(connector, "modes"), i, mode)
    {
        there = there || strcmp(json_string_value(mode), "1024x768@60.004") == 0;
    }
    TEST_ASSERT_TRUE(there);
    json_decref(root);
}

static void lines_are_listed_with_names_and_holders(void)
{
    const struct trigger_gpio_settings settings = {.output = {.name = "shutter"},
                                                   .jitter_ns = 1000000};
    struct clock clock = clock_monotonic();
    struct trigger *trigger = NULL;
    struct nacre_error error;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger_gpio_new(&settings, &clock, &trigger, &error));
    json_t *root = list();
    trigger->ops->close(trigger);
    const json_t *listed = find(json_object_get(root, "gpio_chips"), "device", chip.path);
    const json_t *lines = json_object_get(listed, "lines");
    TEST_ASSERT_EQUAL_INT(3, json_array_size(lines));
    const json_t *line = json_array_get(lines, 0);
    TEST_ASSERT_EQUAL_STRING("shutter", json_string_value(json_object_get(line, "name")));
    TEST_ASSERT_EQUAL_STRING("nacre", json_string_value(json_object_get(line, "holder")));
    line = json_array_get(lines, 1);
    TEST_ASSERT_EQUAL_STRING("", json_string_value(json_object_get(line, "name")));
    TEST_ASSERT_EQUAL_STRING("", json_string_value(json_object_get(line, "holder")));
    json_decref(root);
}

static void people_read_the_same(void)
{
    guest_run("%s >/run/list", command);
    guest_run("grep -q '^  %s  vivid: .*RGGB 10 bits (RG10)' /run/list", webcam.path);
    guest_run("grep -q '^    Virtual-1  connected: .*1024x768@60.004 (preferred)' /run/list");
    guest_run("grep -q '^  %s  .*, 3 lines: 0 shutter$' /run/list", chip.path);
}

static void devices_that_may_not_be_opened_are_listed_with_the_reason(void)
{
    TEST_ASSERT_EQUAL_INT(0, chmod(webcam.path, 0600));
    TEST_ASSERT_EQUAL_INT(0, chmod(chip.path, 0600));
    TEST_ASSERT_EQUAL_INT(0, chmod(screen.path, 0600));
    guest_run(
        "setpriv --reuid=65534 --regid=65534 --clear-groups env HOME=/run %s --json >/run/list",
        command);
    guest_run(
        "grep -q 'camera %s: may not be opened; install udev/70-nacre-camera.rules' /run/list",
        webcam.path);
    guest_run("grep -q 'chip %s: may not be opened; install udev/70-nacre-gpio.rules' /run/list",
              chip.path);
    guest_run(
        "grep -q 'projector %s: may not be opened; install udev/70-nacre-display.rules' /run/list",
        screen.path);
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    RUN_TEST(cameras_are_listed_with_their_raw_formats);
    RUN_TEST(displays_are_listed_with_connectors_and_modes);
    RUN_TEST(lines_are_listed_with_names_and_holders);
    RUN_TEST(people_read_the_same);
    RUN_TEST(devices_that_may_not_be_opened_are_listed_with_the_reason);
    return UNITY_END();
}
