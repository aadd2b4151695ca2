/* Tests of unpacking raw formats. */
#include "rig/camera_format.h"

#include "unity.h"

#include <stdlib.h>
#include <string.h>

void setUp(void)
{
}

void tearDown(void)
{
}

/* The format in which pixels are packed so. */
static const struct camera_format *format_of(enum bayer bayer, int bits,
                                             enum camera_packing packing)
{
    const struct camera_format *found[CAMERA_FORMATS];
    size_t count = camera_formats_find(bayer, bits, found);
    for (size_t i = 0; i < count; i++) {
        if (found[i]->packing == packing) {
            return found[i];
        }
    }
    TEST_FAIL_MESSAGE("there is no such format");
    return NULL;
}

static void codes_are_those_of_v4l2(void)
{
    static const struct {
        enum bayer bayer;
        int bits;
        enum camera_packing packing;
        const char *code;
    } known[] = {{BAYER_BGGR, 8, PACKING_BYTES, "BA81"},   {BAYER_RGGB, 8, PACKING_BYTES, "RGGB"},
                 {BAYER_MONO, 8, PACKING_BYTES, "GREY"},   {BAYER_GRBG, 10, PACKING_WORDS, "BA10"},
                 {BAYER_RGGB, 10, PACKING_MIPI10, "pRAA"}, {BAYER_GBRG, 12, PACKING_WORDS, "GB12"},
                 {BAYER_BGGR, 12, PACKING_MIPI12, "pBCC"}, {BAYER_MONO, 12, PACKING_MIPI12, "Y12P"},
                 {BAYER_RGGB, 14, PACKING_WORDS, "RG14"},  {BAYER_BGGR, 16, PACKING_WORDS, "BYR2"}};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        const struct camera_format *format =
            format_of(known[i].bayer, known[i].bits, known[i].packing);
        TEST_ASSERT_EQUAL_STRING(known[i].code, camera_code_text(format->code).text);
    }
}

static void formats_that_do_not_exist_are_not_found(void)
{
    const struct camera_format *found[CAMERA_FORMATS];
    TEST_ASSERT_EQUAL_INT(0, camera_formats_find(BAYER_RGGB, 9, found));
    TEST_ASSERT_EQUAL_INT(0, camera_formats_find(BAYER_MONO, 11, found));
    TEST_ASSERT_EQUAL_INT(2, camera_formats_find(BAYER_MONO, 10, found));
    TEST_ASSERT_EQUAL_INT(1, camera_formats_find(BAYER_GBRG, 16, found));
}

static void rows_of_packed_pixels_end_with_a_whole_group(void)
{
    static const int widths[] = {1, 3, 4, 5, 640};
    static const size_t ten[] = {5, 5, 5, 10, 800};
    static const size_t twelve[] = {3, 6, 6, 9, 960};
    for (int i = 0; i < 5; i++) {
        size_t pixels = (size_t)widths[i];
        TEST_ASSERT_EQUAL_UINT64(
            ten[i], camera_format_row_bytes(format_of(BAYER_RGGB, 10, PACKING_MIPI10), widths[i]));
        TEST_ASSERT_EQUAL_UINT64(
            twelve[i],
            camera_format_row_bytes(format_of(BAYER_RGGB, 12, PACKING_MIPI12), widths[i]));
        TEST_ASSERT_EQUAL_UINT64(
            2 * pixels,
            camera_format_row_bytes(format_of(BAYER_RGGB, 16, PACKING_WORDS), widths[i]));
        TEST_ASSERT_EQUAL_UINT64(
            pixels, camera_format_row_bytes(format_of(BAYER_RGGB, 8, PACKING_BYTES), widths[i]));
    }
}

/* The example of the kernel's documentation: high bytes first, then the low bits, those of the first pixel lowest. */
static void packed_pixels_are_put_together(void)
{
    static const uint8_t ten[] = {0x80, 0x01, 0xff, 0x00, 0xe4};
    static const uint16_t ten_expected[] = {0x200, 0x005, 0x3fe, 0x003};
    static const uint8_t twelve[] = {0x80, 0xff, 0xa5};
    static const uint16_t twelve_expected[] = {0x805, 0xffa};
    const struct camera_region row = {0, 0, 4, 1};
    const struct camera_region pair = {0, 0, 2, 1};
    uint16_t raw[4];
    TEST_ASSERT_EQUAL_HEX16(
        0x3fe, camera_format_unpack(format_of(BAYER_RGGB, 10, PACKING_MIPI10), ten, 5, &row, raw));
    TEST_ASSERT_EQUAL_HEX16_ARRAY(ten_expected, raw, 4);
    TEST_ASSERT_EQUAL_HEX16(0xffa, camera_format_unpack(format_of(BAYER_RGGB, 12, PACKING_MIPI12),
                                                        twelve, 3, &pair, raw));
    TEST_ASSERT_EQUAL_HEX16_ARRAY(twelve_expected, raw, 2);
}

/* Pack as the standard says, by setting single bits, which shares nothing with how they are taken apart. */
static void pack(enum camera_packing packing, int bits, const uint16_t *pixels, int width,
                 uint8_t *row)
{
    int group = packing == PACKING_MIPI10 ? 4 : packing == PACKING_MIPI12 ? 2 : 1;
    int group_bytes = packing == PACKING_MIPI10   ? 5
                      : packing == PACKING_MIPI12 ? 3
                      : bits > 8                  ? 2
                                                  : 1;
    int low = group > 1 ? bits - 8 : 0; /* bits of a pixel that stand in the group's last byte */
    for (int x = 0; x < width; x++) {
        for (int b = 0; b < bits; b++) {
            int bit = group == 1 ? b
                      : b >= low ? 8 * (x % group) + b - low
                                 : 8 * group + low * (x % group) + b;
            int set = pixels[x] >> b & 1;
            row[x / group * group_bytes + bit / 8] |= (uint8_t)(set << bit % 8);
        }
    }
}

static void every_packing_gives_back_what_was_packed(void)
{
    enum { WIDTH = 37, HEIGHT = 5, STRIDE = 96 };
    static const struct {
        enum camera_packing packing;
        int bits;
    } kinds[] = {{PACKING_BYTES, 8},  {PACKING_WORDS, 10},  {PACKING_WORDS, 12},
                 {PACKING_WORDS, 16}, {PACKING_MIPI10, 10}, {PACKING_MIPI12, 12}};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        const struct camera_format *format = format_of(BAYER_GRBG, kinds[k].bits, kinds[k].packing);
        /* Every way in which a region can begin in a group. */
        for (int left = 0; left < 6; left++) {
            const struct camera_region region = {left, 1, WIDTH - left - 2, HEIGHT - 2};
            uint16_t pixels[HEIGHT][WIDTH];
            uint16_t raw[HEIGHT * WIDTH];
            uint8_t bytes[HEIGHT * STRIDE] = {0};
            uint16_t largest = 0;
            uint32_t random = 12345 + (uint32_t)left;
            for (int y = 0; y < HEIGHT; y++) {
                for (int x = 0; x < WIDTH; x++) {
                    random = random * 1664525 + 1013904223;
                    pixels[y][x] = (uint16_t)(random >> (32 - kinds[k].bits));
                }
                pack(kinds[k].packing, kinds[k].bits, pixels[y], WIDTH,
                     bytes + (ptrdiff_t)y * STRIDE);
            }
            uint16_t got = camera_format_unpack(format, bytes, STRIDE, &region, raw);
            for (int y = 0; y < region.height; y++) {
                for (int x = 0; x < region.width; x++) {
                    uint16_t expected = pixels[y + region.top][x + region.left];
                    TEST_ASSERT_EQUAL_HEX16(expected, raw[y * region.width + x]);
                    largest = expected > largest ? expected : largest;
                }
            }
            TEST_ASSERT_EQUAL_HEX16(largest, got);
        }
    }
}

/* Nothing behind the last pixel's bytes is read: the sanitizer watches. */
static void last_row_may_end_with_its_last_pixel(void)
{
    static const struct camera_region region = {0, 0, 6, 3};
    const struct camera_format *format = format_of(BAYER_RGGB, 10, PACKING_MIPI10);
    size_t row = camera_format_row_bytes(format, 6);
    size_t size = 2 * 16 + row;
    uint8_t *bytes = calloc(1, size);
    uint16_t raw[18];
    TEST_ASSERT_NOT_NULL(bytes);
    bytes[size - 1] = 0x03;
    (void)camera_format_unpack(format, bytes, 16, &region, raw);
    TEST_ASSERT_EQUAL_HEX16(0x003, raw[16]);
    TEST_ASSERT_EQUAL_HEX16(0x000, raw[17]);
    free(bytes);
}

static void order_of_a_frame_is_that_of_its_part_moved_back(void)
{
    for (int bayer = BAYER_RGGB; bayer <= BAYER_GBRG; bayer++) {
        for (int shift = 0; shift < 4; shift++) {
            enum bayer frame = camera_bayer_of_frame((enum bayer)bayer, shift % 2, shift / 2);
            for (int pixel = 0; pixel < 4; pixel++) {
                TEST_ASSERT_EQUAL_INT(
                    bayer_channel((enum bayer)bayer, pixel % 2, pixel / 2),
                    bayer_channel(frame, pixel % 2 + shift % 2, pixel / 2 + shift / 2));
            }
        }
    }
    TEST_ASSERT_EQUAL_INT(BAYER_MONO, camera_bayer_of_frame(BAYER_MONO, 1, 1));
}

static void codes_that_cannot_be_printed_are_made_so(void)
{
    TEST_ASSERT_EQUAL_STRING("????", camera_code_text(0x01020304).text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(codes_are_those_of_v4l2);
    RUN_TEST(formats_that_do_not_exist_are_not_found);
    RUN_TEST(rows_of_packed_pixels_end_with_a_whole_group);
    RUN_TEST(packed_pixels_are_put_together);
    RUN_TEST(every_packing_gives_back_what_was_packed);
    RUN_TEST(last_row_may_end_with_its_last_pixel);
    RUN_TEST(order_of_a_frame_is_that_of_its_part_moved_back);
    RUN_TEST(codes_that_cannot_be_printed_are_made_so);
    return UNITY_END();
}
