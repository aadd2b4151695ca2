/* Raw formats of V4L2. */
#include "rig/camera_format.h"

#include <linux/videodev2.h>

/* Kernel headers of Debian 12 do not name it yet. */
static const uint32_t Y12P = v4l2_fourcc('Y', '1', '2', 'P');

static const struct camera_format formats[] = {
    {V4L2_PIX_FMT_SRGGB8, BAYER_RGGB, 8, PACKING_BYTES},
    {V4L2_PIX_FMT_SBGGR8, BAYER_BGGR, 8, PACKING_BYTES},
    {V4L2_PIX_FMT_SGRBG8, BAYER_GRBG, 8, PACKING_BYTES},
    {V4L2_PIX_FMT_SGBRG8, BAYER_GBRG, 8, PACKING_BYTES},
    {V4L2_PIX_FMT_GREY, BAYER_MONO, 8, PACKING_BYTES},
    {V4L2_PIX_FMT_SRGGB10, BAYER_RGGB, 10, PACKING_WORDS},
    {V4L2_PIX_FMT_SBGGR10, BAYER_BGGR, 10, PACKING_WORDS},
    {V4L2_PIX_FMT_SGRBG10, BAYER_GRBG, 10, PACKING_WORDS},
    {V4L2_PIX_FMT_SGBRG10, BAYER_GBRG, 10, PACKING_WORDS},
    {V4L2_PIX_FMT_Y10, BAYER_MONO, 10, PACKING_WORDS},
    {V4L2_PIX_FMT_SRGGB10P, BAYER_RGGB, 10, PACKING_MIPI10},
    {V4L2_PIX_FMT_SBGGR10P, BAYER_BGGR, 10, PACKING_MIPI10},
    {V4L2_PIX_FMT_SGRBG10P, BAYER_GRBG, 10, PACKING_MIPI10},
    {V4L2_PIX_FMT_SGBRG10P, BAYER_GBRG, 10, PACKING_MIPI10},
    {V4L2_PIX_FMT_Y10P, BAYER_MONO, 10, PACKING_MIPI10},
    {V4L2_PIX_FMT_SRGGB12, BAYER_RGGB, 12, PACKING_WORDS},
    {V4L2_PIX_FMT_SBGGR12, BAYER_BGGR, 12, PACKING_WORDS},
    {V4L2_PIX_FMT_SGRBG12, BAYER_GRBG, 12, PACKING_WORDS},
    {V4L2_PIX_FMT_SGBRG12, BAYER_GBRG, 12, PACKING_WORDS},
    {V4L2_PIX_FMT_Y12, BAYER_MONO, 12, PACKING_WORDS},
    {V4L2_PIX_FMT_SRGGB12P, BAYER_RGGB, 12, PACKING_MIPI12},
    {V4L2_PIX_FMT_SBGGR12P, BAYER_BGGR, 12, PACKING_MIPI12},
    {V4L2_PIX_FMT_SGRBG12P, BAYER_GRBG, 12, PACKING_MIPI12},
    {V4L2_PIX_FMT_SGBRG12P, BAYER_GBRG, 12, PACKING_MIPI12},
    {Y12P, BAYER_MONO, 12, PACKING_MIPI12},
    {V4L2_PIX_FMT_SRGGB14, BAYER_RGGB, 14, PACKING_WORDS},
    {V4L2_PIX_FMT_SBGGR14, BAYER_BGGR, 14, PACKING_WORDS},
    {V4L2_PIX_FMT_SGRBG14, BAYER_GRBG, 14, PACKING_WORDS},
    {V4L2_PIX_FMT_SGBRG14, BAYER_GBRG, 14, PACKING_WORDS},
    {V4L2_PIX_FMT_Y14, BAYER_MONO, 14, PACKING_WORDS},
    {V4L2_PIX_FMT_SRGGB16, BAYER_RGGB, 16, PACKING_WORDS},
    {V4L2_PIX_FMT_SBGGR16, BAYER_BGGR, 16, PACKING_WORDS},
    {V4L2_PIX_FMT_SGRBG16, BAYER_GRBG, 16, PACKING_WORDS},
    {V4L2_PIX_FMT_SGBRG16, BAYER_GBRG, 16, PACKING_WORDS},
    {V4L2_PIX_FMT_Y16, BAYER_MONO, 16, PACKING_WORDS},
};

size_t camera_formats_find(enum bayer bayer, int bits,
                           const struct camera_format *found[CAMERA_FORMATS])
{
    size_t count = 0;
    for (size_t i = 0; i < sizeof formats / sizeof *formats && count < CAMERA_FORMATS; i++) {
        if (formats[i].bayer == bayer && formats[i].bits == bits) {
            found[count++] = &formats[i];
        }
    }
    return count;
}

const struct camera_format *camera_format_of(uint32_t code)
{
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++) {
        if (formats[i].code == code) {
            return &formats[i];
        }
    }
    return NULL;
}

size_t camera_format_row_bytes(const struct camera_format *format, int width)
{
    size_t pixels = (size_t)width;
    switch (format->packing) {
    case PACKING_WORDS:
        return 2 * pixels;
    case PACKING_MIPI10:
        return (pixels + 3) / 4 * 5;
    case PACKING_MIPI12:
        return (pixels + 1) / 2 * 3;
    default:
        return pixels;
    }
}

static uint16_t pixel(enum camera_packing packing, const uint8_t *row, size_t x)
{
    const uint8_t *group;
    switch (packing) {
    case PACKING_WORDS:
        return (uint16_t)(row[2 * x] | row[2 * x + 1] << 8);
    case PACKING_MIPI10:
        group = row + x / 4 * 5;
        return (uint16_t)(group[x % 4] << 2 | (group[4] >> 2 * (x % 4) & 3));
    case PACKING_MIPI12:
        group = row + x / 2 * 3;
        return (uint16_t)(group[x % 2] << 4 | (group[2] >> 4 * (x % 2) & 15));
    default:
        return row[x];
    }
}

uint16_t camera_format_unpack(const struct camera_format *format, const uint8_t *bytes,
                              size_t stride, const struct camera_region *region, uint16_t *raw)
{
    uint16_t largest = 0;
    for (int y = 0; y < region->height; y++) {
        const uint8_t *row = bytes + (size_t)(region->top + y) * stride;
        uint16_t *out = raw + (size_t)y * (size_t)region->width;
        for (int x = 0; x < region->width; x++) {
            out[x] = pixel(format->packing, row, (size_t)region->left + (size_t)x);
            largest = out[x] > largest ? out[x] : largest;
        }
    }
    return largest;
}

enum bayer camera_bayer_of_frame(enum bayer bayer, int left, int top)
{
    for (int i = BAYER_RGGB; i <= BAYER_GBRG && bayer != BAYER_MONO; i++) {
        /* Two neighbours tell the order. */
        if (bayer_channel((enum bayer)i, left, top) == bayer_channel(bayer, 0, 0) &&
            bayer_channel((enum bayer)i, left + 1, top) == bayer_channel(bayer, 1, 0)) {
            return (enum bayer)i;
        }
    }
    return bayer;
}

struct camera_code camera_code_text(uint32_t code)
{
    struct camera_code name = {{0}};
    for (int i = 0; i < 4; i++) {
        char letter = (char)(code >> 8 * i & 0x7f);
        name.text[i] = letter >= ' ' && letter <= '~' ? letter : '?';
    }
    return name;
}
