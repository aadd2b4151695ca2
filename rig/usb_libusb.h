/* USB devices by libusb: lists those of one kind and opens them, at a place or wherever there is one. */
#ifndef RIG_USB_LIBUSB_H
#define RIG_USB_LIBUSB_H

#include "nacre/error.h"
#include "rig/usb.h"

#include <stddef.h>

/* "1-4.2": bus 1, port 4, port 2 of the hub there; the kernel's name too. Holds as long as the cable stays. */
struct usb_place {
    char name[32];
};

/* What to look for. */
struct usb_kind {
    const char *what; /* "trigger board", for messages */
    uint16_t vendor, product;
    const char *remedy; /* against lacking permission */
};

/* The places of all such devices, in order; heap. */
int usb_libusb_list(const struct usb_kind *kind, struct usb_place **places, size_t *count,
                    struct nacre_error *error);

/* The port at `place`, or wherever the only such device is (NULL). Both arguments are copied. */
int usb_libusb_port(const struct usb_kind *kind, const char *place, struct usb_port **port,
                    struct nacre_error *error);

#endif
