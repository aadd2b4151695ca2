#!/bin/sh
# Writes the firmware into a board whose bootloader waits: meson compile -C build flash
set -eu
hex=$1
port=${PORT:-/dev/ttyACM0}
echo "press the board's reset button twice; waiting for its bootloader at $port (PORT chooses another)"
tries=0
until [ -c "$port" ]; do
    tries=$((tries + 1))
    if [ "$tries" -gt 300 ]; then
        echo "no $port after 30 s: is the board plugged in? Was reset pressed twice within a second?" >&2
        exit 1
    fi
    sleep 0.1
done
# The bootloader of Leonardo and Pro Micro boards (Caterina) speaks avr109.
exec avrdude -q -p atmega32u4 -c avr109 -P "$port" -U "flash:w:$hex:i"
