/* Tests of the USB/IP connection's parser, with the board's portable half as the device: what a kernel sends, and what none
 * should. */
#include "usbip.h"

#include "firmware/board.h"
#include "firmware/pin.h"
#include "unity.h"

#include <errno.h>
#include <string.h>

enum { ROUND = 8000, PERIOD = 533333, MESSAGES = 120000 };

static struct board board;
static struct usbip usbip;
static uint64_t now, next_pulse, edge_at, seed;
static bool armed, armed_high, level;

/* What was answered. */
static struct {
    int count;
    uint32_t command, number;
    int status, size;
    uint8_t data[USBIP_DATA];
    bool cut; /* the connection takes no more */
} answers;

bool pin_arm(uint64_t ticks, bool high)
{
    armed = true;
    armed_high = high;
    edge_at = ticks;
    return true;
}

bool pin_low(uint64_t *ticks)
{
    bool high = level;
    armed = level = false;
    *ticks = now;
    return high;
}

static void run(void)
{
    now += ROUND;
    if (armed && edge_at <= now) {
        armed = false;
        level = armed_high;
        board_edge(&board, edge_at);
    }
    for (; next_pulse <= now; next_pulse += PERIOD) {
        board_index(&board, next_pulse);
    }
    board_poll(&board, now);
}

/* As usb.c does it. */
static int control(void *context, const uint8_t setup[8], uint8_t *data, int size)
{
    struct board_settings settings;
    struct board_status status;
    int length = setup[6] | setup[7] << 8;
    (void)context;
    if (length > size) {
        return USBIP_STALL;
    }
    if (setup[0] == 0xc0 && setup[1] == BOARD_GET_STATUS) {
        board_status(&board, now, &status);
        length = length < (int)sizeof status ? length : (int)sizeof status;
        memcpy(data, &status, (size_t)length);
        return length;
    }
    if (setup[0] == 0x40 && setup[1] == BOARD_SET_SETTINGS && length == sizeof settings) {
        memcpy(&settings, data, sizeof settings);
        return board_set(&board, &settings) ? length : USBIP_STALL;
    }
    return USBIP_STALL;
}

static int out(void *context, uint8_t endpoint, const uint8_t *data, int size)
{
    (void)context;
    if (endpoint != 1 || size > 64) {
        return USBIP_STALL;
    }
    board_packet(&board, data, (uint8_t)size, now);
    return size;
}

static int in(void *context, uint8_t endpoint, uint8_t *data, int size)
{
    struct board_event event;
    (void)context;
    if (endpoint != 2 || size < (int)sizeof event) {
        return USBIP_STALL;
    }
    if (!board_event(&board, &event)) {
        return USBIP_NAK;
    }
    memcpy(data, &event, sizeof event);
    return sizeof event;
}

static uint32_t get32(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

static bool reply(void *context, const uint8_t *bytes, size_t size)
{
    (void)context;
    if (answers.cut) {
        return false;
    }
    answers.count++;
    answers.command = get32(bytes);
    answers.number = get32(bytes + 4);
    answers.status = (int)get32(bytes + 20);
    answers.size = (int)get32(bytes + 24);
    TEST_ASSERT_TRUE(size >= USBIP_HEADER && size <= USBIP_HEADER + USBIP_DATA);
    memcpy(answers.data, bytes + USBIP_HEADER, size - USBIP_HEADER);
    TEST_ASSERT_TRUE(answers.command == 3 || answers.command == 4);
    return true;
}

static void connect(void)
{
    static const struct usbip_ops ops = {control, out, in, reply};
    usbip_init(&usbip, &ops, NULL);
}

void setUp(void)
{
    struct board_event event;
    memset(&answers, 0, sizeof answers);
    armed = level = false;
    now = 5000;
    next_pulse = 100000;
    seed = 11;
    board_start(&board, now);
    (void)board_event(&board, &event); /* BOARD_STARTED */
    connect();
}

void tearDown(void)
{
}

static void put32(uint8_t *bytes, uint32_t value)
{
    for (int i = 0; i < 4; i++) {
        bytes[i] = (uint8_t)(value >> (24 - 8 * i));
    }
}

struct message {
    size_t size;
    uint8_t bytes[USBIP_HEADER + 64];
};

static struct message submit(uint32_t number, uint32_t endpoint, bool in_direction, uint32_t size)
{
    struct message message = {.size = USBIP_HEADER + (in_direction ? 0 : size)};
    put32(message.bytes, 1);
    put32(message.bytes + 4, number);
    put32(message.bytes + 8, 0x10002);
    put32(message.bytes + 12, in_direction);
    put32(message.bytes + 16, endpoint);
    put32(message.bytes + 24, size);
    return message;
}

static struct message ask(uint32_t number, uint8_t type, uint8_t request, uint8_t size)
{
    struct message message = submit(number, 0, type & 0x80, size);
    message.bytes[40] = type;
    message.bytes[41] = request;
    message.bytes[46] = size;
    return message;
}

static struct message command(uint32_t number, uint8_t kind, uint16_t turns)
{
    struct board_command bytes = {.command = kind, .id = (uint16_t)number, .turns = turns};
    struct message message = submit(number, 1, false, sizeof bytes);
    memcpy(message.bytes + USBIP_HEADER, &bytes, sizeof bytes);
    return message;
}

static struct message take_back(uint32_t number, uint32_t other)
{
    struct message message = {.size = USBIP_HEADER};
    put32(message.bytes, 2);
    put32(message.bytes + 4, number);
    put32(message.bytes + 20, other);
    return message;
}

static bool feed(struct message message)
{
    return usbip_feed(&usbip, message.bytes, message.size);
}

static void expect(uint32_t kind, uint32_t number, int status, int size)
{
    TEST_ASSERT_EQUAL_UINT32(kind, answers.command);
    TEST_ASSERT_EQUAL_UINT32(number, answers.number);
    TEST_ASSERT_EQUAL_INT(status, answers.status);
    TEST_ASSERT_EQUAL_INT(size, answers.size);
}

static void control_transfers_are_answered_at_once(void)
{
    struct board_status status;
    TEST_ASSERT_TRUE(feed(ask(7, 0xc0, BOARD_GET_STATUS, 64)));
    expect(3, 7, 0, sizeof status);
    memcpy(&status, answers.data, sizeof status);
    TEST_ASSERT_EQUAL_UINT8(BOARD_PROTOCOL, status.protocol);
    TEST_ASSERT_TRUE(feed(ask(8, 0xc0, 99, 64)));
    expect(3, 8, -EPIPE, 0);
    /* The kernel asks for no more than its transfer holds. */
    struct message more = ask(9, 0xc0, BOARD_GET_STATUS, 4);
    more.bytes[46] = 64;
    TEST_ASSERT_TRUE(feed(more));
    expect(3, 9, -EPIPE, 0);
}

static void settings_come_behind_their_request(void)
{
    const struct board_settings settings = {.gain = 5, .coast = 2};
    struct message message = ask(3, 0x40, BOARD_SET_SETTINGS, sizeof settings);
    memcpy(message.bytes + USBIP_HEADER, &settings, sizeof settings);
    TEST_ASSERT_TRUE(feed(message));
    expect(3, 3, 0, sizeof settings);
    TEST_ASSERT_EQUAL_UINT8(5, board.settings.gain);
    message.bytes[USBIP_HEADER] = 0;
    TEST_ASSERT_TRUE(feed(message));
    expect(3, 3, -EPIPE, 0);
    TEST_ASSERT_EQUAL_UINT8(5, board.settings.gain);
}

static void events_are_waited_for_and_requests_may_come_byte_by_byte(void)
{
    struct board_event event;
    struct message message = command(2, BOARD_EXPOSE, 0);
    TEST_ASSERT_TRUE(feed(submit(1, 2, true, 64)));
    TEST_ASSERT_TRUE(usbip_poll(&usbip));
    TEST_ASSERT_EQUAL_INT(0, answers.count);
    for (size_t i = 0; i < message.size; i++) {
        TEST_ASSERT_EQUAL_INT(0, answers.count);
        TEST_ASSERT_TRUE(usbip_feed(&usbip, message.bytes + i, 1));
    }
    expect(3, 2, 0, sizeof(struct board_command));
    TEST_ASSERT_TRUE(usbip_poll(&usbip));
    expect(3, 1, 0, sizeof event);
    memcpy(&event, answers.data, sizeof event);
    TEST_ASSERT_EQUAL_UINT8(BOARD_REFUSED, event.event);
    TEST_ASSERT_EQUAL_INT(2, answers.count);
}

static void what_is_taken_back_is_not_answered_twice(void)
{
    TEST_ASSERT_TRUE(feed(submit(1, 2, true, 64)));
    TEST_ASSERT_TRUE(feed(take_back(2, 1)));
    expect(4, 2, -ECONNRESET, 0);
    TEST_ASSERT_TRUE(feed(take_back(3, 1)));
    expect(4, 3, 0, 0);
    TEST_ASSERT_TRUE(feed(command(4, BOARD_EXPOSE, 0)));
    TEST_ASSERT_TRUE(usbip_poll(&usbip));
    TEST_ASSERT_EQUAL_INT(3, answers.count);
}

static void two_requests_in_one_piece_are_both_answered(void)
{
    uint8_t bytes[2 * sizeof(struct message)];
    struct message first = ask(1, 0xc0, BOARD_GET_STATUS, 64);
    struct message other = command(2, BOARD_ABORT, 0);
    memcpy(bytes, first.bytes, first.size);
    memcpy(bytes + first.size, other.bytes, other.size);
    TEST_ASSERT_TRUE(usbip_feed(&usbip, bytes, first.size + other.size));
    TEST_ASSERT_EQUAL_INT(2, answers.count);
}

static void refused_is(struct message message)
{
    connect();
    TEST_ASSERT_FALSE(feed(message));
    TEST_ASSERT_EQUAL_INT(0, answers.count);
}

static void requests_that_make_no_sense_end_the_connection(void)
{
    struct message message = submit(1, 1, false, USBIP_DATA + 1);
    message.size = USBIP_HEADER;
    refused_is(message);
    message = submit(1, 2, true, UINT32_MAX);
    refused_is(message);
    message = submit(0, 2, true, 64);
    refused_is(message);
    message = submit(1, 16, true, 64);
    refused_is(message);
    message = submit(1, 2, true, 64);
    put32(message.bytes, 0x8003); /* OP_REQ_IMPORT */
    refused_is(message);
    message = submit(1, 2, true, 64);
    put32(message.bytes + 12, 2);
    refused_is(message);
    message = submit(1, 2, true, 64);
    put32(message.bytes + 32, 8); /* isochronous packets */
    refused_is(message);
}

static void a_number_in_use_and_one_transfer_too_many_end_the_connection(void)
{
    TEST_ASSERT_TRUE(feed(submit(1, 2, true, 64)));
    TEST_ASSERT_FALSE(feed(submit(1, 2, true, 64)));
    connect();
    for (uint32_t i = 1; i <= USBIP_PENDING; i++) {
        TEST_ASSERT_TRUE(feed(submit(i, 2, true, 64)));
    }
    TEST_ASSERT_FALSE(feed(submit(USBIP_PENDING + 1, 2, true, 64)));
}

static void a_connection_that_is_gone_is_noticed(void)
{
    answers.cut = true;
    TEST_ASSERT_FALSE(feed(ask(1, 0xc0, BOARD_GET_STATUS, 64)));
    connect();
    TEST_ASSERT_TRUE(feed(submit(1, 2, true, 64)));
    board_packet(&board, NULL, 0, now);
    TEST_ASSERT_FALSE(usbip_poll(&usbip));
}

static uint32_t dice(void)
{
    seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (uint32_t)(seed >> 33);
}

/* An honest request of any kind, with random bytes for data. */
static struct message draw(uint32_t number)
{
    struct message message;
    switch (dice() % 6) {
    case 0:
        return submit(number, 2, true, 16 + dice() % 100);
    case 1:
        return command(number, (uint8_t)(1 + dice() % 3), (uint16_t)(dice() % 4));
    case 2:
        return take_back(number, number - dice() % 4);
    case 3:
        return ask(number, 0xc0, (uint8_t)(dice() % 3), (uint8_t)(dice() % 65));
    case 4:
        message = ask(number, 0x40, BOARD_SET_SETTINGS, 4);
        break;
    default:
        message = submit(number, dice() % 4, false, dice() % 65);
    }
    for (size_t i = USBIP_HEADER; i < message.size; i++) {
        message.bytes[i] = (uint8_t)(dice() % 9);
    }
    return message;
}

/* Some bytes or bits are others; now and then the message is cut short, so that the next one is out of step. */
static void mutate(struct message *message)
{
    for (uint32_t i = dice() % 4; i > 0; i--) {
        uint8_t *byte = &message->bytes[dice() % message->size];
        *byte = dice() % 2 ? (uint8_t)dice() : (uint8_t)(*byte ^ 1 << dice() % 8);
    }
    if (dice() % 16 == 0) {
        message->size = 1 + dice() % message->size;
    }
}

static bool feed_in_pieces(const struct message *message)
{
    bool good = true;
    for (size_t at = 0; at < message->size && good;) {
        size_t piece = 1 + dice() % message->size;
        piece = piece < message->size - at ? piece : message->size - at;
        good = usbip_feed(&usbip, message->bytes + at, piece);
        at += piece;
    }
    return good;
}

/* What the parsers must keep whatever comes; the sanitizers see the rest. */
static void check_sanity(void)
{
    TEST_ASSERT_TRUE(usbip.filled <= sizeof usbip.bytes);
    TEST_ASSERT_TRUE(board.commands.count <= BOARD_WAITING_MAX);
    TEST_ASSERT_TRUE(board.events.count <= BOARD_EVENTS);
    TEST_ASSERT_TRUE(board.settings.gain >= BOARD_GAIN_MIN &&
                     board.settings.gain <= BOARD_GAIN_MAX && board.settings.coast >= 1 &&
                     board.settings.coast <= BOARD_COAST_MAX);
    TEST_ASSERT_TRUE(level == (board.schedule.state == SCHEDULE_FALL));
}

/* Random requests, most of them damaged, to USB/IP and through it to the board, which must both serve the next honest
 * client. */
static void damaged_requests_do_no_harm(void)
{
    int ended = 0;
    int answered = 0;
    int exposed = 0;
    for (uint32_t i = 1; i <= MESSAGES; i++) {
        struct message message = draw(i);
        bool was = level;
        if (dice() % 3) {
            mutate(&message);
        }
        if (!feed_in_pieces(&message) || !usbip_poll(&usbip)) {
            ended++;
            connect();
        }
        if (i % 3 == 0) {
            run();
        }
        exposed += level && !was;
        check_sanity();
        if (i % 1000 == 0) {
            connect();
            answered += feed(ask(i, 0xc0, BOARD_GET_STATUS, 64)) && answers.number == i &&
                        answers.status == 0;
        }
    }
    TEST_ASSERT_EQUAL_INT(MESSAGES / 1000, answered);
    /* Most messages were taken, some were not, and the board was at work. */
    TEST_ASSERT_TRUE(answers.count > MESSAGES / 4);
    TEST_ASSERT_TRUE(ended > MESSAGES / 100);
    TEST_ASSERT_TRUE(exposed > 100);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(control_transfers_are_answered_at_once);
    RUN_TEST(settings_come_behind_their_request);
    RUN_TEST(events_are_waited_for_and_requests_may_come_byte_by_byte);
    RUN_TEST(what_is_taken_back_is_not_answered_twice);
    RUN_TEST(two_requests_in_one_piece_are_both_answered);
    RUN_TEST(requests_that_make_no_sense_end_the_connection);
    RUN_TEST(a_number_in_use_and_one_transfer_too_many_end_the_connection);
    RUN_TEST(a_connection_that_is_gone_is_noticed);
    RUN_TEST(damaged_requests_do_no_harm);
    return UNITY_END();
}
