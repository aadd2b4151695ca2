/* Tests of the projector on vkms, which counts refreshes, and on bochs, which does not. */
#include "rig/projector_egl.h"

#include "guest.h"
#include "screen.h"
#include "unity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* An odd place and size, so that nothing is aligned by chance. */
enum { LEFT = 37, TOP = 21, WIDTH = 61, HEIGHT = 43, PIXELS = WIDTH * HEIGHT };
static struct screen screen;
static struct clock system_clock;
static struct nacre_error error;
static struct projector *projector;
static uint8_t levels[PIXELS];

void setUp(void)
{
    error.text[0] = '\0';
    system_clock = clock_monotonic();
    memset(levels, 0, sizeof levels);
    if (!screen.path[0]) {
        screen = screen_plug("vkms", "vkms");
    }
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

static int64_t must_show(void)
{
    int64_t flip_ns = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, projector->ops->show(projector, levels, &flip_ns, &error), error.text);
    return flip_ns;
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

static void all_levels_are_shown_exactly(void)
{
    struct projector_egl_settings chosen = settings();
    for (int i = 0; i < PIXELS; i++) {
        levels[i] = (uint8_t)(i % 256);
    }
    open_projector(&chosen);
    must_show();
    check_screen();
}

static void flips_are_stamped_in_whole_refreshes(void)
{
    struct projector_egl_settings chosen = settings();
    open_projector(&chosen);
    const struct projector_egl_info info = projector_egl_info(projector);
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
    }
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    RUN_TEST(all_levels_are_shown_exactly);
    RUN_TEST(flips_are_stamped_in_whole_refreshes);
    return UNITY_END();
}
