/* The trigger board behind the trigger seam. */
#include "rig/trigger_usb.h"

#include <inttypes.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* A transfer takes about a millisecond; a board that takes longer hangs. */
enum { TRANSFER_MS = 500, REPLUG_MS = 3000, PACKET = 64, TRIES = 2, SYNCS = 3 };
/* The wheel must be found within this. */
static const int64_t search_ns = 10000000000;
static const int64_t poll_ns = 50000000;

const struct usb_kind trigger_usb_kind = {
    .what = "trigger board",
    .vendor = BOARD_VENDOR_ID,
    .product = BOARD_PRODUCT_ID,
    .remedy =
        "install udev/70-nacre-trigger.rules, plug the board in again, and be in the group nacre"};

struct usb_trigger {
    struct trigger base;
    struct usb_port *port;
    struct usb *usb; /* NULL after it was unplugged */
    struct clock *clock;
    uint8_t in, out; /* endpoints */
    uint16_t id;     /* of the last exposure */
};

/* The board cannot be trusted any more: it is opened anew next time. */
static void drop(struct usb_trigger *trigger)
{
    if (trigger->usb) {
        trigger->usb->ops->close(trigger->usb);
        trigger->usb = NULL;
    }
}

static int control(const struct usb_trigger *trigger, uint8_t type, uint8_t request, uint16_t value,
                   void *data, uint16_t size)
{
    struct usb *usb = trigger->usb;
    return usb ? usb->ops->control(usb, type, request, value, data, size, TRANSFER_MS) : USB_GONE;
}

/* A bulk transfer; a stalled endpoint has been cleared and is tried again. */
static int send_packet(const struct usb_trigger *trigger, const void *data, int size)
{
    int moved = USB_STALL;
    for (int try = 0; try < TRIES && moved == USB_STALL; try++) {
        moved = trigger->usb
                    ? trigger->usb->ops->out(trigger->usb, trigger->out, data, size, TRANSFER_MS)
                    : USB_GONE;
    }
    return moved;
}

static int receive_packet(const struct usb_trigger *trigger, void *data, int size, int timeout_ms)
{
    int moved = USB_STALL;
    for (int try = 0; try < TRIES && moved == USB_STALL; try++) {
        moved = trigger->usb
                    ? trigger->usb->ops->in(trigger->usb, trigger->in, data, size, timeout_ms)
                    : USB_GONE;
    }
    return moved;
}

/* Fail for a transfer that came to `result`. */
static int fail_transfer(struct usb_trigger *trigger, int result, const char *what,
                         struct nacre_error *error)
{
    if (result == USB_STALL) {
        return nacre_fail(error, "trigger board: refuses %s; is its firmware nacre's?", what);
    }
    drop(trigger);
    switch (result) {
    case USB_GONE:
        return nacre_fail(error, "trigger board: was unplugged during %s; plug it in again", what);
    case USB_TIMEOUT:
        return nacre_fail(
            error, "trigger board: does not answer %s within %d ms; unplug it and plug it in again",
            what, TRANSFER_MS);
    default:
        return nacre_fail(
            error, "trigger board: the USB transfer of %s failed; look at the kernel's log", what);
    }
}

/* The first bulk endpoints of each direction in a configuration descriptor. */
static bool find_endpoints(const uint8_t *bytes, int size, uint8_t *in, uint8_t *out)
{
    *in = *out = 0;
    for (int at = 0; at + 2 <= size && bytes[at] >= 2 && at + bytes[at] <= size; at += bytes[at]) {
        bool bulk = bytes[at + 1] == 5 && bytes[at] >= 7 && (bytes[at + 3] & 3) == 2;
        if (bulk && bytes[at + 2] & 0x80) {
            *in = *in ? *in : bytes[at + 2];
        } else if (bulk) {
            *out = *out ? *out : bytes[at + 2];
        }
    }
    return *in && *out;
}

static int get_status(struct usb_trigger *trigger, struct board_status *status,
                      struct nacre_error *error)
{
    uint8_t bytes[PACKET] = {0};
    int size = control(trigger, 0xc0, BOARD_GET_STATUS, 0, bytes, sizeof bytes);
    if (size < 0) {
        return fail_transfer(trigger, size, "its status", error);
    }
    memcpy(status, bytes, sizeof *status);
    if (size > 0 && status->protocol != BOARD_PROTOCOL) {
        return nacre_fail(error,
                          "trigger board: its firmware speaks protocol %d and this program %d; "
                          "write the firmware "
                          "anew with `meson compile flash`",
                          status->protocol, BOARD_PROTOCOL);
    }
    if (size < (int)sizeof *status || status->size < sizeof *status) {
        return nacre_fail(
            error,
            "trigger board: its status has %d bytes in place of %zu; write its firmware anew", size,
            sizeof *status);
    }
    return NACRE_OK;
}

static int send(struct usb_trigger *trigger, uint8_t kind, uint16_t turns,
                struct nacre_error *error)
{
    struct board_command command = {.command = kind, .id = trigger->id, .turns = turns};
    int moved = send_packet(trigger, &command, sizeof command);
    if (moved >= 0 && moved < (int)sizeof command) {
        moved = USB_BROKEN;
    }
    return moved < 0 ? fail_transfer(trigger, moved, "a command", error) : NACRE_OK;
}

/* Up to four events of one packet; their number, 0 when none came in time, or a usb_result. */
static int receive(struct usb_trigger *trigger, struct board_event events[4], int timeout_ms)
{
    uint8_t bytes[PACKET];
    int moved = receive_packet(trigger, bytes, sizeof bytes, timeout_ms);
    if (moved == USB_TIMEOUT) {
        return 0;
    }
    if (moved > 0 && moved % (int)sizeof *events != 0) {
        return USB_BROKEN; /* cut off: what it said of the exposure is not known */
    }
    if (moved > 0) {
        memcpy(events, bytes, (size_t)moved);
    }
    return moved < 0 ? moved : moved / (int)sizeof *events;
}

/* Nothing may be left of what an earlier program asked for. */
static int clear_board(struct usb_trigger *trigger, struct nacre_error *error)
{
    struct board_event events[4];
    int count = 1;
    int status = send(trigger, BOARD_ABORT, 0, error);
    if (status != NACRE_OK) {
        return status;
    }
    for (int round = 0; count > 0 && round < 16; round++) {
        count = receive(trigger, events, 20);
    }
    return count < 0 ? fail_transfer(trigger, count, "its events", error) : NACRE_OK;
}

/* Open the board if it is not, within `wait_ms`. */
static int connect(struct usb_trigger *trigger, int wait_ms, struct nacre_error *error)
{
    uint8_t bytes[PACKET];
    struct board_status status;
    if (trigger->usb) {
        return NACRE_OK;
    }
    int result = trigger->port->ops->open(trigger->port, wait_ms, &trigger->usb, error);
    if (result != NACRE_OK) {
        trigger->usb = NULL;
        return result;
    }
    int size = control(trigger, 0x80, 6, 0x0200, bytes, sizeof bytes);
    if (size < 0) {
        result = fail_transfer(trigger, size, "its descriptors", error);
        goto out;
    }
    if (!find_endpoints(bytes, size, &trigger->in, &trigger->out)) {
        result = nacre_fail(
            error, "trigger board: has no bulk endpoints in both directions; is it nacre's board?");
        goto out;
    }
    result = get_status(trigger, &status, error);
    if (result != NACRE_OK) {
        goto out;
    }
    result = clear_board(trigger, error);
out:
    if (result != NACRE_OK) {
        drop(trigger);
    }
    return result;
}

double trigger_usb_wheel_hz(const struct board_status *status)
{
    uint64_t period = board_get48(status->period);
    return period > 0 && status->tick_hz > 0 ? 65536.0 * status->tick_hz / (double)period : 0;
}

/* The loop's time constant is 2^(gain + 1) turns; after four of them, 2 % is left of what it began with. */
static unsigned turns_missing(const struct board_status *status)
{
    unsigned wanted = 8U << status->settings.gain;
    return status->locked_turns < wanted ? wanted - status->locked_turns : 0;
}

/* How long a locked loop takes to settle, and a second for good measure. */
static int64_t settle_ns(const struct board_status *status)
{
    double hz = trigger_usb_wheel_hz(status);
    return 1000000000 + (hz > 0 ? (int64_t)(turns_missing(status) * 1e9 / hz) : 0);
}

static int fail_unsettled(const struct board_status *status, bool found, struct nacre_error *error)
{
    if (found) {
        return nacre_fail(error,
                          "trigger board: loses the colour wheel again and again (%d spurious "
                          "pulses, %d missed, lost %d times); does the photodiode see its index "
                          "clearly?",
                          status->spurious, status->missed, status->unlocks);
    }
    return nacre_fail(error,
                      "trigger board: finds no colour wheel within %" PRId64
                      " s (%d spurious pulses, %d missed); does the projector run, and does the "
                      "photodiode see its index?",
                      search_ns / 1000000000, status->spurious, status->missed);
}

/* A slow gain takes the time that it needs: up to 102 s for gain 6 on a wheel of 5 Hz. */
static int wait_settled(struct usb_trigger *trigger, struct board_status *status,
                        struct nacre_error *error)
{
    int64_t end = clock_now_ns(trigger->clock) + search_ns;
    bool found = false;
    for (;;) {
        int result = get_status(trigger, status, error);
        bool locked = (status->state & BOARD_LOCKED) != 0;
        if (result != NACRE_OK || (locked && turns_missing(status) == 0)) {
            return result;
        }
        int64_t now = clock_now_ns(trigger->clock);
        if (locked && !found) {
            end = now + settle_ns(status);
            found = true;
        }
        if (now >= end) {
            return fail_unsettled(status, found, error);
        }
        clock_sleep_until_ns(trigger->clock, now + poll_ns);
    }
}

/* How many turns the exposure is; it must be a whole number of them to half a percent. */
static int turns_of(const struct board_status *status, int64_t exposure_ns, uint16_t *turns,
                    struct nacre_error *error)
{
    double hz = trigger_usb_wheel_hz(status);
    double wanted = (double)exposure_ns * 1e-9 * hz;
    double whole = round(wanted);
    if (whole < 1 || whole > BOARD_TURNS_MAX || fabs(wanted - whole) > 0.005 * whole) {
        return nacre_fail(
            error,
            "trigger board: an exposure of %.3f ms is %.3f turns of the colour wheel, which makes "
            "%.3f a second, not a whole number from 1 to %d; correct projector.wheel_hz",
            (double)exposure_ns * 1e-6, wanted, hz, BOARD_TURNS_MAX);
    }
    *turns = (uint16_t)whole;
    return NACRE_OK;
}

/* The time of a stamp on our clock, by the status that took the least time to get. */
static int host_time(struct usb_trigger *trigger, uint64_t stamp, int64_t *time_ns,
                     struct nacre_error *error)
{
    int64_t shortest = INT64_MAX;
    for (int i = 0; i < SYNCS; i++) {
        struct board_status status = {.protocol = 0};
        int64_t before = clock_now_ns(trigger->clock);
        int result = get_status(trigger, &status, error);
        if (result != NACRE_OK) {
            return result;
        }
        int64_t after = clock_now_ns(trigger->clock);
        if (after - before < shortest) {
            uint64_t ago = (board_get48(status.now) - stamp) & ((UINT64_C(1) << 48) - 1);
            shortest = after - before;
            *time_ns = before + shortest / 2 - (int64_t)((double)ago * 1e9 / (double)BOARD_TICK_HZ);
        }
    }
    return NACRE_OK;
}

static const char *refusal(uint8_t detail)
{
    switch (detail) {
    case BOARD_FULL:
        return "too many exposures wait";
    case BOARD_BAD_TURNS:
        return "the number of turns is outside its range";
    default:
        return "it does not understand the command";
    }
}

/* What one event means for our exposure: sets *done at its end, and *trigger_ns at its beginning. */
static int judge(struct usb_trigger *trigger, const struct board_event *event, int64_t *trigger_ns,
                 bool *done, struct nacre_error *error)
{
    if (event->event == BOARD_STARTED) {
        return nacre_fail(error,
                          "trigger board: was reset during an exposure; look at its power supply");
    }
    if (event->event == BOARD_UNLOCK || event->event == BOARD_LOCK || event->id != trigger->id) {
        return NACRE_OK; /* what it means for the exposure has an event of its own */
    }
    switch (event->event) {
    case BOARD_RISE:
        return host_time(trigger, board_get48(event->stamp), trigger_ns, error);
    case BOARD_FALL:
        *done = true;
        if (event->detail) {
            return nacre_fail(error,
                              "trigger board: ended the exposure late, as the colour wheel jumped");
        }
        return NACRE_OK;
    case BOARD_LOST:
        return nacre_fail(error,
                          "trigger board: lost the colour wheel during the exposure and ended it");
    case BOARD_ABORTED:
        return nacre_fail(
            error, "trigger board: the exposure was aborted; does another program use the board?");
    case BOARD_REFUSED:
        return nacre_fail(error, "trigger board: refuses the exposure, as %s",
                          refusal(event->detail));
    default:
        return NACRE_OK;
    }
}

/* Listen until the exposure has ended. */
static int follow(struct usb_trigger *trigger, int64_t longest_ns, int64_t *trigger_ns,
                  struct nacre_error *error)
{
    int64_t end = clock_now_ns(trigger->clock) + longest_ns;
    bool done = false;
    int status = NACRE_OK;
    *trigger_ns = INT64_MIN;
    while (status == NACRE_OK && !done) {
        struct board_event events[4];
        int count = receive(trigger, events, 100);
        if (count < 0) {
            return fail_transfer(trigger, count, "an exposure", error);
        }
        if (count == 0 && clock_now_ns(trigger->clock) > end) {
            return nacre_fail(error, "trigger board: did not end the exposure in %.1f s",
                              (double)longest_ns * 1e-9);
        }
        for (int i = 0; i < count && status == NACRE_OK && !done; i++) {
            status = judge(trigger, &events[i], trigger_ns, &done, error);
        }
    }
    if (status == NACRE_OK && *trigger_ns == INT64_MIN) {
        status = nacre_fail(error, "trigger board: did not tell when the exposure began");
    }
    return status;
}

static int fire(struct trigger *base, int64_t exposure_ns, int64_t *trigger_ns,
                struct nacre_error *error)
{
    struct usb_trigger *trigger = (struct usb_trigger *)base;
    struct board_status status = {.protocol = 0};
    uint16_t turns = 1;
    int result = connect(trigger, REPLUG_MS, error);
    if (result != NACRE_OK) {
        return result;
    }
    result = wait_settled(trigger, &status, error);
    if (result != NACRE_OK) {
        return result;
    }
    result = turns_of(&status, exposure_ns, &turns, error);
    if (result != NACRE_OK) {
        return result;
    }
    trigger->id++;
    result = send(trigger, BOARD_EXPOSE, turns, error);
    if (result == NACRE_OK) {
        /* Two turns at most until it begins, and a second for good measure. */
        result =
            follow(trigger, exposure_ns + 2 * exposure_ns / turns + 1000000000, trigger_ns, error);
        if (result != NACRE_OK && trigger->usb) {
            /* The first failure is what the caller wants to know. */
            (void)clear_board(trigger, NULL);
        }
    }
    return result;
}

static void trigger_close(struct trigger *base)
{
    struct usb_trigger *trigger = (struct usb_trigger *)base;
    drop(trigger);
    trigger->port->ops->close(trigger->port);
    free(trigger);
}

int trigger_usb_new(struct usb_port *port, struct clock *clock, struct trigger **trigger,
                    struct nacre_error *error)
{
    static const struct trigger_ops ops = {.name = "usb", .fire = fire, .close = trigger_close};
    int status = NACRE_OK;
    struct usb_trigger *made = calloc(1, sizeof *made);
    if (!made) {
        port->ops->close(port);
        return nacre_fail_memory(error, "a trigger");
    }
    *made = (struct usb_trigger){.base = {.ops = &ops}, .port = port, .clock = clock};
    status = connect(made, 0, error);
    if (status != NACRE_OK) {
        goto out;
    }
    *trigger = &made->base;
    made = NULL;
out:
    if (made) {
        trigger_close(&made->base);
    }
    return status;
}

int trigger_usb_status(struct trigger *trigger, struct board_status *status,
                       struct nacre_error *error)
{
    struct usb_trigger *board = (struct usb_trigger *)trigger;
    int result = connect(board, REPLUG_MS, error);
    return result == NACRE_OK ? get_status(board, status, error) : result;
}

int trigger_usb_set(struct trigger *trigger, const struct board_settings *settings,
                    struct nacre_error *error)
{
    struct usb_trigger *board = (struct usb_trigger *)trigger;
    struct board_settings bytes = *settings;
    int result = connect(board, REPLUG_MS, error);
    if (result != NACRE_OK) {
        return result;
    }
    int size = control(board, 0x40, BOARD_SET_SETTINGS, 0, &bytes, sizeof bytes);
    if (size == USB_STALL) {
        return nacre_fail(
            error, "trigger board: refuses gain %d and coasting over %d turns; gains are %d to %d",
            settings->gain, settings->coast, BOARD_GAIN_MIN, BOARD_GAIN_MAX);
    }
    return size < 0 ? fail_transfer(board, size, "its settings", error) : NACRE_OK;
}
