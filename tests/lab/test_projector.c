/* Tests of the projector on vkms, which counts refreshes, and on bochs, which does not. */
#include "rig/projector_egl.h"

#include "guest.h"
#include "monitor.h"
#include "screen.h"
#include "unity.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <xf86drm.h>
#include <xf86drmMode.h>

/* An odd place and size, so that nothing is aligned by chance. */
enum { LEFT = 37, TOP = 21, WIDTH = 61, HEIGHT = 43, PIXELS = WIDTH * HEIGHT };
static const int64_t MS = 1000000;

static struct screen screen; /* on which the test is */
static struct clock system_clock;
static struct nacre_error error;
static struct projector *projector;
static uint8_t levels[PIXELS];

static void use(const char *module, const char *driver)
{
    if (strcmp(screen.module, module) != 0 || !screen.path[0]) {
        screen_unplug(&screen);
        screen = screen_plug(module, driver);
    }
}

void setUp(void)
{
    error.text[0] = '\0';
    system_clock = clock_monotonic();
    memset(levels, 0, sizeof levels);
    use("vkms", "vkms");
}

static void close_projector(void)
{
    if (projector) {
        projector->ops->close(projector);
        projector = NULL;
    }
}

void tearDown(void)
{
    close_projector();
}

static struct projector_egl_settings settings(void)
{
    return (struct projector_egl_settings){.display = {.device = screen.path, .mode = "1024x768"},
                                           .region = {LEFT, TOP, WIDTH, HEIGHT},
                                           .latency_ns = 0,
                                           .period_ns = 8333333};
}

static void open_projector(const struct projector_egl_settings *chosen)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, projector_egl_new(chosen, &system_clock, &projector, &error), error.text);
}

static void refuses(const struct projector_egl_settings *chosen, const char *text)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          projector_egl_new(chosen, &system_clock, &projector, &error));
    TEST_ASSERT_NULL(projector);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, text), error.text);
}

static int64_t must_show(void)
{
    int64_t flip_ns = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, projector->ops->show(projector, levels, &flip_ns, &error), error.text);
    return flip_ns;
}

static void fails_to_show(const char *text)
{
    int64_t flip_ns = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, projector->ops->show(projector, levels, &flip_ns, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, text), error.text);
}

static void check_screen(void)
{
    int width;
    int height;
    uint32_t *pixels = screen_read(&screen, &width, &height);
    TEST_ASSERT_EQUAL_INT(1024, width);
    TEST_ASSERT_EQUAL_INT(768, height);
    screen_check(pixels, width, height, levels, LEFT, TOP, WIDTH, HEIGHT);
    free(pixels);
}

/* What comes out of the emulated card's socket. */
static void check_signal(void)
{
    int width;
    int height;
    uint32_t *pixels = monitor_screen(&width, &height);
    TEST_ASSERT_EQUAL_INT(1024, width);
    TEST_ASSERT_EQUAL_INT(768, height);
    screen_check(pixels, width, height, levels, LEFT, TOP, WIDTH, HEIGHT);
    free(pixels);
}

static void fill(int kind)
{
    for (int i = 0; i < PIXELS; i++) {
        int x = i % WIDTH;
        int y = i / WIDTH;
        bool corner = (x == 0 || x == WIDTH - 1) && (y == 0 || y == HEIGHT - 1);
        int values[] = {i % 256,                            /* every level */
                        255,                                /* white */
                        x % 3 == 0 && y % 3 == 1 ? 255 : 0, /* a grid of single pixels */
                        x % 5 < 2 && y % 7 < 2 ? 200 : 1,   /* dots on almost black */
                        corner ? 255 : 0,
                        (x ^ y) & 1 ? 255 : 254};
        levels[i] = (uint8_t)values[kind];
    }
}
enum { KINDS = 6 };

static void every_pixel_is_exact_as_another_program_reads_it(void)
{
    struct projector_egl_settings chosen = settings();
    open_projector(&chosen);
    TEST_ASSERT_EQUAL_INT(WIDTH, projector->width);
    TEST_ASSERT_EQUAL_INT(HEIGHT, projector->height);
    TEST_ASSERT_EQUAL_INT64(8333333, projector->period_ns);
    check_screen(); /* black */
    for (int kind = 0; kind < KINDS; kind++) {
        fill(kind);
        (void)must_show();
        check_screen();
    }
}

static void regions_reach_the_edges_of_the_picture(void)
{
    struct projector_egl_settings chosen = settings();
    static const int corners[][2] = {{0, 0}, {1024 - WIDTH, 768 - HEIGHT}};
    for (int i = 0; i < 2; i++) {
        int width;
        int height;
        chosen.region.left = corners[i][0];
        chosen.region.top = corners[i][1];
        open_projector(&chosen);
        fill(0);
        (void)must_show();
        uint32_t *pixels = screen_read(&screen, &width, &height);
        screen_check(pixels, width, height, levels, corners[i][0], corners[i][1], WIDTH, HEIGHT);
        free(pixels);
        close_projector();
    }
}

static void flips_are_stamped_in_whole_refreshes(void)
{
    struct projector_egl_settings chosen = settings();
    open_projector(&chosen);
    const struct projector_egl_info info = projector_egl_info(projector);
    int64_t all = 0;
    TEST_ASSERT_TRUE(info.counted);
    TEST_ASSERT_EQUAL_STRING("1024x768@60.004", info.mode);
    int64_t last_ns = must_show();
    for (int i = 0; i < 40; i++) {
        int64_t before_ns = clock_now_ns(&system_clock);
        int64_t flip_ns = must_show();
        int64_t refreshes = llround((double)(flip_ns - last_ns) / (double)info.refresh_ns);
        /* Stamps are in whole microseconds, and the refresh is known to a nanosecond. */
        TEST_ASSERT_TRUE(refreshes >= 1);
        TEST_ASSERT_INT64_WITHIN(1000 + refreshes, refreshes * info.refresh_ns, flip_ns - last_ns);
        TEST_ASSERT_TRUE(flip_ns >= before_ns - info.refresh_ns);
        TEST_ASSERT_TRUE(flip_ns <= clock_now_ns(&system_clock));
        last_ns = flip_ns;
        all += refreshes;
    }
    (void)printf("vkms: 40 patterns in %d refreshes of %.3f ms\n", (int)all,
                 (double)info.refresh_ns * 1e-6);
}

static void latency_is_waited_for_and_told(void)
{
    struct projector_egl_settings chosen = settings();
    chosen.latency_ns = 70 * MS;
    open_projector(&chosen);
    int64_t before_ns = clock_now_ns(&system_clock);
    int64_t flip_ns = must_show();
    TEST_ASSERT_TRUE(flip_ns >= before_ns + 70 * MS - projector_egl_info(projector).refresh_ns);
    TEST_ASSERT_TRUE(clock_now_ns(&system_clock) >= flip_ns);
}

static void driver_that_counts_no_refreshes_gets_one_more(void)
{
    use("bochs", "bochs-drm");
    struct projector_egl_settings chosen = settings();
    open_projector(&chosen);
    const struct projector_egl_info info = projector_egl_info(projector);
    TEST_ASSERT_FALSE(info.counted);
    int64_t began_ns = clock_now_ns(&system_clock);
    for (int i = 0; i < 10; i++) {
        int64_t before_ns = clock_now_ns(&system_clock);
        int64_t flip_ns = must_show();
        TEST_ASSERT_TRUE(flip_ns >= before_ns + info.refresh_ns);
        TEST_ASSERT_TRUE(flip_ns <= clock_now_ns(&system_clock));
    }
    (void)printf("bochs: %.1f ms a pattern, of which %.1f are a refresh of doubt\n",
                 (double)(clock_now_ns(&system_clock) - began_ns) * 1e-7,
                 (double)info.refresh_ns * 1e-6);
}

static void every_pixel_is_exact_in_what_the_card_sends(void)
{
    use("bochs", "bochs-drm");
    struct projector_egl_settings chosen = settings();
    open_projector(&chosen);
    for (int kind = 0; kind < KINDS; kind++) {
        fill(kind);
        (void)must_show();
        check_signal();
        check_screen();
    }
}

/* A program that has the display open, and has taken it if it `takes`, until it is ended. */
static pid_t hold(const char *name, bool takes)
{
    int ready[2];
    char byte = 0;
    TEST_ASSERT_EQUAL_INT(0, pipe(ready));
    pid_t child = fork();
    if (child == 0) {
        (void)prctl(PR_SET_NAME, name);
        int file = open(screen.path, O_RDWR);
        byte = (char)(file >= 0 && (takes ? drmSetMaster(file) : drmDropMaster(file)) == 0);
        (void)!write(ready[1], &byte, 1);
        for (;;) {
            (void)pause();
        }
    }
    TEST_ASSERT_EQUAL_INT(1, read(ready[0], &byte, 1));
    TEST_ASSERT_EQUAL_INT(1, byte);
    (void)close(ready[0]);
    (void)close(ready[1]);
    return child;
}

static void display_that_another_program_has_is_refused_and_the_program_named(void)
{
    struct projector_egl_settings chosen = settings();
    char expected[96];
    /* Session managers have every display open, but for others. */
    pid_t manager = hold("systemd-logind", false);
    pid_t child = hold("holder", true);
    (void)snprintf(expected, sizeof expected, "projector %s: is in use by holder (process %d)",
                   screen.path, (int)child);
    refuses(&chosen, expected);
    TEST_ASSERT_EQUAL_INT(0, kill(child, SIGKILL));
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, NULL, 0));
    open_projector(&chosen);
    TEST_ASSERT_EQUAL_INT(0, kill(manager, SIGKILL));
    TEST_ASSERT_EQUAL_INT(manager, waitpid(manager, NULL, 0));
}

static void what_the_card_or_the_projector_does_not_have_is_told(void)
{
    struct projector_egl_settings chosen = settings();
    chosen.display.connector = "HDMI-A-1";
    refuses(&chosen, "projector HDMI-A-1: the graphics card /dev/dri/card");
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "it has Virtual-1"), error.text);
    chosen.display.device = NULL;
    refuses(&chosen,
            "projector HDMI-A-1: no graphics card has such a connector; there are Virtual-1");
    chosen = settings();
    chosen.display.mode = "1024x769";
    refuses(&chosen, "projector Virtual-1: has no mode 1024x769; it has ");
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "1024x768@60.004"), error.text);
    chosen.display.mode = "1024x768@75";
    refuses(&chosen, "has no mode 1024x768@75");
}

static void regions_beyond_the_picture_are_refused(void)
{
    struct projector_egl_settings chosen = settings();
    chosen.region.left = 1024 - WIDTH + 1;
    refuses(&chosen,
            "61 x 43 pixels from (964, 21) on do not lie in its picture of 1024x768@60.004");
    chosen = settings();
    chosen.region.height = 769;
    refuses(&chosen, "do not lie in its picture");
}

static void nodes_that_are_no_display_are_told(void)
{
    struct projector_egl_settings chosen = settings();
    chosen.display.device = "/dev/dri/card7";
    refuses(&chosen, "projector /dev/dri/card7: is not there");
    chosen.display.device =
        "/dev/nacre/display-pci-0000:00:14.0-usb-0:2.1.4.3.2:1.0-or-even-longer";
    refuses(&chosen, "usb-0:2.1.4.3.2:1.0-or-even-longer: is not there");
    chosen.display.device = "/dev/null";
    refuses(&chosen, "projector /dev/null: is no graphics card that sets modes");
}

static void display_that_may_not_be_opened_is_told_with_the_remedy(void)
{
    struct projector_egl_settings chosen = settings();
    TEST_ASSERT_EQUAL_INT(0, chmod(screen.path, 0600));
    TEST_ASSERT_EQUAL_INT(0, seteuid(65534));
    int status = projector_egl_new(&chosen, &system_clock, &projector, &error);
    struct nacre_error any = {""};
    chosen.display.device = NULL;
    int any_status = projector_egl_new(&chosen, &system_clock, &projector, &any);
    TEST_ASSERT_EQUAL_INT(0, seteuid(0));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "may not be opened; install udev/70-nacre-display.rules"), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, any_status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(any.text, "may not be opened"), any.text);
}

static void connected_display_is_found_without_being_named(void)
{
    struct projector_egl_settings chosen = settings();
    chosen.display.device = NULL;
    open_projector(&chosen);
    TEST_ASSERT_NOT_NULL(
        strstr(projector_egl_info(projector).name, "projector Virtual-1 (/dev/dri/card"));
}

static void projector_that_is_not_connected_is_told(void)
{
    struct projector_egl_settings chosen = settings();
    guest_write(screen.status, "off");
    refuses(&chosen, "nothing is connected to Virtual-1; plug the projector in and turn it on");
    chosen.display.connector = "Virtual-1";
    refuses(&chosen, "projector Virtual-1: nothing is connected to it");
    chosen.display.connector = NULL;
    chosen.display.device = NULL;
    refuses(&chosen, "projector: none is connected; there are Virtual-1 of");
    guest_write(screen.status, "on");
    open_projector(&chosen);
}

static void projector_that_is_unplugged_is_told_until_it_is_back(void)
{
    struct projector_egl_settings chosen = settings();
    open_projector(&chosen);
    fill(2);
    (void)must_show();
    TEST_ASSERT_EQUAL_INT(NACRE_OK, projector->ops->confirm(projector, &error));
    guest_write(screen.status, "off");
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, projector->ops->confirm(projector, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "was unplugged; plug it in again"), error.text);
    error.text[0] = '\0';
    fails_to_show("was unplugged; plug it in again");
    fails_to_show("was unplugged; plug it in again");
    guest_write(screen.status, "on");
    fill(3);
    (void)must_show();
    check_screen();
    TEST_ASSERT_EQUAL_INT(NACRE_OK, projector->ops->confirm(projector, &error));
}

/* As root another program may, with our consent or not. */
static void picture_of_another_program_is_noticed(void)
{
    struct projector_egl_settings chosen = settings();
    open_projector(&chosen);
    (void)must_show();
    screen_dark(&screen);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, projector->ops->confirm(projector, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "another program has put its own picture there"), error.text);
    fill(1);
    (void)must_show();
    check_screen();
}

static void former_picture_is_back_after_closing(void)
{
    struct projector_egl_settings chosen = settings();
    int width;
    int height;
    guest_write("/sys/class/graphics/fbcon/cursor_blink", "0");
    uint32_t *before = screen_read(&screen, &width, &height);
    chosen.display.mode = "800x600";
    chosen.region = (struct display_region){0, 0, WIDTH, HEIGHT};
    open_projector(&chosen);
    (void)must_show();
    int shown_width;
    int shown_height;
    uint32_t *shown = screen_read(&screen, &shown_width, &shown_height);
    TEST_ASSERT_EQUAL_INT(800, shown_width);
    TEST_ASSERT_EQUAL_INT(600, shown_height);
    free(shown);
    close_projector();
    shown = screen_read(&screen, &shown_width, &shown_height);
    TEST_ASSERT_EQUAL_INT(width, shown_width);
    TEST_ASSERT_EQUAL_INT(height, shown_height);
    TEST_ASSERT_EQUAL_INT(0, memcmp(before, shown, (size_t)width * (size_t)height * sizeof *shown));
    free(shown);
    free(before);
}

static void colour_tables_are_straight_while_it_is_open_and_as_before_afterwards(void)
{
    use("vkms-colour", "vkms");
    struct projector_egl_settings chosen = settings();
    struct drm_color_lut table[256];
    for (int i = 0; i < 256; i++) {
        uint16_t value = (uint16_t)(i * i);
        table[i] = (struct drm_color_lut){value, value, value, 0};
    }
    screen_set_bytes(&screen, "GAMMA_LUT", table, sizeof table);
    screen_set(&screen, "max bpc", 6);
    size_t size = 0;
    open_projector(&chosen);
    TEST_ASSERT_EQUAL_UINT64(0, screen_get(&screen, "GAMMA_LUT"));
    TEST_ASSERT_EQUAL_UINT64(8, screen_get(&screen, "max bpc"));
    TEST_ASSERT_EQUAL_UINT64(1, screen_get(&screen, "Broadcast RGB"));
    /* This driver refuses to change one. */
    TEST_ASSERT_EQUAL_UINT64(1, screen_get(&screen, "dithering mode"));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(projector_egl_info(projector).remarks,
                                        "its driver does not change \"dithering mode\" (Invalid "
                                        "argument): levels may be dithered"),
                                 projector_egl_info(projector).remarks);
    TEST_ASSERT_NULL(strstr(projector_egl_info(projector).remarks, "Broadcast RGB"));
    close_projector();
    void *back = screen_get_bytes(&screen, "GAMMA_LUT", &size);
    TEST_ASSERT_EQUAL_UINT64(sizeof table, size);
    TEST_ASSERT_EQUAL_MEMORY(table, back, sizeof table);
    free(back);
    TEST_ASSERT_EQUAL_UINT64(6, screen_get(&screen, "max bpc"));
    TEST_ASSERT_EQUAL_UINT64(0, screen_get(&screen, "Broadcast RGB"));
}

static void driver_without_a_range_is_remarked(void)
{
    struct projector_egl_settings chosen = settings();
    open_projector(&chosen);
    TEST_ASSERT_NOT_NULL(strstr(projector_egl_info(projector).remarks, "has no \"Broadcast RGB\""));
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    RUN_TEST(every_pixel_is_exact_as_another_program_reads_it);
    RUN_TEST(regions_reach_the_edges_of_the_picture);
    RUN_TEST(flips_are_stamped_in_whole_refreshes);
    RUN_TEST(latency_is_waited_for_and_told);
    RUN_TEST(display_that_another_program_has_is_refused_and_the_program_named);
    RUN_TEST(what_the_card_or_the_projector_does_not_have_is_told);
    RUN_TEST(regions_beyond_the_picture_are_refused);
    RUN_TEST(nodes_that_are_no_display_are_told);
    RUN_TEST(display_that_may_not_be_opened_is_told_with_the_remedy);
    RUN_TEST(connected_display_is_found_without_being_named);
    RUN_TEST(projector_that_is_not_connected_is_told);
    RUN_TEST(projector_that_is_unplugged_is_told_until_it_is_back);
    RUN_TEST(picture_of_another_program_is_noticed);
    RUN_TEST(former_picture_is_back_after_closing);
    RUN_TEST(driver_without_a_range_is_remarked);
    RUN_TEST(colour_tables_are_straight_while_it_is_open_and_as_before_afterwards);
    RUN_TEST(driver_that_counts_no_refreshes_gets_one_more);
    RUN_TEST(every_pixel_is_exact_in_what_the_card_sends);
    return UNITY_END();
}
