/* The firmware's USB in simavr: what a host asks when a device is plugged in, and what no host should ask. */
#include "simulated.h"

#include "unity.h"

#include <simavr/avr_usb.h>
#include <simavr/sim_avr.h>
#include <string.h>

enum { TRANSFER_MS = 20, IN = 0x80, VENDOR = 0x40 };
enum { CLEAR_FEATURE = 1, SET_FEATURE = 3, GET_DESCRIPTOR = 6, SET_CONFIGURATION = 9 };

static struct simulated *board;
static uint8_t data[64];

void setUp(void)
{
    memset(data, 0, sizeof data);
    board = simulated_new();
    TEST_ASSERT_NOT_NULL_MESSAGE(board, "simavr cannot run the firmware");
    TEST_ASSERT_TRUE(simulated_enumerate(board));
}

void tearDown(void)
{
    simulated_free(board);
    board = NULL;
}

static int ask(uint8_t type, uint8_t request, uint16_t value, uint16_t index, uint16_t size)
{
    return simulated_control(board, type, request, value, index, data, size, TRANSFER_MS);
}

static void the_board_lives(void)
{
    struct board_status status;
    TEST_ASSERT_EQUAL_INT(sizeof status, ask(IN | VENDOR, BOARD_GET_STATUS, 0, 0, sizeof data));
    memcpy(&status, data, sizeof status);
    TEST_ASSERT_EQUAL_UINT8(BOARD_PROTOCOL, status.protocol);
    TEST_ASSERT_EQUAL_UINT8(sizeof status, status.size);
    TEST_ASSERT_EQUAL_UINT32(16000000, status.tick_hz);
}

static void device_descriptor_names_the_board(void)
{
    const uint8_t expected[] = {18, 1, 0, 2, 255, 0, 0, 64, 0x09, 0x12, 1, 0, BOARD_PROTOCOL,
                                0,  1, 2, 0, 1};
    TEST_ASSERT_EQUAL_INT(18, ask(IN, GET_DESCRIPTOR, 0x0100, 0, 64));
    TEST_ASSERT_EQUAL_UINT8_ARRAY(expected, data, sizeof expected);
    /* Windows and Linux ask for 8 bytes at first. */
    TEST_ASSERT_EQUAL_INT(8, ask(IN, GET_DESCRIPTOR, 0x0100, 0, 8));
}

static void configuration_is_as_long_as_it_says(void)
{
    int size = ask(IN, GET_DESCRIPTOR, 0x0200, 0, 64);
    TEST_ASSERT_EQUAL_INT(size, data[2]);
    int at = 0;
    int endpoints = 0;
    for (; at < size && data[at] > 0; at += data[at]) {
        endpoints += data[at + 1] == 5;
    }
    TEST_ASSERT_EQUAL_INT(size, at);
    TEST_ASSERT_EQUAL_INT(2, endpoints);
}

static void strings_are_utf_16(void)
{
    TEST_ASSERT_EQUAL_INT(4, ask(IN, GET_DESCRIPTOR, 0x0300, 0, 64));
    int size = ask(IN, GET_DESCRIPTOR, 0x0302, 0x0409, 64);
    TEST_ASSERT_EQUAL_INT(2 + 2 * (int)strlen(BOARD_PRODUCT), size);
    TEST_ASSERT_EQUAL_UINT8(size, data[0]);
    for (size_t i = 0; i < strlen(BOARD_PRODUCT); i++) {
        TEST_ASSERT_EQUAL_UINT8(BOARD_PRODUCT[i], data[2 + 2 * i]);
        TEST_ASSERT_EQUAL_UINT8(0, data[3 + 2 * i]);
    }
}

static void what_it_does_not_know_stalls_and_the_next_request_passes(void)
{
    TEST_ASSERT_EQUAL_INT(SIMULATED_STALL, ask(IN, GET_DESCRIPTOR, 0x0600, 0, 10));
    TEST_ASSERT_EQUAL_INT(SIMULATED_STALL, ask(IN, GET_DESCRIPTOR, 0x0303, 0, 64));
    TEST_ASSERT_EQUAL_INT(SIMULATED_STALL, ask(IN | VENDOR, 99, 0, 0, 64));
    TEST_ASSERT_EQUAL_INT(SIMULATED_STALL, ask(0, SET_CONFIGURATION, 2, 0, 0));
    TEST_ASSERT_EQUAL_INT(SIMULATED_STALL, ask(2, SET_FEATURE, 0, 3, 0));
    the_board_lives();
}

static void settings_are_taken_whole_or_not_at_all(void)
{
    const struct board_settings right = {.gain = 5, .coast = 3, .report = 0};
    const struct board_settings wrong = {.gain = 9, .coast = 3, .report = 0};
    struct board_status status;
    memcpy(data, &right, sizeof right);
    TEST_ASSERT_EQUAL_INT(sizeof right, ask(VENDOR, BOARD_SET_SETTINGS, 0, 0, sizeof right));
    memcpy(data, &wrong, sizeof wrong);
    TEST_ASSERT_EQUAL_INT(SIMULATED_STALL, ask(VENDOR, BOARD_SET_SETTINGS, 0, 0, sizeof wrong));
    TEST_ASSERT_EQUAL_INT(SIMULATED_STALL, ask(VENDOR, BOARD_SET_SETTINGS, 0, 0, 3));
    TEST_ASSERT_EQUAL_INT(SIMULATED_STALL, ask(VENDOR, BOARD_SET_SETTINGS, 0, 0, 64));
    (void)ask(IN | VENDOR, BOARD_GET_STATUS, 0, 0, sizeof data);
    memcpy(&status, data, sizeof status);
    TEST_ASSERT_EQUAL_UINT8(5, status.settings.gain);
    TEST_ASSERT_EQUAL_UINT8(3, status.settings.coast);
}

static void a_halted_endpoint_stalls_until_it_is_cleared(void)
{
    struct board_event event = {.event = 0};
    TEST_ASSERT_EQUAL_INT(sizeof event,
                          simulated_in(board, 0x82, &event, sizeof event, TRANSFER_MS));
    TEST_ASSERT_EQUAL_UINT8(BOARD_STARTED, event.event);
    TEST_ASSERT_EQUAL_INT(0, ask(2, SET_FEATURE, 0, 0x82, 0));
    TEST_ASSERT_EQUAL_INT(2, ask(IN | 2, 0, 0, 0x82, 2));
    TEST_ASSERT_EQUAL_UINT8(1, data[0]);
    TEST_ASSERT_EQUAL_INT(SIMULATED_STALL,
                          simulated_in(board, 0x82, &event, sizeof event, TRANSFER_MS));
    TEST_ASSERT_EQUAL_INT(0, ask(2, CLEAR_FEATURE, 0, 0x82, 0));
    TEST_ASSERT_EQUAL_INT(SIMULATED_TIMEOUT,
                          simulated_in(board, 0x82, &event, sizeof event, TRANSFER_MS));
    const uint8_t junk[3] = {1, 2, 3};
    TEST_ASSERT_TRUE(simulated_out(board, 1, junk, sizeof junk, TRANSFER_MS) >= 0);
    TEST_ASSERT_EQUAL_INT(sizeof event,
                          simulated_in(board, 0x82, &event, sizeof event, TRANSFER_MS));
    TEST_ASSERT_EQUAL_UINT8(BOARD_REFUSED, event.event);
}

static void a_reset_bus_may_be_enumerated_again(void)
{
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_TRUE(simulated_enumerate(board));
        the_board_lives();
    }
}

/* Requests as no host sends them: any type, any request, any length, data cut short. Endpoint 0 keeps answering, and
 * the trigger stays low. */
static void random_requests_leave_the_board_alive(void)
{
    uint64_t seed = 99;
    for (int i = 0; i < 3000; i++) {
        uint8_t setup[8];
        for (size_t k = 0; k < sizeof setup; k++) {
            seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
            setup[k] = (uint8_t)(seed >> 50);
        }
        if (i % 2) {
            setup[0] &= 0xc3;
            setup[1] &= 0x0f;
            setup[7] = 0;
        }
        struct avr_io_usb io = {.pipe = 0, .sz = sizeof setup, .buf = setup};
        (void)avr_ioctl(board->avr, AVR_IOCTL_USB_SETUP, &io);
        simulated_run(board, CYCLES_PER_SECOND / 1000);
        io = (struct avr_io_usb){.pipe = 0, .sz = 5, .buf = data};
        (void)avr_ioctl(board->avr, seed & 4096 ? AVR_IOCTL_USB_WRITE : AVR_IOCTL_USB_READ, &io);
        if (i % 64 == 0) {
            simulated_run(board, CYCLES_PER_SECOND / 1000);
            TEST_ASSERT_TRUE(simulated_enumerate(board));
            the_board_lives();
        }
    }
    TEST_ASSERT_EQUAL_UINT64(0, board->edge_count);
}

static void random_packets_leave_the_board_alive(void)
{
    uint64_t seed = 7;
    for (int i = 0; i < 2000; i++) {
        uint8_t packet[64];
        for (size_t k = 0; k < sizeof packet; k++) {
            seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
            packet[k] = (uint8_t)(seed >> 50);
        }
        (void)simulated_out(board, 1, packet, (int)(seed >> 40) & 63, TRANSFER_MS);
        (void)simulated_in(board, 0x82, data, sizeof data, 1);
    }
    the_board_lives();
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(device_descriptor_names_the_board);
    RUN_TEST(configuration_is_as_long_as_it_says);
    RUN_TEST(strings_are_utf_16);
    RUN_TEST(what_it_does_not_know_stalls_and_the_next_request_passes);
    RUN_TEST(settings_are_taken_whole_or_not_at_all);
    RUN_TEST(a_halted_endpoint_stalls_until_it_is_cleared);
    RUN_TEST(a_reset_bus_may_be_enumerated_again);
    RUN_TEST(random_requests_leave_the_board_alive);
    RUN_TEST(random_packets_leave_the_board_alive);
    return UNITY_END();
}
