/* The trigger board behind the trigger seam: exposures of whole turns of the colour wheel, over USB. */
#ifndef RIG_TRIGGER_USB_H
#define RIG_TRIGGER_USB_H

#include "base/clock.h"
#include "firmware/protocol.h"
#include "nacre/error.h"
#include "rig/trigger.h"
#include "rig/usb.h"
#include "rig/usb_libusb.h"

/* What usb_libusb looks for. */
extern const struct usb_kind trigger_usb_kind;

/* Open the board at the port, which belongs to the trigger from here on, even when this fails: it is opened anew after
 * an unplug. Times are given on `clock`. A board that speaks another protocol is refused. */
int trigger_usb_new(struct usb_port *port, struct clock *clock, struct trigger **trigger,
                    struct nacre_error *error);

/* What the board says of itself and of the wheel now. */
int trigger_usb_status(struct trigger *trigger, struct board_status *status,
                       struct nacre_error *error);

/* The loop's gain, coasting and reports. */
int trigger_usb_set(struct trigger *trigger, const struct board_settings *settings,
                    struct nacre_error *error);

/* Turns a second of the wheel that the board is locked to; 0: none. */
double trigger_usb_wheel_hz(const struct board_status *status);

#endif
