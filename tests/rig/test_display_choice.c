/* Tests of choosing a card, a connector and a mode from lists. */
#include "rig/display_choice.h"

#include "unity.h"

#include <limits.h>
#include <string.h>

static struct nacre_error error;

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
}

/* A mode of CEA-861 or the like: clock in kHz, active and total sizes. */
static struct display_mode mode(uint32_t clock, uint16_t width, uint16_t total_width,
                                uint16_t height, uint16_t total_height, uint32_t flags,
                                uint32_t type)
{
    const drmModeModeInfo timing = {.clock = clock,
                                    .hdisplay = width,
                                    .htotal = total_width,
                                    .vdisplay = height,
                                    .vtotal = total_height,
                                    .flags = flags,
                                    .type = type};
    return display_mode_of(&timing);
}

enum { FULL_HD_INTERLACED, HD, FULL_HD, FULL_HD_NTSC, XGA, DOUBLED, MODES };

static struct display_mode modes[MODES];
static struct display_connector connectors[3];
static struct display_card card;

static void make_card(void)
{
    modes[FULL_HD_INTERLACED] = mode(74250, 1920, 2200, 1080, 1125, DRM_MODE_FLAG_INTERLACE, 0);
    modes[HD] = mode(74250, 1280, 1650, 720, 750, 0, 0);
    modes[FULL_HD] = mode(148500, 1920, 2200, 1080, 1125, 0, DRM_MODE_TYPE_PREFERRED);
    modes[FULL_HD_NTSC] = mode(148352, 1920, 2200, 1080, 1125, 0, 0);
    modes[XGA] = mode(65000, 1024, 1344, 768, 806, 0, 0);
    modes[DOUBLED] = mode(13500, 640, 858, 240, 262, DRM_MODE_FLAG_DBLSCAN, 0);
    connectors[0] = (struct display_connector){.id = 11, .name = "eDP-1"};
    connectors[1] = (struct display_connector){
        .id = 12, .name = "HDMI-A-1", .connected = true, .modes = modes, .mode_count = MODES};
    connectors[2] = (struct display_connector){.id = 13, .name = "DP-1"};
    card = (struct display_card){
        .path = "/dev/dri/card0", .connectors = connectors, .connector_count = 3};
}

static void modes_are_read(void)
{
    struct display_mode_wish wish;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, display_mode_parse("1920x1080@59.94", &wish, &error));
    TEST_ASSERT_EQUAL_INT(1920, wish.width);
    TEST_ASSERT_EQUAL_INT(1080, wish.height);
    TEST_ASSERT_EQUAL_DOUBLE(59.94, wish.refresh_hz);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, display_mode_parse("800x600", &wish, &error));
    TEST_ASSERT_EQUAL_INT(600, wish.height);
    TEST_ASSERT_EQUAL_DOUBLE(0, wish.refresh_hz);
}

static void what_is_no_mode_is_refused(void)
{
    static const char *const texts[] = {"",
                                        "1920",
                                        "x1080",
                                        "1920x",
                                        "1920*1080",
                                        "0x1080",
                                        "1920x0",
                                        "-1920x1080",
                                        "1920x-1080",
                                        "1920x1080@",
                                        "1920x1080@zero",
                                        "1920x1080@0",
                                        "40000x9",
                                        "1920x1080@-60",
                                        "1920x1080@60Hz",
                                        "1920x1080i",
                                        " 1920x1080",
                                        "1920x1080@nan",
                                        "99999999999999999999x1"};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        struct display_mode_wish wish;
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_FAILED, display_mode_parse(texts[i], &wish, &error),
                                      texts[i]);
        TEST_ASSERT_NOT_NULL(strstr(error.text, "is no mode; write it as 1920x1080"));
    }
}

static void refresh_is_told_from_the_timings(void)
{
    char text[DISPLAY_MODE_TEXT];
    make_card();
    TEST_ASSERT_EQUAL_DOUBLE(60, modes[FULL_HD].refresh_hz);
    TEST_ASSERT_EQUAL_DOUBLE(60, modes[FULL_HD_INTERLACED].refresh_hz); /* fields */
    /* 65 MHz / (1344 * 806) */
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 60.00384, modes[XGA].refresh_hz);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 30.0272, modes[DOUBLED].refresh_hz);
    display_mode_print(&modes[FULL_HD_NTSC], text);
    TEST_ASSERT_EQUAL_STRING("1920x1080@59.94", text);
    display_mode_print(&modes[FULL_HD], text);
    TEST_ASSERT_EQUAL_STRING("1920x1080@60", text);
}

/* What is printed finds the same mode again. */
static void every_mode_is_found_by_its_text(void)
{
    make_card();
    for (size_t i = 0; i < MODES; i++) {
        char text[DISPLAY_MODE_TEXT];
        size_t chosen = MODES;
        display_mode_print(&modes[i], text);
        int status = display_choose_mode(&connectors[1], text, &chosen, &error);
        if (i == FULL_HD_INTERLACED) {
            TEST_ASSERT_EQUAL_INT(NACRE_OK, status);
            TEST_ASSERT_EQUAL_INT(FULL_HD, chosen);
        } else if (i == DOUBLED) {
            TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
        } else {
            TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, status, error.text);
            TEST_ASSERT_EQUAL_INT(i, chosen);
        }
    }
}

static void mode_is_the_preferred_one_unless_another_is_named(void)
{
    size_t chosen;
    make_card();
    TEST_ASSERT_EQUAL_INT(NACRE_OK, display_choose_mode(&connectors[1], NULL, &chosen, &error));
    TEST_ASSERT_EQUAL_INT(FULL_HD, chosen);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          display_choose_mode(&connectors[1], "1280x720", &chosen, &error));
    TEST_ASSERT_EQUAL_INT(HD, chosen);
    /* Nothing is preferred: the first that is whole. */
    modes[FULL_HD].timing.type = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, display_choose_mode(&connectors[1], NULL, &chosen, &error));
    TEST_ASSERT_EQUAL_INT(HD, chosen);
    /* What is preferred is interlaced. */
    modes[FULL_HD_INTERLACED].timing.type = DRM_MODE_TYPE_PREFERRED;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, display_choose_mode(&connectors[1], NULL, &chosen, &error));
    TEST_ASSERT_EQUAL_INT(HD, chosen);
}

static void modes_that_are_not_there_are_refused_with_those_that_are(void)
{
    size_t chosen;
    make_card();
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          display_choose_mode(&connectors[1], "1920x1080@50", &chosen, &error));
    TEST_ASSERT_EQUAL_STRING(
        "projector HDMI-A-1: has no mode 1920x1080@50; it has 1280x720@60, 1920x1080@60, "
        "1920x1080@59.94, 1024x768@60.004; name one of them as projector.egl.mode in the station "
        "file",
        error.text);
    connectors[1].mode_count = 1;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, display_choose_mode(&connectors[1], NULL, &chosen, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "tells no mode that is not interlaced"));
}

/* A message stays within its room. */
static void long_lists_are_cut(void)
{
    static struct display_mode many[200];
    struct display_connector busy = {
        .name = "DP-3", .connected = true, .modes = many, .mode_count = 200};
    size_t chosen;
    for (uint16_t i = 0; i < 200; i++) {
        many[i] = mode(65000, (uint16_t)(1001 + i), 1344, 768, 806, 0, 0);
    }
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, display_choose_mode(&busy, "999x768", &chosen, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "1012x768@60.004, ...; name one of them"),
                                 error.text);
}

static void connector_is_the_one_that_is_connected_unless_named(void)
{
    size_t chosen;
    make_card();
    TEST_ASSERT_EQUAL_INT(NACRE_OK, display_choose_connector(&card, NULL, &chosen, &error));
    TEST_ASSERT_EQUAL_INT(1, chosen);
    connectors[2].connected = true;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, display_choose_connector(&card, "DP-1", &chosen, &error));
    TEST_ASSERT_EQUAL_INT(2, chosen);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, display_choose_connector(&card, NULL, &chosen, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text,
               "several connectors are connected, HDMI-A-1, DP-1; name the projector's"),
        error.text);
}

static void connectors_that_cannot_be_meant_are_refused(void)
{
    size_t chosen;
    make_card();
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, display_choose_connector(&card, "VGA-1", &chosen, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "/dev/dri/card0 has no such connector; it has eDP-1, HDMI-A-1, DP-1;"),
        error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, display_choose_connector(&card, "DP-1", &chosen, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "projector DP-1: nothing is connected to it; plug the projector in and "
                           "turn it on, or name another connector; connected are HDMI-A-1"),
        error.text);
    connectors[1].connected = false;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, display_choose_connector(&card, NULL, &chosen, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "nothing is connected to eDP-1, HDMI-A-1, DP-1; plug the projector in"),
        error.text);
    card.connector_count = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, display_choose_connector(&card, NULL, &chosen, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "the graphics card has no connector"),
                                 error.text);
}

static void card_is_the_first_that_fits(void)
{
    struct display_connector other = {.name = "Virtual-1"};
    struct display_card cards[2] = {
        {.path = "/dev/dri/card0", .connectors = &other, .connector_count = 1}};
    size_t chosen;
    make_card();
    (void)strcpy(card.path, "/dev/dri/card1");
    cards[1] = card;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, display_choose_card(cards, 2, NULL, &chosen, &error));
    TEST_ASSERT_EQUAL_INT(1, chosen);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, display_choose_card(cards, 2, "Virtual-1", &chosen, &error));
    TEST_ASSERT_EQUAL_INT(0, chosen);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, display_choose_card(cards, 2, "VGA-1", &chosen, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "no graphics card has such a connector; there are Virtual-1 of "
                           "/dev/dri/card0, eDP-1 of /dev/dri/card1,"),
        error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, display_choose_card(cards, 1, NULL, &chosen, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "none is connected; there are Virtual-1"),
                                 error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, display_choose_card(NULL, 0, NULL, &chosen, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "has no graphics card"), error.text);
}

static void regions_fit_or_not(void)
{
    static const struct {
        struct display_region region;
        bool fits;
    } cases[] = {
        {{0, 0, 1920, 1080}, true},  {{1919, 1079, 1, 1}, true},   {{1, 0, 1920, 1080}, false},
        {{0, 1, 1920, 1080}, false}, {{-1, 0, 5, 5}, false},       {{0, -1, 5, 5}, false},
        {{0, 0, 0, 5}, false},       {{0, 0, 5, 0}, false},        {{INT_MAX, 0, 5, 5}, false},
        {{5, 5, INT_MAX, 5}, false}, {{1900, 1000, 20, 81}, false}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        TEST_ASSERT_EQUAL_INT(cases[i].fits, display_region_fits(&cases[i].region, 1920, 1080));
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(modes_are_read);
    RUN_TEST(what_is_no_mode_is_refused);
    RUN_TEST(refresh_is_told_from_the_timings);
    RUN_TEST(every_mode_is_found_by_its_text);
    RUN_TEST(mode_is_the_preferred_one_unless_another_is_named);
    RUN_TEST(modes_that_are_not_there_are_refused_with_those_that_are);
    RUN_TEST(long_lists_are_cut);
    RUN_TEST(connector_is_the_one_that_is_connected_unless_named);
    RUN_TEST(connectors_that_cannot_be_meant_are_refused);
    RUN_TEST(card_is_the_first_that_fits);
    RUN_TEST(regions_fit_or_not);
    return UNITY_END();
}
