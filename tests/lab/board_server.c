/* A trigger board behind vhci-hcd. simavr takes more than a second for one of the board's in an emulated guest, so it only
 * tells the descriptors that the firmware has; what the board decides is the firmware's own portable half, with a timer whose
 * edges come at the very tick. */
#include "board_server.h"

#include "firmware/board.h"
#include "firmware/pin.h"
#include "simulated.h"
#include "unity.h"
#include "usbip.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

/* The kernel's: a device on bus 1; full speed. A round of the board's main loop, ticks. */
enum { DEVICE = 0x10002, FULL_SPEED = 2, ROUND = 8000, PACKET = 64, DESCRIPTORS = 5 };

static const double tick_ns = 1e9 / CYCLES_PER_SECOND;

/* Value of GET_DESCRIPTOR, and what the firmware answers. */
struct descriptor {
    uint16_t value;
    int size;
    uint8_t bytes[PACKET];
};

struct server {
    struct board board;
    struct descriptor descriptors[DESCRIPTORS];
    struct usbip usbip;
    struct board_view *view;
    int socket, protocol;
    uint8_t configuration;
    int64_t zero_ns;      /* the board's tick 0 on our clock */
    uint64_t now;         /* ticks */
    double pulse, period; /* the wheel's next index, ticks */
};

/* The trigger's pin and the timer that moves it. */
static struct {
    struct server *server;
    bool armed, armed_high, level, came;
    uint64_t ticks;
} pin;

static int64_t now_ns(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now); /* cannot fail */
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static void move_pin(bool high, uint64_t ticks)
{
    struct board_view *view = pin.server->view;
    long long time_ns = pin.server->zero_ns + (int64_t)((double)ticks * tick_ns);
    pin.level = high;
    if (high) {
        view->rise_ns = time_ns;
        view->rise_tick = ticks;
        view->rises++;
    } else {
        view->fall_ns = time_ns;
        view->fall_tick = ticks;
    }
    view->level = high;
}

bool pin_arm(uint64_t ticks, bool high)
{
    pin.armed = true;
    pin.armed_high = high;
    pin.ticks = ticks;
    return true;
}

bool pin_low(uint64_t *ticks)
{
    bool high = pin.level;
    pin.armed = pin.came = false;
    *ticks = pin.server->now;
    if (high) {
        move_pin(false, *ticks);
    }
    return high;
}

/* As main.c does it. */
static void round_once(struct server *server)
{
    server->now += ROUND;
    if (pin.armed && pin.ticks <= server->now) {
        pin.armed = false;
        move_pin(pin.armed_high, pin.ticks);
        board_edge(&server->board, pin.ticks);
    }
    while (server->pulse <= (double)server->now) {
        if (!server->view->wheel_stops) {
            board_index(&server->board, (uint64_t)server->pulse);
        }
        server->pulse += server->period;
    }
    board_poll(&server->board, server->now);
}

static void catch_up(struct server *server)
{
    double now = (double)(now_ns() - server->zero_ns) / tick_ns;
    while ((double)server->now + ROUND <= now) {
        round_once(server);
    }
}

static int get_descriptor(const struct server *server, uint16_t value, uint8_t *data, int length)
{
    for (int i = 0; i < DESCRIPTORS; i++) {
        const struct descriptor *descriptor = &server->descriptors[i];
        if (descriptor->value == value) {
            int size = length < descriptor->size ? length : descriptor->size;
            memcpy(data, descriptor->bytes, (size_t)size);
            return size;
        }
    }
    return USBIP_STALL;
}

static int get_status(const struct server *server, uint8_t *data, int length)
{
    struct board_status status;
    board_status(&server->board, server->now, &status);
    if (server->protocol) {
        status.protocol = (uint8_t)server->protocol;
    }
    length = length < (int)sizeof status ? length : (int)sizeof status;
    memcpy(data, &status, (size_t)length);
    return length;
}

static int set_settings(struct server *server, const uint8_t *data, int length)
{
    struct board_settings settings;
    if (length != (int)sizeof settings) {
        return USBIP_STALL;
    }
    memcpy(&settings, data, sizeof settings);
    return board_set(&server->board, &settings) ? length : USBIP_STALL;
}

/* As usb.c does it. */
static int control(void *context, const uint8_t setup[8], uint8_t *data, int size)
{
    struct server *server = context;
    int length = setup[6] | setup[7] << 8;
    uint16_t value = (uint16_t)(setup[2] | setup[3] << 8);
    if (length > size) {
        return USBIP_STALL;
    }
    switch (setup[0] << 8 | setup[1]) {
    case 0x8006:
        return get_descriptor(server, value, data, length);
    case 0xc000 | BOARD_GET_STATUS:
        return get_status(server, data, length);
    case 0x4000 | BOARD_SET_SETTINGS:
        return set_settings(server, data, length);
    case 0x8008:
        data[0] = server->configuration;
        return length < 1 ? length : 1;
    case 0x0009:
        server->configuration = (uint8_t)value;
        return value <= 1 ? 0 : USBIP_STALL;
    case 0x010b: /* the only alternate setting, and ends of a halt that never was */
    case 0x0201:
        return 0;
    default:
        return USBIP_STALL;
    }
}

static int out(void *context, uint8_t endpoint, const uint8_t *data, int size)
{
    struct server *server = context;
    if (endpoint != 1 || size > PACKET) {
        return USBIP_STALL;
    }
    board_packet(&server->board, data, (uint8_t)size, server->now);
    return size;
}

static int in(void *context, uint8_t endpoint, uint8_t *data, int size)
{
    struct board_event event;
    int moved = 0;
    if (endpoint != 2) {
        return USBIP_STALL;
    }
    while (moved + (int)sizeof event <= size && moved < PACKET &&
           board_event(&((struct server *)context)->board, &event)) {
        memcpy(data + moved, &event, sizeof event);
        moved += (int)sizeof event;
    }
    return moved > 0 ? moved : USBIP_NAK;
}

static bool reply(void *context, const uint8_t *bytes, size_t size)
{
    const struct server *server = context;
    while (size > 0) {
        ssize_t sent = send(server->socket, bytes, size, MSG_NOSIGNAL);
        if (sent <= 0) {
            return false;
        }
        bytes += sent;
        size -= (size_t)sent;
    }
    return true;
}

/* One round; false when the connection has ended. */
static bool serve_once(struct server *server)
{
    uint8_t bytes[4096];
    struct pollfd wait = {.fd = server->socket, .events = POLLIN};
    int ready = poll(&wait, 1, 1);
    catch_up(server);
    if (ready > 0) {
        ssize_t size = recv(server->socket, bytes, sizeof bytes, 0);
        if (size <= 0) {
            return false;
        }
        if (!usbip_feed(&server->usbip, bytes, (size_t)size)) {
            server->view->broken = true;
            return false;
        }
    }
    return usbip_poll(&server->usbip);
}

/* What the real firmware says that it is. */
static bool ask_descriptors(struct descriptor descriptors[DESCRIPTORS])
{
    static const uint16_t values[DESCRIPTORS] = {0x0100, 0x0200, 0x0300, 0x0301, 0x0302};
    struct simulated *board = simulated_new();
    bool good = board && simulated_enumerate(board);
    for (int i = 0; i < DESCRIPTORS && good; i++) {
        descriptors[i].value = values[i];
        descriptors[i].size =
            simulated_control(board, 0x80, 6, values[i], 0, descriptors[i].bytes, PACKET, 100);
        good = descriptors[i].size > 0;
    }
    simulated_free(board);
    return good;
}

/* The life of the server's process. */
static void serve(struct board_server_settings settings, int socket, struct board_view *view)
{
    static const struct usbip_ops ops = {control, out, in, reply};
    static struct server server;
    if (!ask_descriptors(server.descriptors)) {
        _exit(1);
    }
    server.view = view;
    server.socket = socket;
    server.protocol = settings.protocol;
    server.period = CYCLES_PER_SECOND / settings.wheel_hz;
    server.pulse = server.period;
    server.zero_ns = now_ns();
    pin.server = &server;
    usbip_init(&server.usbip, &ops, &server);
    board_start(&server.board, 0);
    view->ready = true;
    while (serve_once(&server)) {
    }
    _exit(0);
}

/* The port is free only a moment after what was plugged in there before has gone. */
static void attach(int port, int socket)
{
    char line[64];
    bool good = false;
    int size = snprintf(line, sizeof line, "%d %d %d %d", port, socket, DEVICE, FULL_SPEED);
    for (int i = 0; i < 500 && !good; i++) {
        int file = open("/sys/devices/platform/vhci_hcd.0/attach", O_WRONLY | O_CLOEXEC);
        TEST_ASSERT_TRUE(file >= 0);
        good = write(file, line, (size_t)size) == size;
        (void)close(file);
        (void)usleep(10000);
    }
    TEST_ASSERT_TRUE_MESSAGE(good, line);
}

struct board_server board_server_plug(struct board_server_settings settings)
{
    int sockets[2];
    struct board_server server = {.view = mmap(NULL, sizeof *server.view, PROT_READ | PROT_WRITE,
                                               MAP_SHARED | MAP_ANONYMOUS, -1, 0)};
    TEST_ASSERT_TRUE(server.view != MAP_FAILED);
    TEST_ASSERT_EQUAL_INT(0, socketpair(AF_UNIX, SOCK_STREAM, 0, sockets));
    (void)fflush(stdout);
    server.process = fork();
    TEST_ASSERT_TRUE(server.process >= 0);
    if (server.process == 0) {
        (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
        (void)close(sockets[0]);
        serve(settings, sockets[1], server.view);
    }
    (void)close(sockets[1]);
    for (int i = 0; i < 2000 && !server.view->ready; i++) {
        (void)usleep(10000);
    }
    TEST_ASSERT_TRUE_MESSAGE(server.view->ready, "the board's server does not begin");
    attach(settings.port, sockets[0]);
    (void)close(sockets[0]);
    return server;
}

void board_server_unplug(struct board_server *server)
{
    if (server->process == 0) {
        return;
    }
    (void)kill(server->process, SIGKILL);
    (void)waitpid(server->process, NULL, 0);
    (void)munmap(server->view, sizeof *server->view);
    *server = (struct board_server){0};
}
