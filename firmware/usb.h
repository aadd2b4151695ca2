/* USB 2.0 full speed on the ATmega32U4, polled: control endpoint 0, bulk out 0x01, bulk in 0x82. */
#ifndef FIRMWARE_USB_H
#define FIRMWARE_USB_H

#include "firmware/board.h"

/* Attach to the bus, anew where a bootloader had attached before. */
void usb_start(void);

/* Answer what the host has asked since the last call. Never waits. */
void usb_poll(struct board *board, uint64_t now);

#endif
