/* The libusb back end against a libusb of the test's own: what is chosen, what is said, what is given back. */
#include "rig/usb_libusb.h"

#include "unity.h"

#include <libusb.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

struct libusb_device {
    uint16_t vendor, product;
    uint8_t bus, ports[3];
    int depth;
};

struct libusb_context {
    int unused;
};

struct libusb_device_handle {
    libusb_device *device;
};

static struct libusb_device devices[4];
static struct libusb_context the_context;
static struct libusb_device_handle the_handle;
static const struct usb_kind kind = {
    .what = "gadget", .vendor = 0x1209, .product = 1, .remedy = "ask the operator"};

/* What the bus does and what was done to it. */
static struct {
    int devices, comes_after; /* so many from the start; one more after so many lists (0: never) */
    int open_code, claim_code, bulk_code, bulk_moved, control_code;
    int access_after; /* opening is refused so many times */
    bool hotplug;
    int lists, freed_lists, contexts, handles, claims, cleared, waits;
} bus;

/* libusb's own signatures, with shorter names. */
/* NOLINTBEGIN(readability-inconsistent-declaration-parameter-name,readability-non-const-parameter) */
int libusb_init(libusb_context **context)
{
    *context = &the_context;
    bus.contexts++;
    return 0;
}

void libusb_exit(libusb_context *context)
{
    TEST_ASSERT_TRUE(context == &the_context);
    bus.contexts--;
}

const char *libusb_strerror(int code)
{
    return code == LIBUSB_ERROR_IO ? "Input/Output Error" : "Other error";
}

ssize_t libusb_get_device_list(libusb_context *context, libusb_device ***list)
{
    (void)context;
    int count = bus.devices + (bus.comes_after > 0 && bus.lists >= bus.comes_after);
    *list = calloc((size_t)count + 1, sizeof **list);
    for (int i = 0; i < count; i++) {
        (*list)[i] = &devices[i];
    }
    bus.lists++;
    return count;
}

void libusb_free_device_list(libusb_device **list, int unref)
{
    TEST_ASSERT_EQUAL_INT(1, unref);
    bus.freed_lists++;
    free(list);
}

int libusb_get_device_descriptor(libusb_device *device, struct libusb_device_descriptor *descriptor)
{
    memset(descriptor, 0, sizeof *descriptor);
    descriptor->idVendor = device->vendor;
    descriptor->idProduct = device->product;
    return 0;
}

uint8_t libusb_get_bus_number(libusb_device *device)
{
    return device->bus;
}

int libusb_get_port_numbers(libusb_device *device, uint8_t *ports, int room)
{
    TEST_ASSERT_TRUE(room >= device->depth);
    memcpy(ports, device->ports, (size_t)device->depth);
    return device->depth;
}

int libusb_open(libusb_device *device, libusb_device_handle **handle)
{
    if (bus.access_after > 0) {
        bus.access_after--;
        return LIBUSB_ERROR_ACCESS;
    }
    if (bus.open_code == 0) {
        the_handle.device = device;
        *handle = &the_handle;
        bus.handles++;
    }
    return bus.open_code;
}

void libusb_close(libusb_device_handle *handle)
{
    TEST_ASSERT_TRUE(handle == &the_handle);
    bus.handles--;
}

int libusb_claim_interface(libusb_device_handle *handle, int number)
{
    (void)handle;
    TEST_ASSERT_EQUAL_INT(0, number);
    bus.claims += bus.claim_code == 0;
    return bus.claim_code;
}

int libusb_release_interface(libusb_device_handle *handle, int number)
{
    (void)handle;
    (void)number;
    bus.claims--;
    return 0;
}

int libusb_clear_halt(libusb_device_handle *handle, unsigned char endpoint)
{
    (void)handle;
    bus.cleared = endpoint;
    return 0;
}

int libusb_control_transfer(libusb_device_handle *handle, uint8_t type, uint8_t request,
                            uint16_t value, uint16_t index, unsigned char *data, uint16_t size,
                            unsigned timeout)
{
    (void)handle;
    (void)type;
    (void)request;
    (void)value;
    (void)index;
    (void)data;
    (void)size;
    (void)timeout;
    return bus.control_code;
}

int libusb_bulk_transfer(libusb_device_handle *handle, unsigned char endpoint, unsigned char *data,
                         int size, int *moved, unsigned timeout)
{
    (void)handle;
    (void)endpoint;
    (void)data;
    (void)size;
    (void)timeout;
    *moved = bus.bulk_moved;
    return bus.bulk_code;
}

int libusb_has_capability(uint32_t capability)
{
    return capability == LIBUSB_CAP_HAS_HOTPLUG && bus.hotplug;
}

int libusb_hotplug_register_callback(libusb_context *context, int events, int flags, int vendor,
                                     int product, int class, libusb_hotplug_callback_fn callback,
                                     void *user, libusb_hotplug_callback_handle *handle)
{
    (void)context;
    (void)events;
    (void)flags;
    (void)class;
    (void)callback;
    (void)user;
    TEST_ASSERT_EQUAL_INT(kind.vendor, vendor);
    TEST_ASSERT_EQUAL_INT(kind.product, product);
    *handle = 5;
    return 0;
}

void libusb_hotplug_deregister_callback(libusb_context *context,
                                        libusb_hotplug_callback_handle handle)
{
    (void)context;
    TEST_ASSERT_EQUAL_INT(5, handle);
}

int libusb_handle_events_timeout_completed(libusb_context *context, struct timeval *time,
                                           int *completed)
{
    (void)context;
    (void)time;
    (void)completed;
    bus.waits++;
    return 0;
}

/* NOLINTEND(readability-inconsistent-declaration-parameter-name,readability-non-const-parameter) */

static struct nacre_error error;
static struct usb_port *port;
static struct usb *usb;

void setUp(void)
{
    memset(&bus, 0, sizeof bus);
    devices[0] = (struct libusb_device){
        .vendor = 0x1209, .product = 1, .bus = 1, .ports = {4, 2}, .depth = 2};
    devices[1] =
        (struct libusb_device){.vendor = 0x0bda, .product = 1, .bus = 1, .ports = {1}, .depth = 1};
    devices[2] =
        (struct libusb_device){.vendor = 0x1209, .product = 1, .bus = 1, .ports = {3}, .depth = 1};
    bus.devices = 2;
    bus.hotplug = true;
    port = NULL;
    usb = NULL;
}

void tearDown(void)
{
    if (usb) {
        usb->ops->close(usb);
    }
    if (port) {
        port->ops->close(port);
    }
    TEST_ASSERT_EQUAL_INT(bus.lists, bus.freed_lists);
    TEST_ASSERT_EQUAL_INT(0, bus.contexts);
    TEST_ASSERT_EQUAL_INT(0, bus.handles);
    TEST_ASSERT_EQUAL_INT(0, bus.claims);
}

static int open_at(const char *place, int wait_ms)
{
    TEST_ASSERT_EQUAL_INT(NACRE_OK, usb_libusb_port(&kind, place, &port, &error));
    return port->ops->open(port, wait_ms, &usb, &error);
}

static void refuses(const char *place, const char *why)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, open_at(place, 0));
    TEST_ASSERT_EQUAL_STRING(why, error.text);
    TEST_ASSERT_NULL(usb);
}

static void opens_the_only_device_of_its_kind(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_OK, open_at(NULL, 0));
    TEST_ASSERT_TRUE(the_handle.device == &devices[0]);
}

static void says_that_there_is_none(void)
{
    bus.devices = 0;
    refuses(NULL,
            "gadget: none is plugged in (USB 1209:0001); plug one in, and look for it with lsusb");
}

static void asks_which_of_two_is_meant(void)
{
    bus.devices = 3;
    refuses(NULL, "gadget: 2 are plugged in, at 1-4.2 and 1-3; name the place of one");
}

static void opens_the_one_at_the_place(void)
{
    bus.devices = 3;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, open_at("1-3", 0));
    TEST_ASSERT_TRUE(the_handle.device == &devices[2]);
}

static void says_that_the_place_is_empty(void)
{
    refuses("1-3", "gadget at 1-3: is not plugged in; plug it in there, or name another place");
}

static void says_that_permission_is_lacking(void)
{
    bus.open_code = LIBUSB_ERROR_ACCESS;
    refuses(NULL, "gadget at 1-4.2: may not be opened: permission denied; ask the operator");
}

static void says_that_another_program_has_it(void)
{
    bus.claim_code = LIBUSB_ERROR_BUSY;
    refuses(NULL, "gadget at 1-4.2: is in use by another program; stop that first");
}

static void says_what_else_fails(void)
{
    bus.open_code = LIBUSB_ERROR_IO;
    refuses(NULL, "gadget at 1-4.2: cannot be opened: Input/Output Error");
}

static void waits_for_a_device_to_be_plugged_in(void)
{
    bus.devices = 0;
    bus.comes_after = 3;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, open_at(NULL, 60000));
    TEST_ASSERT_EQUAL_INT(3, bus.waits);
}

static void waits_without_hotplug_events_too(void)
{
    bus.devices = 0;
    bus.comes_after = 1;
    bus.hotplug = false;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, open_at(NULL, 60000));
    TEST_ASSERT_EQUAL_INT(0, bus.waits);
}

static void waits_for_udev_to_grant_access(void)
{
    bus.access_after = 2;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, open_at(NULL, 60000));
}

static void gives_up_waiting_in_time(void)
{
    bus.devices = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, open_at(NULL, 5));
}

static void tells_the_outcomes_of_transfers_apart(void)
{
    const int codes[][2] = {
        {LIBUSB_ERROR_TIMEOUT, USB_TIMEOUT}, {LIBUSB_ERROR_PIPE, USB_STALL},
        {LIBUSB_ERROR_NO_DEVICE, USB_GONE},  {LIBUSB_ERROR_OVERFLOW, USB_BROKEN},
        {LIBUSB_ERROR_IO, USB_BROKEN},       {0, 0}};
    uint8_t data[64] = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, open_at(NULL, 0));
    for (size_t i = 0; i < sizeof codes / sizeof *codes; i++) {
        bus.bulk_code = bus.control_code = codes[i][0];
        bus.cleared = 0;
        TEST_ASSERT_EQUAL_INT(codes[i][1], usb->ops->in(usb, 0x82, data, 64, 10));
        TEST_ASSERT_EQUAL_INT(codes[i][1] == USB_STALL ? 0x82 : 0, bus.cleared);
        TEST_ASSERT_EQUAL_INT(codes[i][1], usb->ops->out(usb, 1, data, 8, 10));
        TEST_ASSERT_EQUAL_INT(codes[i][1], usb->ops->control(usb, 0xc0, 1, 0, data, 64, 10));
    }
    bus.bulk_code = LIBUSB_ERROR_TIMEOUT;
    bus.bulk_moved = 16;
    TEST_ASSERT_EQUAL_INT(16, usb->ops->in(usb, 0x82, data, 64, 10));
    TEST_ASSERT_EQUAL_INT(USB_BROKEN, usb->ops->out(usb, 1, data, 65, 10));
}

static void lists_places_in_order(void)
{
    struct usb_place *places = NULL;
    size_t count = 0;
    bus.devices = 3;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, usb_libusb_list(&kind, &places, &count, &error));
    TEST_ASSERT_EQUAL_UINT64(2, count);
    TEST_ASSERT_EQUAL_STRING("1-3", places[0].name);
    TEST_ASSERT_EQUAL_STRING("1-4.2", places[1].name);
    free(places);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(opens_the_only_device_of_its_kind);
    RUN_TEST(says_that_there_is_none);
    RUN_TEST(asks_which_of_two_is_meant);
    RUN_TEST(opens_the_one_at_the_place);
    RUN_TEST(says_that_the_place_is_empty);
    RUN_TEST(says_that_permission_is_lacking);
    RUN_TEST(says_that_another_program_has_it);
    RUN_TEST(says_what_else_fails);
    RUN_TEST(waits_for_a_device_to_be_plugged_in);
    RUN_TEST(waits_without_hotplug_events_too);
    RUN_TEST(waits_for_udev_to_grant_access);
    RUN_TEST(gives_up_waiting_in_time);
    RUN_TEST(tells_the_outcomes_of_transfers_apart);
    RUN_TEST(lists_places_in_order);
    return UNITY_END();
}
