/* Tests of flips on vkms against the sums that it makes of every frame it sends. */
#include "rig/display_gl.h"
#include "rig/display_kms.h"

#include "guest.h"
#include "screen.h"
#include "unity.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { LEFT = 100, TOP = 200, WIDTH = 50, HEIGHT = 30, FLIPS = 12, SUMS = 4096 };

static struct screen screen;
static struct clock system_clock;
static struct nacre_error error;
static struct display *display;
static struct display_gl *gl;
static uint8_t levels[WIDTH * HEIGHT];
static struct {
    unsigned frame, sum;
} sums[SUMS];
static int sum_count;

void setUp(void)
{
    const struct display_region region = {LEFT, TOP, WIDTH, HEIGHT};
    error.text[0] = '\0';
    system_clock = clock_monotonic();
    screen = screen_plug("vkms", "vkms");
    const struct display_settings settings = {.device = screen.path, .mode = "640x480"};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, display_open(&settings, &system_clock, &display, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK,
                                  display_gl_new(display_file(display), display_name(display), 640,
                                                 480, &region, &gl, &error),
                                  error.text);
}

void tearDown(void)
{
    display_gl_free(gl);
    display_close(display);
    gl = NULL;
    display = NULL;
    screen_unplug(&screen);
}

static struct display_flip flip(uint8_t level, int64_t *drawing_ns)
{
    struct display_flip found = {.sequence = 0};
    uint32_t framebuffer = 0;
    memset(levels, level, sizeof levels);
    int64_t began_ns = clock_now_ns(&system_clock);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, display_gl_draw(gl, levels, &framebuffer, &error),
                                  error.text);
    *drawing_ns += clock_now_ns(&system_clock) - began_ns;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, display_flip(display, framebuffer, &found, &error),
                                  error.text);
    return found;
}

/* Read sums until there is one of this frame or a later one: then none before it is still being summed. */
static void read_sums_until(int file, unsigned frame)
{
    char line[64];
    int64_t end_ns = clock_now_ns(&system_clock) + 10000000000;
    while (sum_count == 0 || sums[sum_count - 1].frame < frame) {
        ssize_t size = read(file, line, sizeof line - 1);
        TEST_ASSERT_TRUE(clock_now_ns(&system_clock) < end_ns && sum_count < SUMS);
        if (size > 0) {
            char *rest = NULL;
            line[size] = '\0';
            sums[sum_count].frame = (unsigned)strtoul(line, &rest, 16);
            sums[sum_count++].sum = (unsigned)strtoul(rest, NULL, 16);
        } else {
            (void)usleep(2000);
        }
    }
}

/* The CRC-32 of so many pixels, of which vkms has 16 bits for each of alpha, red, green and blue. */
static unsigned add_pixels(unsigned sum, unsigned level, int count)
{
    for (int i = 0; i < count * 8; i++) {
        sum ^= i % 8 < 2 ? 0xff : level;
        for (int bit = 0; bit < 8; bit++) {
            sum = sum >> 1 ^ (sum & 1 ? 0xedb88320 : 0);
        }
    }
    return sum;
}

/* The sum of the frame whose region has the level. */
static unsigned sum_of(unsigned level)
{
    unsigned sum = add_pixels(0, 0, TOP * 640);
    for (int y = 0; y < HEIGHT; y++) {
        sum = add_pixels(sum, 0, LEFT);
        sum = add_pixels(sum, level, WIDTH);
        sum = add_pixels(sum, 0, 640 - LEFT - WIDTH);
    }
    return add_pixels(sum, 0, (480 - TOP - HEIGHT) * 640);
}

/* Every picture is sent from the refresh on that its flip tells until that of the next, and no other. */
static void flips_tell_the_refresh_that_sends_their_picture(void)
{
    struct display_flip flips[FLIPS];
    char path[96];
    int64_t drawing_ns = 0;
    int checked = 0;
    guest_run("mount -t debugfs none /sys/kernel/debug");
    (void)snprintf(path, sizeof path, "/sys/kernel/debug/dri/%.8s/crtc-0/crc/data",
                   strrchr(screen.path, '/') + strlen("/card"));
    (void)flip(9, &drawing_ns); /* sets the mode */
    int file = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    TEST_ASSERT_TRUE_MESSAGE(file >= 0, path);
    for (int i = 0; i < FLIPS; i++) {
        flips[i] = flip((uint8_t)(10 + 20 * i), &drawing_ns);
        TEST_ASSERT_TRUE(flips[i].counted);
        TEST_ASSERT_TRUE(i == 0 || flips[i].sequence > flips[i - 1].sequence);
        read_sums_until(file, flips[i].sequence);
    }
    (void)close(file);
    guest_run("umount /sys/kernel/debug");
    for (int i = 0; i < FLIPS; i++) {
        unsigned expected = sum_of(10 + 20 * (unsigned)i);
        int found = 0;
        for (int k = 0; k < sum_count; k++) {
            if (sums[k].frame >= flips[i].sequence &&
                (i == FLIPS - 1 || sums[k].frame < flips[i + 1].sequence)) {
                TEST_ASSERT_EQUAL_HEX32(expected, sums[k].sum);
                found++;
            }
        }
        TEST_ASSERT_TRUE(found > 0);
        checked += found;
    }
    (void)printf("vkms: %d flips matched with the sums of %d frames\n", FLIPS, checked);
}

/* Stamps and counts of flips agree with each other. */
static void stamps_go_with_the_count(void)
{
    int64_t drawing_ns = 0;
    struct display_flip last = flip(1, &drawing_ns);
    drawing_ns = 0;
    int64_t began_ns = clock_now_ns(&system_clock);
    for (int i = 0; i < 30; i++) {
        struct display_flip next = flip((uint8_t)i, &drawing_ns);
        int64_t refreshes = (int64_t)next.sequence - last.sequence;
        TEST_ASSERT_TRUE(refreshes >= 1);
        TEST_ASSERT_INT64_WITHIN(1000 + refreshes, refreshes * display_refresh_ns(display),
                                 next.stamp_ns - last.stamp_ns);
        last = next;
    }
    (void)printf("vkms: %.1f ms a flip of 640 x 480 pixels, %.1f of them for drawing\n",
                 (double)(clock_now_ns(&system_clock) - began_ns) * 1e-6 / 30,
                 (double)drawing_ns * 1e-6 / 30);
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    RUN_TEST(flips_tell_the_refresh_that_sends_their_picture);
    RUN_TEST(stamps_go_with_the_count);
    return UNITY_END();
}
