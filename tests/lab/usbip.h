/* The device's end of a USB/IP connection: takes the kernel's requests from a stream of bytes and answers them. */
#ifndef TESTS_LAB_USBIP_H
#define TESTS_LAB_USBIP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* What a transfer comes to when it moves no bytes; otherwise their number. */
enum { USBIP_NAK = -1, USBIP_STALL = -2, USBIP_DEAD = -3 };

/* Sizes beyond which a request is hostile. */
enum { USBIP_HEADER = 48, USBIP_DATA = 4096, USBIP_PENDING = 16 };

/* The device, and the way back to the kernel. */
struct usbip_ops {
    /* On endpoint 0; never NAK. `data` holds or takes up to `size` bytes. */
    int (*control)(void *context, const uint8_t setup[8], uint8_t *data, int size);
    /* One packet. NAK: tried again at usbip_poll. */
    int (*out)(void *context, uint8_t endpoint, const uint8_t *data, int size);
    int (*in)(void *context, uint8_t endpoint, uint8_t *data, int size);
    /* False: the connection is gone. */
    bool (*reply)(void *context, const uint8_t *bytes, size_t size);
};

/* A bulk transfer that the device has not taken, or has nothing for, yet. */
struct usbip_transfer {
    uint32_t number; /* of the request; 0: none */
    uint8_t endpoint;
    bool in;
    int size;
    uint8_t data[USBIP_DATA];
};

/* One connection; large. */
struct usbip {
    const struct usbip_ops *ops;
    void *context;
    size_t filled; /* bytes of a request that has not come whole */
    uint8_t bytes[USBIP_HEADER + USBIP_DATA];
    struct usbip_transfer pending[USBIP_PENDING];
};

void usbip_init(struct usbip *usbip, const struct usbip_ops *ops, void *context);

/* Bytes have come from the kernel, cut anywhere. False when they make no sense or the connection is gone: it must be closed
 * then. */
bool usbip_feed(struct usbip *usbip, const uint8_t *bytes, size_t size);

/* Try again what is pending. False as above. */
bool usbip_poll(struct usbip *usbip);

#endif
