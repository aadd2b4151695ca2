/* A whole scan by `nacre scan` with V4L2 camera, EGL projector and the trigger board on a real bus, in which the camera sees
 * the screen: the same frames and responses as of a virtual station, also when the board is unplugged in an exposure. */
#include "board_server.h"
#include "guest.h"
#include "tests/cmd/frames.h"
#include "unity.h"
#include "whole.h"

#include <stdio.h>
#include <string.h>

enum { KILL_AT = 9 };

static const struct whole_event nothing;
static const struct whole_station station = {
    .tolerance_ms = 45, .stamp_delay_ms = 10, .trigger = "{driver: usb}"};
static struct whole whole;
static struct board_server board;

void setUp(void)
{
}

void tearDown(void)
{
    whole_end(&whole);
}

static bool look(struct feeder_line *line)
{
    if (!board.view) {
        return false;
    }
    *line = (struct feeder_line){.level = board.view->level,
                                 .rises = board.view->rises,
                                 .rise_ns = board.view->rise_ns,
                                 .fall_ns = board.view->fall_ns};
    return true;
}

static void plug_board(void)
{
    board = board_server_plug((struct board_server_settings){.wheel_hz = 20});
}

/* In a pulse. */
static bool unplug_board(void)
{
    bool now = board.view->level;
    if (now) {
        board_server_unplug(&board);
    }
    return now;
}

static struct whole_outcome scan(const char *session, struct whole_event event)
{
    struct whole_outcome outcome = whole_scan(&whole, session, "3", event);
    printf("scan with the trigger board: %d pulses, %.1f s of the guest\n", outcome.pulses,
           outcome.seconds);
    return outcome;
}

static void must_scan(const char *session)
{
    struct whole_outcome outcome = scan(session, nothing);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, outcome.status, outcome.errors);
    whole_outcome_finish(&outcome);
}

static void a_scan_with_the_board_is_the_virtual_one(void)
{
    static const char session[] = WHOLE "/sound";
    whole_scan_virtual();
    must_scan(session);
    TEST_ASSERT_EQUAL_INT(WHOLE_PATTERNS, session_files_count(session).patterns);
    whole_expect_same_as_virtual(session);
}

static void a_scan_whose_board_is_unplugged_in_an_exposure_is_resumed(void)
{
    static const char session[] = WHOLE "/unplugged";
    struct whole_outcome outcome = scan(session, (struct whole_event){KILL_AT, unplug_board});
    int kept = session_files_count(session).patterns;
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, outcome.status, outcome.errors);
    const char *said = strstr(outcome.errors, "trigger board: ");
    TEST_ASSERT_NOT_NULL_MESSAGE(said, outcome.errors);
    printf("%d patterns kept: %s", kept, said);
    whole_outcome_finish(&outcome);
    TEST_ASSERT_TRUE(kept > 0 && kept < WHOLE_PATTERNS);
    TEST_ASSERT_EQUAL_INT(0, session_files_count(session).unfinished);
    feeder_step(&whole.feeder); /* sees that the board is gone */
    plug_board();
    must_scan(session);
    whole_expect_same_as_virtual(session);
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    guest_run("modprobe vhci-hcd");
    whole.screen = screen_plug("vkms", "vkms");
    whole_write(&whole, &station);
    plug_board();
    whole_plug_camera(&whole, NULL, look);
    RUN_TEST(a_scan_with_the_board_is_the_virtual_one);
    RUN_TEST(a_scan_whose_board_is_unplugged_in_an_exposure_is_resumed);
    board_server_unplug(&board);
    return UNITY_END();
}
