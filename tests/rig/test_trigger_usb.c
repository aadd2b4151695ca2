/* The trigger board's back end against the real firmware in simavr, through the USB seam, and against a failing bus. */
#include "rig/trigger_usb.h"

#include "simulated.h"
#include "unity.h"

#include <simavr/sim_avr.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PERIOD (CYCLES_PER_SECOND / 30)

static const int64_t turn_ns = 33333333;

static struct nacre_error error;
static struct simulated *board;
static struct trigger *trigger;

/* What goes wrong, and when. */
static struct {
    void (*before_in)(int call); /* called before each read of events */
    void (*before_status)(void);
    int reads;
    bool silent;        /* transfers time out */
    bool deaf;          /* the host controller fails */
    int cut;            /* reads of events give so many bytes only; 0: whole */
    int old_protocol;   /* the status says this; 0: the truth */
    int status_size;    /* the status has so many bytes; 0: all */
    bool no_endpoints;  /* the descriptors have none */
    bool replug;        /* an unplugged board comes back while the port waits */
    int opened, closed; /* devices */
    bool port_closed;
} bus;

static int result_of(int moved)
{
    switch (moved) {
    case SIMULATED_TIMEOUT:
        return USB_TIMEOUT;
    case SIMULATED_STALL:
        return USB_STALL;
    case SIMULATED_GONE:
        return USB_GONE;
    default:
        return moved;
    }
}

static int bus_control(struct usb *usb, uint8_t type, uint8_t request, uint16_t value, void *data,
                       uint16_t size, int timeout_ms)
{
    (void)usb;
    if (bus.silent || bus.deaf) {
        return bus.silent ? USB_TIMEOUT : USB_BROKEN;
    }
    if (bus.before_status && type == 0xc0) {
        bus.before_status();
    }
    int moved =
        result_of(simulated_control(board, type, request, value, 0, data, size, timeout_ms));
    if (type == 0xc0 && request == BOARD_GET_STATUS && moved > 0) {
        ((uint8_t *)data)[0] = (uint8_t)(bus.old_protocol ? bus.old_protocol : BOARD_PROTOCOL);
        moved = bus.status_size ? bus.status_size : moved;
    }
    if (request == 6 && bus.no_endpoints) {
        moved = 9;
    }
    return moved;
}

/* As libusb's back end: a stalled endpoint is cleared for the next try. */
static int cleared(uint8_t endpoint, int moved)
{
    if (moved == SIMULATED_STALL) {
        (void)simulated_control(board, 2, 1, 0, endpoint, NULL, 0, 50);
    }
    return result_of(moved);
}

static int bus_out(struct usb *usb, uint8_t endpoint, const void *data, int size, int timeout_ms)
{
    (void)usb;
    TEST_ASSERT_EQUAL_UINT8(0x01, endpoint);
    return cleared(endpoint, simulated_out(board, endpoint, data, size, timeout_ms));
}

static int bus_in(struct usb *usb, uint8_t endpoint, void *data, int size, int timeout_ms)
{
    (void)usb;
    TEST_ASSERT_EQUAL_UINT8(0x82, endpoint);
    if (bus.before_in) {
        bus.before_in(bus.reads);
    }
    bus.reads++;
    int moved = cleared(endpoint, simulated_in(board, endpoint, data, size, timeout_ms));
    return bus.cut && moved > bus.cut ? bus.cut : moved;
}

static void bus_close(struct usb *usb)
{
    bus.closed++;
    free(usb);
}

static void plug_in(void)
{
    simulated_free(board);
    board = simulated_new();
    TEST_ASSERT_NOT_NULL(board);
    TEST_ASSERT_TRUE(simulated_enumerate(board));
    simulated_turn(board, (struct wheel){.period = PERIOD, .jitter = 32, .seed = 5});
}

static int port_open(struct usb_port *port, int wait_ms, struct usb **usb, struct nacre_error *e)
{
    static const struct usb_ops ops = {
        .control = bus_control, .out = bus_out, .in = bus_in, .close = bus_close};
    (void)port;
    if (board->unplugged && bus.replug && wait_ms > 0) {
        plug_in();
    }
    if (board->unplugged) {
        return nacre_fail(e, "trigger board: none is plugged in");
    }
    *usb = calloc(1, sizeof **usb);
    if (!*usb) {
        return nacre_fail_memory(e, "a device");
    }
    (*usb)->ops = &ops;
    bus.opened++;
    return NACRE_OK;
}

static void port_close(struct usb_port *port)
{
    (void)port;
    bus.port_closed = true;
}

static int64_t clock_now(struct clock *clock)
{
    (void)clock;
    return (int64_t)((double)board->avr->cycle * 62.5);
}

static void clock_sleep(struct clock *clock, int64_t time_ns)
{
    int64_t ahead_ns = time_ns - clock_now(clock);
    if (ahead_ns > 0) {
        simulated_run(board, (double)ahead_ns / 62.5);
    }
}

static const struct usb_port_ops port_ops = {.open = port_open, .close = port_close};
static struct usb_port port = {.ops = &port_ops};
static const struct clock_ops clock_ops = {
    .name = "simavr", .now_ns = clock_now, .sleep_until_ns = clock_sleep};
static struct clock board_clock = {.ops = &clock_ops};

void setUp(void)
{
    memset(&bus, 0, sizeof bus);
    error.text[0] = '\0';
    plug_in();
}

void tearDown(void)
{
    if (trigger) {
        trigger->ops->close(trigger);
        trigger = NULL;
        TEST_ASSERT_TRUE(bus.port_closed);
    }
    TEST_ASSERT_EQUAL_INT(bus.opened, bus.closed);
    simulated_free(board);
    board = NULL;
}

static void make(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, trigger_usb_new(&port, &board_clock, &trigger, &error),
                                  error.text);
}

static void refuses_to_open(const char *why)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, trigger_usb_new(&port, &board_clock, &trigger, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
    TEST_ASSERT_NULL(trigger);
    TEST_ASSERT_TRUE(bus.port_closed);
}

static int64_t fire(int turns)
{
    int64_t trigger_ns = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, trigger->ops->fire(trigger, turns * turn_ns, &trigger_ns, &error), error.text);
    return trigger_ns;
}

static void fails_to_fire(int turns, const char *why)
{
    int64_t trigger_ns = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          trigger->ops->fire(trigger, turns * turn_ns, &trigger_ns, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
}

static bool pin_is_low(void)
{
    return board->edge_count == 0 || !board->edges[board->edge_count - 1].high;
}

static void fires_exposures_and_gives_the_time_of_their_beginning(void)
{
    make();
    for (int turns = 1; turns <= 3; turns++) {
        int64_t before = clock_now(&board_clock);
        int64_t trigger_ns = fire(turns);
        const struct pin_edge *edges = board->edges + board->edge_count - 2;
        TEST_ASSERT_EQUAL_UINT64(2 * turns, board->edge_count);
        TEST_ASSERT_TRUE(edges[0].high);
        /* The board answers the clock's question within its rounds of half a millisecond. */
        TEST_ASSERT_INT64_WITHIN(1000000, (int64_t)((double)edges[0].cycle * 62.5), trigger_ns);
        TEST_ASSERT_TRUE(trigger_ns > before);
        /* +-2 us of jitter */
        TEST_ASSERT_INT64_WITHIN(64, (int64_t)(turns * PERIOD),
                                 (int64_t)(edges[1].cycle - edges[0].cycle));
    }
}

static void waits_until_the_loop_has_settled(void)
{
    make();
    (void)fire(1);
    TEST_ASSERT_TRUE((double)board->edges[0].cycle / PERIOD > 8 << BOARD_GAIN_DEFAULT);
}

/* 512 turns at 30 Hz. */
static void waits_as_long_as_the_slowest_gain_takes(void)
{
    const struct board_settings settings = {.gain = BOARD_GAIN_MAX, .coast = 8};
    make();
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger_usb_set(trigger, &settings, &error));
    (void)fire(1);
    double turns = (double)board->edges[0].cycle / PERIOD;
    TEST_ASSERT_TRUE(turns > 8 << BOARD_GAIN_MAX);
    TEST_ASSERT_TRUE(turns < (8 << BOARD_GAIN_MAX) + 20);
}

/* The wheel stops and goes while the loop settles. */
static void stutter(void)
{
    static int calls;
    if (calls++ % 20 == 10) {
        simulated_turn(board, (struct wheel){.stopped = true});
        simulated_run(board, 12 * PERIOD);
        simulated_turn(board, (struct wheel){.period = PERIOD, .seed = 5});
    }
}

static void says_that_the_wheel_is_lost_again_and_again(void)
{
    make();
    bus.before_status = stutter;
    fails_to_fire(1, "loses the colour wheel again and again");
    TEST_ASSERT_TRUE((double)board->avr->cycle < 20 * CYCLES_PER_SECOND);
    bus.before_status = NULL;
    (void)fire(1);
}

static void refuses_exposures_that_are_no_whole_turns(void)
{
    int64_t trigger_ns = 0;
    make();
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          trigger->ops->fire(trigger, turn_ns * 3 / 2, &trigger_ns, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "1.500 turns"), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          trigger->ops->fire(trigger, turn_ns / 5, &trigger_ns, &error));
    TEST_ASSERT_EQUAL_UINT64(0, board->edge_count);
}

static void says_that_there_is_no_wheel(void)
{
    make();
    simulated_turn(board, (struct wheel){.stopped = true});
    simulated_run(board, CYCLES_PER_SECOND);
    fails_to_fire(1, "finds no colour wheel");
}

static void stop_wheel(int call)
{
    if (call > 2) {
        simulated_turn(board, (struct wheel){.stopped = true});
    }
}

static void says_that_the_wheel_was_lost_and_recovers(void)
{
    make();
    (void)fire(1);
    bus.reads = 0;
    bus.before_in = stop_wheel;
    fails_to_fire(60, "lost the colour wheel");
    TEST_ASSERT_TRUE(pin_is_low());
    bus.before_in = NULL;
    simulated_turn(board, (struct wheel){.period = PERIOD, .seed = 3});
    (void)fire(2);
}

static void unplug(int call)
{
    if (call == 3) {
        TEST_ASSERT_FALSE(pin_is_low());
        board->unplugged = true;
    }
}

static void recovers_from_unplugging_in_an_exposure(void)
{
    make();
    (void)fire(1);
    bus.reads = 0;
    bus.before_in = unplug;
    fails_to_fire(60, "was unplugged");
    bus.before_in = NULL;
    fails_to_fire(1, "none is plugged in");
    bus.replug = true;
    (void)fire(1);
    TEST_ASSERT_EQUAL_INT(2, bus.opened);
}

static void stall_in(int call)
{
    if (call == 1) {
        TEST_ASSERT_EQUAL_INT(0, simulated_control(board, 2, 3, 0, 0x82, NULL, 0, 50));
    }
}

static void recovers_from_stalled_endpoints(void)
{
    make();
    (void)fire(1);
    bus.reads = 0;
    bus.before_in = stall_in;
    (void)fire(3);
    TEST_ASSERT_EQUAL_INT(0, simulated_control(board, 2, 3, 0, 0x01, NULL, 0, 50));
    (void)fire(1);
}

static void says_that_the_board_is_silent_and_opens_it_anew(void)
{
    make();
    bus.silent = true;
    fails_to_fire(1, "does not answer");
    bus.silent = false;
    (void)fire(1);
    bus.deaf = true;
    fails_to_fire(1, "the USB transfer");
    bus.deaf = false;
    (void)fire(1);
    TEST_ASSERT_EQUAL_INT(3, bus.opened);
}

static void does_not_trust_events_that_are_cut_off(void)
{
    make();
    (void)fire(1);
    bus.cut = 15;
    fails_to_fire(1, "the USB transfer of an exposure failed");
    bus.cut = 0;
    (void)fire(1);
    TEST_ASSERT_TRUE(pin_is_low());
}

static void refuses_firmware_of_another_protocol(void)
{
    bus.old_protocol = 77;
    refuses_to_open("speaks protocol 77 and this program 1; write the firmware anew");
}

static void refuses_a_status_that_is_too_short(void)
{
    bus.status_size = 20;
    refuses_to_open("its status has 20 bytes");
}

static void refuses_a_device_without_endpoints(void)
{
    bus.no_endpoints = true;
    refuses_to_open("has no bulk endpoints");
}

static void refuses_to_open_a_board_that_is_not_there(void)
{
    board->unplugged = true;
    refuses_to_open("none is plugged in");
}

static void reset_board(int call)
{
    if (call == 3) {
        plug_in();
    }
}

static void says_that_the_board_was_reset(void)
{
    make();
    (void)fire(1);
    bus.reads = 0;
    bus.before_in = reset_board;
    fails_to_fire(60, "was reset");
}

static void an_exposure_of_an_earlier_program_is_ended(void)
{
    const struct board_command command = {.command = BOARD_EXPOSE, .id = 9, .turns = 5000};
    simulated_run(board, CYCLES_PER_SECOND);
    (void)simulated_out(board, 1, &command, sizeof command, 50);
    simulated_run(board, 3 * PERIOD);
    TEST_ASSERT_FALSE(pin_is_low());
    make();
    TEST_ASSERT_TRUE(pin_is_low());
    (void)fire(1);
}

static void settings_are_set_and_refused(void)
{
    struct board_settings settings = {.gain = 5, .coast = 4};
    struct board_status status;
    make();
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger_usb_set(trigger, &settings, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger_usb_status(trigger, &status, &error));
    TEST_ASSERT_EQUAL_UINT8(5, status.settings.gain);
    settings.gain = 9;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, trigger_usb_set(trigger, &settings, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "gains are 1 to 6"), error.text);
    simulated_run(board, CYCLES_PER_SECOND);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger_usb_status(trigger, &status, &error));
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 30, trigger_usb_wheel_hz(&status));
}

/* udev grants access to the very device that the board says it is. */
static void the_udev_rule_names_the_board(void)
{
    char text[4096] = {0};
    char expected[128];
    FILE *file = fopen(UDEV_RULES, "r");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fread(text, 1, sizeof text - 1, file) > 0);
    (void)fclose(file);
    (void)snprintf(expected, sizeof expected,
                   "ATTR{idVendor}==\"%04x\", ATTR{idProduct}==\"%04x\", ATTR{product}==\"%s\"",
                   BOARD_VENDOR_ID, BOARD_PRODUCT_ID, BOARD_PRODUCT);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, expected), expected);
    TEST_ASSERT_NOT_NULL(strstr(text, "MODE=\"0660\""));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(fires_exposures_and_gives_the_time_of_their_beginning);
    RUN_TEST(waits_until_the_loop_has_settled);
    RUN_TEST(waits_as_long_as_the_slowest_gain_takes);
    RUN_TEST(says_that_the_wheel_is_lost_again_and_again);
    RUN_TEST(refuses_exposures_that_are_no_whole_turns);
    RUN_TEST(says_that_there_is_no_wheel);
    RUN_TEST(says_that_the_wheel_was_lost_and_recovers);
    RUN_TEST(recovers_from_unplugging_in_an_exposure);
    RUN_TEST(recovers_from_stalled_endpoints);
    RUN_TEST(says_that_the_board_is_silent_and_opens_it_anew);
    RUN_TEST(does_not_trust_events_that_are_cut_off);
    RUN_TEST(refuses_firmware_of_another_protocol);
    RUN_TEST(refuses_a_status_that_is_too_short);
    RUN_TEST(refuses_a_device_without_endpoints);
    RUN_TEST(refuses_to_open_a_board_that_is_not_there);
    RUN_TEST(says_that_the_board_was_reset);
    RUN_TEST(an_exposure_of_an_earlier_program_is_ended);
    RUN_TEST(settings_are_set_and_refused);
    RUN_TEST(the_udev_rule_names_the_board);
    return UNITY_END();
}
