/* USB devices by libusb. */
#include "rig/usb_libusb.h"

#include <libusb.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { DEPTH = 7, ROUND_MS = 100 };

struct open_device {
    struct usb base;
    libusb_device_handle *handle;
};

struct port {
    struct usb_port base;
    struct usb_kind kind;
    struct usb_place place; /* empty: wherever there is one */
    libusb_context *context;
    libusb_hotplug_callback_handle watch;
    bool watching;
};

static int fail_libusb(struct nacre_error *error, int code, const char *what)
{
    return nacre_fail(error, "%s: %s", what, libusb_strerror(code));
}

static struct usb_place place_of(libusb_device *device)
{
    struct usb_place place;
    uint8_t ports[DEPTH];
    int depth = libusb_get_port_numbers(device, ports, DEPTH);
    size_t at =
        (size_t)snprintf(place.name, sizeof place.name, "%d", libusb_get_bus_number(device));
    for (int i = 0; i < depth && at < sizeof place.name; i++) {
        at += (size_t)snprintf(place.name + at, sizeof place.name - at, "%c%d", i == 0 ? '-' : '.',
                               ports[i]);
    }
    return place;
}

static bool is_kind(libusb_device *device, const struct usb_kind *kind)
{
    struct libusb_device_descriptor descriptor;
    return libusb_get_device_descriptor(device, &descriptor) == 0 &&
           descriptor.idVendor == kind->vendor && descriptor.idProduct == kind->product;
}

static int compare_places(const void *a, const void *b)
{
    return strcmp(((const struct usb_place *)a)->name, ((const struct usb_place *)b)->name);
}

/* The devices of the kind among `all`, in front of the array; returns how many. */
static size_t keep_kind(libusb_device **all, ssize_t count, const struct usb_kind *kind)
{
    size_t kept = 0;
    for (ssize_t i = 0; i < count; i++) {
        if (is_kind(all[i], kind)) {
            libusb_device *device = all[kept];
            all[kept++] = all[i];
            all[i] = device;
        }
    }
    return kept;
}

int usb_libusb_list(const struct usb_kind *kind, struct usb_place **places, size_t *count,
                    struct nacre_error *error)
{
    libusb_context *context = NULL;
    libusb_device **devices = NULL;
    ssize_t all = 0;
    int status = NACRE_OK;
    *places = NULL;
    *count = 0;
    int code = libusb_init(&context);
    if (code != 0) {
        status = fail_libusb(error, code, "USB");
        goto out;
    }
    all = libusb_get_device_list(context, &devices);
    if (all < 0) {
        status = fail_libusb(error, (int)all, "USB: cannot list devices");
        goto out;
    }
    *count = keep_kind(devices, all, kind);
    *places = calloc(*count + 1, sizeof **places);
    if (!*places) {
        *count = 0;
        status = nacre_fail_memory(error, "the list of USB devices");
        goto out;
    }
    for (size_t i = 0; i < *count; i++) {
        (*places)[i] = place_of(devices[i]);
    }
    qsort(*places, *count, sizeof **places, compare_places);
out:
    if (devices) {
        libusb_free_device_list(devices, 1);
    }
    if (context) {
        libusb_exit(context);
    }
    return status;
}

static int result_of(int code, int moved)
{
    if (moved > 0 || code == 0) {
        return moved; /* what came before a time-out counts */
    }
    switch (code) {
    case LIBUSB_ERROR_TIMEOUT:
        return USB_TIMEOUT;
    case LIBUSB_ERROR_PIPE:
        return USB_STALL;
    case LIBUSB_ERROR_NO_DEVICE:
        return USB_GONE;
    default:
        return USB_BROKEN;
    }
}

static int device_control(struct usb *usb, uint8_t type, uint8_t request, uint16_t value,
                          void *data, uint16_t size, int timeout_ms)
{
    int code = libusb_control_transfer(((struct open_device *)usb)->handle, type, request, value, 0,
                                       data, size, (unsigned)timeout_ms);
    return code < 0 ? result_of(code, 0) : code;
}

static int bulk(struct usb *usb, uint8_t endpoint, void *data, int size, int timeout_ms)
{
    libusb_device_handle *handle = ((struct open_device *)usb)->handle;
    int moved = 0;
    int code = libusb_bulk_transfer(handle, endpoint, data, size, &moved, (unsigned)timeout_ms);
    if (code == LIBUSB_ERROR_PIPE) {
        /* If it cannot be cleared the next try stalls again, and that is told. */
        (void)libusb_clear_halt(handle, endpoint);
    }
    return result_of(code, moved);
}

static int device_out(struct usb *usb, uint8_t endpoint, const void *data, int size, int timeout_ms)
{
    unsigned char packet[64];
    if (size < 0 || size > (int)sizeof packet) {
        return USB_BROKEN;
    }
    memcpy(packet, data, (size_t)size);
    return bulk(usb, endpoint, packet, size, timeout_ms);
}

static int device_in(struct usb *usb, uint8_t endpoint, void *data, int size, int timeout_ms)
{
    return bulk(usb, endpoint, data, size, timeout_ms);
}

static void device_close(struct usb *usb)
{
    struct open_device *device = (struct open_device *)usb;
    /* An unplugged device has no interface to give back. */
    (void)libusb_release_interface(device->handle, 0);
    libusb_close(device->handle);
    free(device);
}

static const struct usb_ops device_ops = {
    .control = device_control, .out = device_out, .in = device_in, .close = device_close};

/* Open this device and take its interface. */
static int open_one(const struct port *port, libusb_device *found, struct usb **usb,
                    struct nacre_error *error)
{
    struct usb_place place = place_of(found);
    int status = NACRE_OK;
    int code = 0;
    struct open_device *device = calloc(1, sizeof *device);
    if (!device) {
        return nacre_fail_memory(error, "a USB device");
    }
    device->base.ops = &device_ops;
    code = libusb_open(found, &device->handle);
    if (code == LIBUSB_ERROR_ACCESS) {
        status = nacre_fail(error, "%s at %s: may not be opened: permission denied; %s",
                            port->kind.what, place.name, port->kind.remedy);
        goto out;
    }
    if (code != 0) {
        status = nacre_fail(error, "%s at %s: cannot be opened: %s", port->kind.what, place.name,
                            libusb_strerror(code));
        goto out;
    }
    code = libusb_claim_interface(device->handle, 0);
    if (code == LIBUSB_ERROR_BUSY) {
        status = nacre_fail(error, "%s at %s: is in use by another program; stop that first",
                            port->kind.what, place.name);
        goto out;
    }
    if (code != 0) {
        status = nacre_fail(error, "%s at %s: its interface cannot be used: %s", port->kind.what,
                            place.name, libusb_strerror(code));
        goto out;
    }
    *usb = &device->base;
    device = NULL;
out:
    if (device && device->handle) {
        libusb_close(device->handle);
    }
    free(device);
    return status;
}

/* Which of the devices is meant; NULL and a text where that is none, or not clear. */
static libusb_device *choose(const struct port *port, libusb_device **devices, size_t count,
                             struct nacre_error *error)
{
    if (port->place.name[0] != '\0') {
        for (size_t i = 0; i < count; i++) {
            if (strcmp(place_of(devices[i]).name, port->place.name) == 0) {
                return devices[i];
            }
        }
        (void)nacre_fail(error,
                         "%s at %s: is not plugged in; plug it in there, or name another place",
                         port->kind.what, port->place.name);
        return NULL;
    }
    if (count == 0) {
        (void)nacre_fail(
            error,
            "%s: none is plugged in (USB %04x:%04x); plug one in, and look for it with lsusb",
            port->kind.what, port->kind.vendor, port->kind.product);
        return NULL;
    }
    if (count > 1) {
        (void)nacre_fail(error, "%s: %zu are plugged in, at %s and %s; name the place of one",
                         port->kind.what, count, place_of(devices[0]).name,
                         place_of(devices[1]).name);
        return NULL;
    }
    return devices[0];
}

static int try_open(const struct port *port, struct usb **usb, struct nacre_error *error)
{
    libusb_device **devices = NULL;
    int status = NACRE_FAILED;
    ssize_t all = libusb_get_device_list(port->context, &devices);
    if (all < 0) {
        return fail_libusb(error, (int)all, "USB: cannot list devices");
    }
    libusb_device *device = choose(port, devices, keep_kind(devices, all, &port->kind), error);
    if (device) {
        status = open_one(port, device, usb, error);
    }
    libusb_free_device_list(devices, 1);
    return status;
}

static int64_t now_ms(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now); /* cannot fail */
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

/* Let libusb see what is plugged in; without its hotplug events the list is simply read again later. */
static void wait_round(const struct port *port)
{
    struct timeval round = {.tv_usec = 1000L * ROUND_MS};
    if (port->watching) {
        (void)libusb_handle_events_timeout_completed(port->context, &round, NULL);
    } else {
        const struct timespec pause = {.tv_nsec = 1000000L * ROUND_MS};
        (void)nanosleep(&pause, NULL);
    }
}

/* Any failure may pass within the time: the device may come, and udev grants access only a moment after. */
static int port_open(struct usb_port *base, int wait_ms, struct usb **usb,
                     struct nacre_error *error)
{
    const struct port *port = (const struct port *)base;
    int64_t end = now_ms() + wait_ms;
    int status = try_open(port, usb, error);
    while (status != NACRE_OK && now_ms() < end) {
        wait_round(port);
        status = try_open(port, usb, error);
    }
    return status;
}

static void port_close(struct usb_port *base)
{
    struct port *port = (struct port *)base;
    if (port->watching) {
        libusb_hotplug_deregister_callback(port->context, port->watch);
    }
    if (port->context) {
        libusb_exit(port->context);
    }
    free(port);
}

/* Only to end a round of waiting. */
static int plugged_in(libusb_context *context, libusb_device *device, libusb_hotplug_event event,
                      void *user)
{
    (void)context;
    (void)device;
    (void)event;
    (void)user;
    return 0;
}

int usb_libusb_port(const struct usb_kind *kind, const char *place, struct usb_port **port,
                    struct nacre_error *error)
{
    static const struct usb_port_ops ops = {.open = port_open, .close = port_close};
    int status = NACRE_OK;
    struct port *made = calloc(1, sizeof *made);
    if (!made) {
        return nacre_fail_memory(error, "a USB port");
    }
    made->base.ops = &ops;
    made->kind = *kind;
    if (place) {
        (void)snprintf(made->place.name, sizeof made->place.name, "%s", place);
    }
    int code = libusb_init(&made->context);
    if (code != 0) {
        made->context = NULL;
        status = fail_libusb(error, code, "USB");
        goto out;
    }
    made->watching =
        libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG) &&
        libusb_hotplug_register_callback(made->context, LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED, 0,
                                         kind->vendor, kind->product, LIBUSB_HOTPLUG_MATCH_ANY,
                                         plugged_in, NULL, &made->watch) == 0;
    *port = &made->base;
    made = NULL;
out:
    if (made) {
        port_close(&made->base);
    }
    return status;
}
