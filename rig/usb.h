/* The USB seam: what a device's back end needs of the bus. libusb in the product, a simulated board in tests. */
#ifndef RIG_USB_H
#define RIG_USB_H

#include "nacre/error.h"

#include <stdint.h>

/* What a transfer comes to when it moves no bytes; otherwise their number. */
enum usb_result {
    USB_TIMEOUT = -1, /* nothing moved in time */
    USB_STALL = -2,   /* refused by the device; a bulk endpoint has been cleared for the next try */
    USB_GONE = -3,    /* the device is not there any more */
    USB_BROKEN = -4,  /* the bus or the system failed */
};

struct usb;

struct usb_ops {
    /* On endpoint 0; bit 7 of `type` set: in. */
    int (*control)(struct usb *usb, uint8_t type, uint8_t request, uint16_t value, void *data,
                   uint16_t size, int timeout_ms);
    /* One bulk transfer, of one packet. */
    int (*out)(struct usb *usb, uint8_t endpoint, const void *data, int size, int timeout_ms);
    int (*in)(struct usb *usb, uint8_t endpoint, void *data, int size, int timeout_ms);
    void (*close)(struct usb *usb);
};

/* An open device. A concrete one embeds this as its first member. */
struct usb {
    const struct usb_ops *ops;
};

struct usb_port;

struct usb_port_ops {
    /* Open the device that is plugged in, or will be within `wait_ms`. */
    int (*open)(struct usb_port *port, int wait_ms, struct usb **usb, struct nacre_error *error);
    void (*close)(struct usb_port *port);
};

/* A place where a device is plugged in, pulled out and plugged in again. */
struct usb_port {
    const struct usb_port_ops *ops;
};

#endif
