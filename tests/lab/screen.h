/* Graphics cards of the kernel's drivers vkms and bochs, and what is on their screens. */
#ifndef TESTS_LAB_SCREEN_H
#define TESTS_LAB_SCREEN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct screen {
    char module[32];
    char path[32];   /* of the device node; empty: not plugged in */
    char status[96]; /* file whose text forces the connector "on" or "off" */
};

/* Load the driver's module and find its card by the name that the driver has. */
struct screen screen_plug(const char *module, const char *driver);
void screen_unplug(struct screen *screen); /* one that is not plugged in is left alone */

/* The pixels that the card sends, 0xRRGGBB[height][width], read by a file of our own as another program does; free
 * frees. */
uint32_t *screen_read(const struct screen *screen, int *width, int *height);

/* The same of a part of them, which takes much less time. */
uint32_t *screen_read_region(const struct screen *screen, int left, int top, int width, int height);

/* The whole picture is black but for levels[h][w] as grey from (left, top) on. */
void screen_check(const uint32_t *pixels, int width, int height, const uint8_t *levels, int left,
                  int top, int w, int h);

/* Take the picture away by the file through which this process has the card, as if another program had the right. */
void screen_dark(const struct screen *screen);

/* A property of the CRTC, the connector or the primary plane. */
uint64_t screen_get(const struct screen *screen, const char *name);
void screen_set(const struct screen *screen, const char *name, uint64_t value);

/* The bytes of a property that has some, or NULL and no size; free frees. */
void *screen_get_bytes(const struct screen *screen, const char *name, size_t *size);
void screen_set_bytes(const struct screen *screen, const char *name, const void *bytes,
                      size_t size);

#endif
