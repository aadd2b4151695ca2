/* The USB device: requests on endpoint 0 as a state machine over polls, packets on the bulk endpoints.
 *
 * All answers on endpoint 0 are shorter than its 64 bytes, so each is one packet. All waiting is the host's. */
#include "firmware/usb.h"

#include <avr/io.h>
#include <avr/pgmspace.h>
#include <string.h>
#include <util/delay.h>

enum { EP_OUT = 1, EP_IN = 2, PACKET = 64 };

enum {
    GET_STATUS = 0,
    CLEAR_FEATURE = 1,
    SET_FEATURE = 3,
    SET_ADDRESS = 5,
    GET_DESCRIPTOR = 6,
    GET_CONFIGURATION = 8,
    SET_CONFIGURATION = 9,
    GET_INTERFACE = 10,
    SET_INTERFACE = 11,
};

/* The type, recipient and direction of a request. */
enum {
    TO_DEVICE = 0x00,
    TO_INTERFACE = 0x01,
    TO_ENDPOINT = 0x02,
    FROM_DEVICE = 0x80,
    FROM_INTERFACE = 0x81,
    FROM_ENDPOINT = 0x82,
    VENDOR_TO = 0x40,
    VENDOR_FROM = 0xc0
};

struct setup {
    uint8_t type, request;
    uint16_t value, index, length;
};

/* What endpoint 0 waits for between polls. */
static enum { CONTROL_IDLE, CONTROL_ADDRESS, CONTROL_SETTINGS } control;
static uint8_t configuration;

static const uint8_t device_descriptor[] PROGMEM = {18,
                                                    1,
                                                    0x00,
                                                    0x02,
                                                    0xff,
                                                    0,
                                                    0,
                                                    PACKET,
                                                    BOARD_VENDOR_ID & 0xff,
                                                    BOARD_VENDOR_ID >> 8,
                                                    BOARD_PRODUCT_ID & 0xff,
                                                    BOARD_PRODUCT_ID >> 8,
                                                    BOARD_PROTOCOL,
                                                    0x00,
                                                    1,
                                                    2,
                                                    0,
                                                    1};

/* Configuration, interface of vendor class, two bulk endpoints; 100 mA from the bus. */
static const uint8_t configuration_descriptor[] PROGMEM = {
    9, 2,      32, 0,      1, 1, 0, 0x80, 50,           9, 4,      0, 0, 2, 0xff, 0, 0, 0, 7,
    5, EP_OUT, 2,  PACKET, 0, 0, 7, 5,    0x80 | EP_IN, 2, PACKET, 0, 0};

static const uint8_t language_descriptor[] PROGMEM = {4, 3, 0x09, 0x04};
static const char manufacturer[] PROGMEM = "nacre";
static const char product[] PROGMEM = BOARD_PRODUCT;

static void stall(void)
{
    UECONX = 1 << STALLRQ | 1 << EPEN;
}

/* Send the bytes as the whole answer, of which the host may want less. */
static void answer(const uint8_t *bytes, uint8_t size, uint16_t length)
{
    for (uint8_t i = 0; i < size && i < length; i++) {
        UEDATX = bytes[i];
    }
    UEINTX = (uint8_t) ~(1 << TXINI);
}

static void answer_flash(const uint8_t *bytes, uint8_t size, uint16_t length)
{
    for (uint8_t i = 0; i < size && i < length; i++) {
        UEDATX = pgm_read_byte(bytes + i);
    }
    UEINTX = (uint8_t) ~(1 << TXINI);
}

/* Text of ASCII as a string descriptor. */
static void answer_text(const char *text, uint16_t length)
{
    uint8_t bytes[PACKET - 2];
    uint8_t size = 2;
    char letter = 0;
    for (; size + 2 <= (uint8_t)sizeof bytes && (letter = (char)pgm_read_byte(text)) != 0; text++) {
        bytes[size++] = (uint8_t)letter;
        bytes[size++] = 0;
    }
    bytes[0] = size;
    bytes[1] = 3;
    answer(bytes, size, length);
}

static void get_descriptor(const struct setup *setup)
{
    switch (setup->value) {
    case 0x0100:
        answer_flash(device_descriptor, sizeof device_descriptor, setup->length);
        break;
    case 0x0200:
        answer_flash(configuration_descriptor, sizeof configuration_descriptor, setup->length);
        break;
    case 0x0300:
        answer_flash(language_descriptor, sizeof language_descriptor, setup->length);
        break;
    case 0x0301:
        answer_text(manufacturer, setup->length);
        break;
    case 0x0302:
        answer_text(product, setup->length);
        break;
    default:
        stall();
    }
}

static void configure(uint8_t value)
{
    configuration = value;
    for (uint8_t endpoint = EP_OUT; endpoint <= EP_IN; endpoint++) {
        UENUM = endpoint;
        UECONX = 0;
        if (value != 0) {
            UECONX = 1 << EPEN;
            UECFG0X = (uint8_t)(2 << EPTYPE0 | (endpoint == EP_IN) << EPDIR);
            UECFG1X = 3 << EPSIZE0 | 1 << ALLOC;
        }
    }
    UERST = 1 << EP_OUT | 1 << EP_IN;
    UERST = 0;
    UENUM = 0;
}

/* The halt feature of a bulk endpoint. Returns false where there is none such. */
static bool set_halt(const struct setup *setup, bool halt)
{
    uint8_t endpoint = setup->index & 0x7f;
    if (setup->value != 0 || configuration == 0 || endpoint < EP_OUT || endpoint > EP_IN) {
        return false;
    }
    UENUM = endpoint;
    if (halt) {
        UECONX = 1 << STALLRQ | 1 << EPEN;
    } else {
        UECONX = 1 << STALLRQC | 1 << RSTDT | 1 << EPEN;
        UERST = (uint8_t)(1 << endpoint);
        UERST = 0;
    }
    UENUM = 0;
    return true;
}

static void get_status(const struct setup *setup)
{
    uint8_t status[2] = {0, 0};
    if (setup->type == FROM_ENDPOINT) {
        UENUM = setup->index & 0x03;
        status[0] = (UECONX >> STALLRQ) & 1;
        UENUM = 0;
    }
    answer(status, sizeof status, setup->length);
}

/* A standard request without data; false where it is none of ours. */
static bool obey(const struct setup *setup)
{
    if (setup->type == TO_DEVICE && setup->request == SET_ADDRESS) {
        UDADDR = setup->value & 0x7f;
        control = CONTROL_ADDRESS;
        return true;
    }
    if (setup->type == TO_DEVICE && setup->request == SET_CONFIGURATION && setup->value <= 1) {
        configure((uint8_t)setup->value);
        return true;
    }
    if (setup->type == TO_INTERFACE && setup->request == SET_INTERFACE && setup->value == 0) {
        return true;
    }
    if (setup->type == TO_ENDPOINT &&
        (setup->request == CLEAR_FEATURE || setup->request == SET_FEATURE)) {
        return set_halt(setup, setup->request == SET_FEATURE);
    }
    return false;
}

static void begin(const struct setup *setup, const struct board *board, uint64_t now)
{
    struct board_status status;
    const uint8_t none = 0;
    uint16_t kind = (uint16_t)setup->type << 8 | setup->request;
    control = CONTROL_IDLE;
    switch (kind) {
    case FROM_DEVICE << 8 | GET_DESCRIPTOR:
        get_descriptor(setup);
        break;
    case FROM_DEVICE << 8 | GET_STATUS:
    case FROM_INTERFACE << 8 | GET_STATUS:
    case FROM_ENDPOINT << 8 | GET_STATUS:
        get_status(setup);
        break;
    case FROM_DEVICE << 8 | GET_CONFIGURATION:
        answer(&configuration, 1, setup->length);
        break;
    case FROM_INTERFACE << 8 | GET_INTERFACE:
        answer(&none, 1, setup->length);
        break;
    case VENDOR_FROM << 8 | BOARD_GET_STATUS:
        board_status(board, now, &status);
        answer((const uint8_t *)&status, sizeof status, setup->length);
        break;
    case VENDOR_TO << 8 | BOARD_SET_SETTINGS:
        if (setup->length == sizeof(struct board_settings)) {
            control = CONTROL_SETTINGS;
        } else {
            stall();
        }
        break;
    default:
        if (setup->length == 0 && obey(setup)) {
            UEINTX = (uint8_t) ~(1 << TXINI);
        } else {
            stall();
        }
    }
}

/* All bytes of the packet that has come, at most `room`. */
static uint8_t fetch(uint8_t *bytes, uint8_t room)
{
    uint8_t size = UEBCLX;
    size = size < room ? size : room;
    for (uint8_t i = 0; i < size; i++) {
        bytes[i] = UEDATX;
    }
    return size;
}

static void poll_control(struct board *board, uint64_t now)
{
    UENUM = 0;
    uint8_t flags = UEINTX;
    if (flags & 1 << RXSTPI) {
        struct setup setup;
        for (uint8_t i = 0; i < sizeof setup; i++) {
            ((uint8_t *)&setup)[i] = UEDATX;
        }
        UEINTX = (uint8_t) ~(1 << RXSTPI | 1 << RXOUTI | 1 << TXINI);
        begin(&setup, board, now);
    } else if (flags & 1 << RXOUTI) {
        struct board_settings settings;
        bool right = fetch((uint8_t *)&settings, sizeof settings) == sizeof settings;
        UEINTX = (uint8_t) ~(1 << RXOUTI);
        if (control == CONTROL_SETTINGS) {
            control = CONTROL_IDLE;
            if (right && board_set(board, &settings)) {
                UEINTX = (uint8_t) ~(1 << TXINI);
            } else {
                stall();
            }
        }
    } else if (control == CONTROL_ADDRESS && flags & 1 << TXINI) {
        UDADDR |= 1 << ADDEN; /* the answer has gone out under the old address */
        control = CONTROL_IDLE;
    }
}

static void poll_out(struct board *board, uint64_t now)
{
    uint8_t packet[PACKET];
    UENUM = EP_OUT;
    if (UEINTX & 1 << RXOUTI) {
        UEINTX = (uint8_t) ~(1 << RXOUTI);
        uint8_t size = fetch(packet, sizeof packet);
        UEINTX = (uint8_t) ~(1 << FIFOCON);
        board_packet(board, packet, size, now);
    }
}

static void poll_in(struct board *board)
{
    struct board_event event;
    UENUM = EP_IN;
    if (!(UEINTX & 1 << TXINI) || !board_event(board, &event)) {
        return;
    }
    UEINTX = (uint8_t) ~(1 << TXINI);
    uint8_t size = 0;
    do {
        for (uint8_t i = 0; i < sizeof event; i++) {
            UEDATX = ((const uint8_t *)&event)[i];
        }
        size = (uint8_t)(size + sizeof event);
    } while (size < PACKET && board_event(board, &event));
    UEINTX = (uint8_t) ~(1 << FIFOCON);
}

void usb_start(void)
{
    UHWCON = 1 << UVREGE;
    USBCON = 1 << USBE | 1 << FRZCLK;
    PLLCSR = 1 << PINDIV | 1 << PLLE;
    while (!(PLLCSR & 1 << PLOCK)) {
    }
    USBCON = 1 << USBE | 1 << OTGPADE;
    UDCON = 1 << DETACH;
    _delay_ms(20);
    UDCON = 0;
}

void usb_poll(struct board *board, uint64_t now)
{
    if (UDINT & 1 << EORSTI) {
        UDINT &= (uint8_t) ~(1 << EORSTI);
        configuration = 0;
        control = CONTROL_IDLE;
        UENUM = 0;
        UECONX = 1 << EPEN;
        UECFG0X = 0;
        UECFG1X = 3 << EPSIZE0 | 1 << ALLOC;
    }
    poll_control(board, now);
    if (configuration != 0) {
        poll_out(board, now);
        poll_in(board);
    }
}
