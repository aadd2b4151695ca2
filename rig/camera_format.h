/* Raw formats of V4L2: which there are, and how their bytes become pixels. */
#ifndef RIG_CAMERA_FORMAT_H
#define RIG_CAMERA_FORMAT_H

#include "rig/bayer.h"

#include <stddef.h>
#include <stdint.h>

enum camera_packing {
    PACKING_BYTES,  /* a byte a pixel */
    PACKING_WORDS,  /* a little-endian word of 16 bits a pixel, its low bits used */
    PACKING_MIPI10, /* 4 pixels in 5 bytes: their high bytes, then their low 2 bits */
    PACKING_MIPI12, /* 2 pixels in 3 bytes: their high bytes, then their low 4 bits */
};

struct camera_format {
    uint32_t code; /* V4L2_PIX_FMT_... */
    enum bayer bayer;
    int bits;
    enum camera_packing packing;
};

/* At most this many formats say the same of bits and Bayer order. */
enum { CAMERA_FORMATS = 2 };

/* Write the formats of so many bits and this order, those first that are read fastest; returns their number. */
size_t camera_formats_find(enum bayer bayer, int bits,
                           const struct camera_format *found[CAMERA_FORMATS]);

/* The format with V4L2's code, or NULL. */
const struct camera_format *camera_format_of(uint32_t code);

/* Bytes that a row of pixels takes at least. */
size_t camera_format_row_bytes(const struct camera_format *format, int width);

/* A part of a frame. */
struct camera_region {
    int left, top, width, height;
};

/* Bring the pixels of `region` into raw[height][width]; rows begin every `stride` bytes. Returns the largest value, which
 * is above 2^bits - 1 where a driver does not keep to its format. */
uint16_t camera_format_unpack(const struct camera_format *format, const uint8_t *bytes,
                              size_t stride, const struct camera_region *region, uint16_t *raw);

/* The order of a frame's filters from its first pixel on, where it is `bayer` from pixel (left, top) on. */
enum bayer camera_bayer_of_frame(enum bayer bayer, int left, int top);

/* The four characters of a code, "RG10". */
struct camera_code {
    char text[5];
};
struct camera_code camera_code_text(uint32_t code);

#endif
