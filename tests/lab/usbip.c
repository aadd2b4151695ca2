/* The device's end of a USB/IP connection: SUBMIT and UNLINK of control and bulk transfers. */
#include "usbip.h"

#include <errno.h>
#include <string.h>

enum { SUBMIT = 1, UNLINK = 2, SUBMITTED = 3, UNLINKED = 4, ENDPOINTS = 16 };

/* Where the numbers of a header are. */
enum { COMMAND = 0, NUMBER = 4, DIRECTION = 12, ENDPOINT = 16, STATUS = 20 };
enum { LENGTH = 24, PACKETS = 32, SETUP = 40, UNLINK_NUMBER = 20 };

static uint32_t get32(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

static void put32(uint8_t *bytes, uint32_t value)
{
    bytes[0] = (uint8_t)(value >> 24);
    bytes[1] = (uint8_t)(value >> 16);
    bytes[2] = (uint8_t)(value >> 8);
    bytes[3] = (uint8_t)value;
}

void usbip_init(struct usbip *usbip, const struct usbip_ops *ops, void *context)
{
    memset(usbip, 0, sizeof *usbip);
    usbip->ops = ops;
    usbip->context = context;
}

/* The answer to a transfer that came to `moved`. */
static bool submitted(struct usbip *usbip, uint32_t number, bool in, int moved, const uint8_t *data)
{
    uint8_t answer[USBIP_HEADER + USBIP_DATA] = {0};
    int status = moved >= 0 ? 0 : moved == USBIP_STALL ? -EPIPE : -EPROTO;
    int size = moved >= 0 ? moved : 0;
    size_t behind = in ? (size_t)size : 0;
    put32(answer + COMMAND, SUBMITTED);
    put32(answer + NUMBER, number);
    put32(answer + STATUS, (uint32_t)status);
    put32(answer + LENGTH, (uint32_t)size);
    if (behind > 0) {
        memcpy(answer + USBIP_HEADER, data, behind);
    }
    return usbip->ops->reply(usbip->context, answer, USBIP_HEADER + behind);
}

/* False only when the connection is gone. */
static bool attempt(struct usbip *usbip, struct usbip_transfer *transfer)
{
    const struct usbip_ops *ops = usbip->ops;
    int moved = transfer->in
                    ? ops->in(usbip->context, transfer->endpoint, transfer->data, transfer->size)
                    : ops->out(usbip->context, transfer->endpoint, transfer->data, transfer->size);
    if (moved == USBIP_NAK) {
        return true;
    }
    bool good = submitted(usbip, transfer->number, transfer->in, moved, transfer->data);
    transfer->number = 0;
    return good;
}

static struct usbip_transfer *find(struct usbip *usbip, uint32_t number)
{
    for (int i = 0; i < USBIP_PENDING; i++) {
        if (usbip->pending[i].number == number) {
            return &usbip->pending[i];
        }
    }
    return NULL;
}

static bool submit(struct usbip *usbip, const uint8_t *request, const uint8_t *data)
{
    uint32_t number = get32(request + NUMBER);
    uint8_t endpoint = (uint8_t)get32(request + ENDPOINT);
    bool in = get32(request + DIRECTION) == 1;
    int size = (int)get32(request + LENGTH);
    if (endpoint == 0) {
        uint8_t bytes[USBIP_DATA] = {0};
        if (!in && size > 0) {
            memcpy(bytes, data, (size_t)size);
        }
        int moved = usbip->ops->control(usbip->context, request + SETUP, bytes, size);
        return submitted(usbip, number, in, moved > size ? size : moved, bytes);
    }
    struct usbip_transfer *transfer = find(usbip, 0);
    if (!transfer || find(usbip, number)) {
        return false;
    }
    transfer->number = number;
    transfer->endpoint = endpoint;
    transfer->in = in;
    transfer->size = size;
    if (!in && size > 0) {
        memcpy(transfer->data, data, (size_t)size);
    }
    return attempt(usbip, transfer);
}

/* A transfer that was taken back has no answer of its own; one that is over already has had it. */
static bool take_back(struct usbip *usbip, const uint8_t *request)
{
    uint8_t answer[USBIP_HEADER] = {0};
    uint32_t number = get32(request + UNLINK_NUMBER);
    struct usbip_transfer *transfer = number ? find(usbip, number) : NULL;
    put32(answer + COMMAND, UNLINKED);
    put32(answer + NUMBER, get32(request + NUMBER));
    put32(answer + STATUS, transfer ? (uint32_t)-ECONNRESET : 0);
    if (transfer) {
        transfer->number = 0;
    }
    return usbip->ops->reply(usbip->context, answer, sizeof answer);
}

/* Bytes that follow a header; negative when no honest kernel would send it. */
static int size_behind(const uint8_t *request)
{
    uint32_t command = get32(request + COMMAND);
    uint32_t size = get32(request + LENGTH);
    uint32_t packets = get32(request + PACKETS);
    if (get32(request + NUMBER) == 0 || get32(request + DIRECTION) > 1 ||
        get32(request + ENDPOINT) >= ENDPOINTS) {
        return -1;
    }
    if (command == UNLINK) {
        return 0;
    }
    if (command != SUBMIT || size > USBIP_DATA || (packets != 0 && packets != UINT32_MAX)) {
        return -1;
    }
    return get32(request + DIRECTION) == 0 ? (int)size : 0;
}

/* The size of the whole request, as far as it is known yet; 0: it makes no sense. */
static size_t wanted(const struct usbip *usbip)
{
    if (usbip->filled < USBIP_HEADER) {
        return USBIP_HEADER;
    }
    int behind = size_behind(usbip->bytes);
    return behind < 0 ? 0 : USBIP_HEADER + (size_t)behind;
}

static bool obey(struct usbip *usbip)
{
    usbip->filled = 0;
    return get32(usbip->bytes + COMMAND) == SUBMIT
               ? submit(usbip, usbip->bytes, usbip->bytes + USBIP_HEADER)
               : take_back(usbip, usbip->bytes);
}

bool usbip_feed(struct usbip *usbip, const uint8_t *bytes, size_t size)
{
    while (size > 0) {
        size_t whole = wanted(usbip);
        size_t part = whole - usbip->filled;
        part = part < size ? part : size;
        memcpy(usbip->bytes + usbip->filled, bytes, part);
        usbip->filled += part;
        bytes += part;
        size -= part;
        whole = wanted(usbip);
        if (whole == 0 || (usbip->filled == whole && !obey(usbip))) {
            return false;
        }
    }
    return true;
}

bool usbip_poll(struct usbip *usbip)
{
    bool good = true;
    for (int i = 0; i < USBIP_PENDING && good; i++) {
        if (usbip->pending[i].number != 0) {
            good = attempt(usbip, &usbip->pending[i]);
        }
    }
    return good;
}
