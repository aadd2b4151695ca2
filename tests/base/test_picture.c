/* Tests of pictures in memory, as EXR and as PNG. */
#include "base/picture.h"
#include "nacre/exr_file.h"
#include "tests/files.h"
#include "unity.h"

#include <limits.h>
#include <math.h>
#include <png.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

static char *folder;
static char path[PATH_MAX + 32];

void setUp(void)
{
    folder = folder_make();
}

void tearDown(void)
{
    folder_remove(folder);
}

static const char *name(const char *leaf)
{
    (void)snprintf(path, sizeof path, "%s/%s", folder, leaf);
    return path;
}

/* sRGB's definition (IEC 61966-2-1), in double. */
static double from_srgb(double value)
{
    return value <= 0.04045 ? value / 12.92 : pow((value + 0.055) / 1.055, 2.4);
}

/* A picture whose every value differs: a ramp from 0 to 1. */
static struct picture make_ramp(int width, int height)
{
    struct picture picture;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_allocate(&picture, width, height, &error),
                                  error.text);
    size_t count = (size_t)width * (size_t)height * 3;
    for (size_t i = 0; i < count; i++) {
        picture.rgb[i] = (float)i / (float)(count - 1);
    }
    return picture;
}

/* Write a PNG of any kind by libpng itself. `rows` are `height` rows of row_bytes. */
static void write_png(const char *file_name, int width, int height, int depth, int type,
                      const unsigned char *rows, size_t row_bytes, double gamma, int interlace)
{
    static const png_color palette[] = {{255, 0, 0}, {0, 255, 0}, {0, 0, 255}, {10, 20, 30}};
    static const png_byte opacity[] = {255, 0};
    FILE *file = fopen(file_name, "we");
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    TEST_ASSERT_NOT_NULL(file);
    png_init_io(png, file);
    png_set_IHDR(png, info, (png_uint_32)width, (png_uint_32)height, depth, type, interlace,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    if (type == PNG_COLOR_TYPE_PALETTE) {
        png_set_PLTE(png, info, palette, 4);
        png_set_tRNS(png, info, opacity, 2, NULL);
    }
    if (gamma > 0) {
        png_set_gAMA(png, info, gamma);
    }
    png_write_info(png, info);
    int passes = png_set_interlace_handling(png);
    for (int pass = 0; pass < passes; pass++) {
        for (int y = 0; y < height; y++) {
            png_write_row(png, rows + (size_t)y * row_bytes);
        }
    }
    png_write_end(png, NULL);
    png_destroy_write_struct(&png, &info);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

static struct picture read_picture(const char *file_name)
{
    struct picture picture;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_read(file_name, &picture, &error), error.text);
    return picture;
}

/* The file is refused with a text that names it and holds `reason`; nothing is held. */
static void expect_refusal(const char *file_name, const char *reason)
{
    struct picture picture;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, picture_read(file_name, &picture, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, file_name), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, reason), error.text);
    TEST_ASSERT_NULL(picture.rgb);
}

static void pictures_of_impossible_sizes_are_refused(void)
{
    static const int sizes[][2] = {
        {0, 1}, {1, 0}, {-1, 5}, {1 << 20, 1}, {1 << 16, 1 << 16}, {INT_MAX, INT_MAX}};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        struct picture picture;
        struct nacre_error error = {""};
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                              picture_allocate(&picture, sizes[i][0], sizes[i][1], &error));
        TEST_ASSERT_NULL(picture.rgb);
        picture_finish(&picture);
    }
}

static void exr_keeps_values_to_the_precision_of_half(void)
{
    struct picture ramp = make_ramp(37, 11), again;
    struct nacre_error error = {""};
    ramp.rgb[0] = 1000.5F;
    ramp.rgb[1] = -2.0F;
    ramp.rgb[2] = NAN;
    ramp.rgb[3] = 65504.0F; /* the last that fits */
    ramp.rgb[4] = INFINITY;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_write(name("a.exr"), &ramp, NULL, &error),
                                  error.text);
    again = read_picture(path);
    TEST_ASSERT_EQUAL_INT(37, again.width);
    TEST_ASSERT_EQUAL_INT(11, again.height);
    TEST_ASSERT_EQUAL_FLOAT(1000.5F, again.rgb[0]);
    TEST_ASSERT_EQUAL_FLOAT(-2.0F, again.rgb[1]);
    TEST_ASSERT_TRUE(isnan(again.rgb[2]));
    TEST_ASSERT_EQUAL_FLOAT(65504.0F, again.rgb[3]);
    TEST_ASSERT_TRUE(isinf(again.rgb[4]));
    for (size_t i = 5; i < (size_t)37 * 11 * 3; i++) {
        /* Half an ulp of 11 significant bits; below 2^-14 half the smallest step, 2^-25. */
        TEST_ASSERT_TRUE(fabsf(again.rgb[i] - ramp.rgb[i]) <= ramp.rgb[i] * 0x1p-11F + 0x1p-25F);
    }
    picture_finish(&ramp);
    picture_finish(&again);
}

static void exr_keeps_what_half_cannot_hold_by_floats(void)
{
    static const float beyond[] = {65505.0F, -1e9F, 3e38F};
    for (size_t k = 0; k < 3; k++) {
        struct picture ramp = make_ramp(7, 5), again;
        struct nacre_error error = {""};
        ramp.rgb[40] = beyond[k];
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_write(name("a.exr"), &ramp, NULL, &error),
                                      error.text);
        again = read_picture(path);
        TEST_ASSERT_EQUAL_MEMORY(ramp.rgb, again.rgb, (size_t)7 * 5 * 3 * sizeof(float));
        picture_finish(&ramp);
        picture_finish(&again);
    }
}

static void exr_carries_the_attributes_given(void)
{
    static const char *const attributes[] = {"scene=dragon.yaml", "without=noise=flare", NULL};
    struct picture ramp = make_ramp(3, 2);
    struct exr_file file = {0};
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_write(name("a.exr"), &ramp, attributes, &error),
                                  error.text);
    picture_finish(&ramp);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exr_file_read(path, &file, &error), error.text);
    const struct exr_attribute *scene = exr_part_find(&file.parts[0], "nacre.scene", EXR_STRING);
    const struct exr_attribute *without =
        exr_part_find(&file.parts[0], "nacre.without", EXR_STRING);
    TEST_ASSERT_NOT_NULL(scene);
    TEST_ASSERT_NOT_NULL(without);
    TEST_ASSERT_EQUAL_STRING("dragon.yaml", scene->string);
    TEST_ASSERT_EQUAL_STRING("noise=flare", without->string);
    TEST_ASSERT_EQUAL_INT(NACRE_HALF, file.parts[0].planes[0].pixel);
    exr_file_finish(&file);
}

static void attributes_without_key_or_value_are_refused(void)
{
    static const char *const bad[] = {
        "scene", "=x", "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa=x"};
    struct picture ramp = make_ramp(3, 2);
    struct stat status;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        const char *attributes[] = {bad[i], NULL};
        struct nacre_error error = {""};
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                              picture_write(name("a.exr"), &ramp, attributes, &error));
        TEST_ASSERT_NOT_NULL(strstr(error.text, "KEY=VALUE"));
        TEST_ASSERT_EQUAL_INT(-1, stat(path, &status));
    }
    picture_finish(&ramp);
}

static void write_exr_channels(const char *file_name, const char *const *channels,
                               enum nacre_pixel pixel)
{
    struct exr_file file = {0};
    struct nacre_error error = {""};
    struct exr_part *part = exr_file_add_part(&file, "", 2, 1);
    TEST_ASSERT_NOT_NULL(part);
    for (; *channels; channels++) {
        struct exr_plane *plane = exr_part_add_plane(part, *channels, pixel);
        TEST_ASSERT_NOT_NULL(plane);
        if (pixel != NACRE_UINT) {
            plane->values[0] = 0.25F;
            plane->values[1] = (float)**channels;
        }
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exr_file_write(file_name, &file, EXR_ZIP, &error),
                                  error.text);
    exr_file_finish(&file);
}

static void exr_of_one_channel_is_grey_and_others_are_refused(void)
{
    write_exr_channels(name("y.exr"), (const char *const[]){"Y", "A", NULL}, NACRE_FLOAT);
    struct picture grey = read_picture(path);
    for (int c = 0; c < 3; c++) {
        TEST_ASSERT_EQUAL_FLOAT(0.25F, grey.rgb[c]);
        TEST_ASSERT_EQUAL_FLOAT((float)'Y', grey.rgb[3 + c]);
    }
    picture_finish(&grey);
    write_exr_channels(name("rgb.exr"), (const char *const[]){"B", "G", "R", NULL}, NACRE_FLOAT);
    struct picture colour = read_picture(path);
    TEST_ASSERT_EQUAL_FLOAT((float)'R', colour.rgb[3]);
    TEST_ASSERT_EQUAL_FLOAT((float)'B', colour.rgb[5]);
    picture_finish(&colour);
    write_exr_channels(name("rg.exr"), (const char *const[]){"R", "G", NULL}, NACRE_FLOAT);
    expect_refusal(path, "no channel B");
    write_exr_channels(name("raw.exr"), (const char *const[]){"Y", NULL}, NACRE_UINT);
    expect_refusal(path, "holds integers");
}

static void png_round_trips_every_byte_value(void)
{
    struct picture picture, again;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&picture, 256, 1, &error));
    for (int i = 0; i < 256; i++) {
        for (int c = 0; c < 3; c++) {
            picture.rgb[3 * i + c] = (float)from_srgb((c == 1 ? 255 - i : i) / 255.0);
        }
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_write(name("a.PNG"), &picture, NULL, &error),
                                  error.text);
    again = read_picture(path);
    TEST_ASSERT_EQUAL_INT(256, again.width);
    for (size_t i = 0; i < 768; i++) {
        /* Both are the float nearest to the same double: equal. */
        TEST_ASSERT_EQUAL_HEX32(*(unsigned *)(void *)&picture.rgb[i],
                                *(unsigned *)(void *)&again.rgb[i]);
    }
    picture_finish(&picture);
    picture_finish(&again);
}

static void png_keeps_attributes_as_text(void)
{
    const char *const attributes[] = {"without=highlights, shadows", "scene=\303\244.yaml", NULL};
    static const char ascii[] = "tEXtnacre.without\0highlights, shadows";
    static const char wide[] = "iTXtnacre.scene\0\0\0\0\0\303\244.yaml";
    struct nacre_error error;
    struct picture picture;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&picture, 2, 2, &error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, picture_write(name("a.png"), &picture, attributes, &error), error.text);
    picture_finish(&picture);
    size_t size = 0;
    uint8_t *bytes = file_read(name("a.png"), &size);
    TEST_ASSERT_NOT_NULL(bytes);
    TEST_ASSERT_NOT_NULL(memmem(bytes, size, ascii, sizeof ascii - 1));
    TEST_ASSERT_NOT_NULL(memmem(bytes, size, wide, sizeof wide - 1));
    free(bytes);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_read(name("a.png"), &picture, &error),
                                  error.text);
    picture_finish(&picture);
}

static void png_clips_and_shows_nan_as_magenta(void)
{
    static const float linear[] = {-1, 2, 0.5F, NAN, 0, 0, INFINITY, -INFINITY, 0.2140411F};
    /* 0.5 is 0.7353570 in sRGB, 187.5160 of 255, so 188; 0.2140411 is 0.5, 127.5, so 127 or 128. */
    struct picture picture, again;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&picture, 3, 1, &error));
    memcpy(picture.rgb, linear, sizeof linear);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_write(name("a.png"), &picture, NULL, &error),
                                  error.text);
    again = read_picture(path);
    TEST_ASSERT_EQUAL_FLOAT(0, again.rgb[0]);
    TEST_ASSERT_EQUAL_FLOAT(1, again.rgb[1]);
    TEST_ASSERT_EQUAL_FLOAT((float)from_srgb(188 / 255.0), again.rgb[2]);
    TEST_ASSERT_EQUAL_FLOAT(1, again.rgb[3]);
    TEST_ASSERT_EQUAL_FLOAT(0, again.rgb[4]);
    TEST_ASSERT_EQUAL_FLOAT(1, again.rgb[5]);
    TEST_ASSERT_EQUAL_FLOAT(1, again.rgb[6]);
    TEST_ASSERT_EQUAL_FLOAT(0, again.rgb[7]);
    picture_finish(&picture);
    picture_finish(&again);
}

static void png_of_every_kind_is_read(void)
{
    static const unsigned char grey1[] = {0xa0};    /* 1 0 1 0 */
    static const unsigned char palette2[] = {0x1b}; /* 0 1 2 3 */
    static const unsigned char grey16[] = {0x00, 0x01, 0x80, 0x00, 0xff, 0xff};
    static const unsigned char rgba8[] = {255, 128, 0, 255, 255, 128, 0, 51};
    struct picture p;
    write_png(name("g1.png"), 4, 1, 1, PNG_COLOR_TYPE_GRAY, grey1, 1, 0, PNG_INTERLACE_NONE);
    p = read_picture(path);
    TEST_ASSERT_EQUAL_FLOAT(1, p.rgb[0]);
    TEST_ASSERT_EQUAL_FLOAT(0, p.rgb[4]);
    TEST_ASSERT_EQUAL_FLOAT(1, p.rgb[8]);
    picture_finish(&p);
    write_png(name("p2.png"), 4, 1, 2, PNG_COLOR_TYPE_PALETTE, palette2, 1, 0, PNG_INTERLACE_NONE);
    p = read_picture(path);
    TEST_ASSERT_EQUAL_FLOAT(1, p.rgb[0]);
    TEST_ASSERT_EQUAL_FLOAT(0, p.rgb[4]); /* green, but wholly transparent */
    TEST_ASSERT_EQUAL_FLOAT(1, p.rgb[8]);
    TEST_ASSERT_EQUAL_FLOAT((float)from_srgb(20 / 255.0), p.rgb[10]);
    picture_finish(&p);
    write_png(name("g16.png"), 3, 1, 16, PNG_COLOR_TYPE_GRAY, grey16, 6, 0, PNG_INTERLACE_NONE);
    p = read_picture(path);
    TEST_ASSERT_EQUAL_FLOAT((float)from_srgb(1 / 65535.0), p.rgb[0]);
    TEST_ASSERT_EQUAL_FLOAT((float)from_srgb(32768 / 65535.0), p.rgb[5]);
    TEST_ASSERT_EQUAL_FLOAT(1, p.rgb[8]);
    picture_finish(&p);
    write_png(name("rgba.png"), 2, 1, 8, PNG_COLOR_TYPE_RGBA, rgba8, 8, 0, PNG_INTERLACE_NONE);
    p = read_picture(path);
    TEST_ASSERT_EQUAL_FLOAT((float)from_srgb(128 / 255.0), p.rgb[1]);
    TEST_ASSERT_EQUAL_FLOAT(0.2F, p.rgb[3]);
    TEST_ASSERT_EQUAL_FLOAT(0.2F * (float)from_srgb(128 / 255.0), p.rgb[4]);
    picture_finish(&p);
}

static void png_that_says_its_gamma_is_read_by_it(void)
{
    static const unsigned char half[] = {128};
    struct picture p;
    write_png(name("linear.png"), 1, 1, 8, PNG_COLOR_TYPE_GRAY, half, 1, 1.0, PNG_INTERLACE_NONE);
    p = read_picture(path);
    TEST_ASSERT_EQUAL_FLOAT(128 / 255.0F, p.rgb[0]);
    picture_finish(&p);
    write_png(name("usual.png"), 1, 1, 8, PNG_COLOR_TYPE_GRAY, half, 1, 0.45455,
              PNG_INTERLACE_NONE);
    p = read_picture(path);
    TEST_ASSERT_EQUAL_FLOAT((float)from_srgb(128 / 255.0), p.rgb[0]);
    picture_finish(&p);
}

static void interlaced_png_is_read_like_the_other(void)
{
    unsigned char rows[9 * 13 * 3];
    struct picture plain, interlaced;
    for (size_t i = 0; i < sizeof rows; i++) {
        rows[i] = (unsigned char)(i * 37);
    }
    write_png(name("a.png"), 9, 13, 8, PNG_COLOR_TYPE_RGB, rows, 27, 0, PNG_INTERLACE_NONE);
    plain = read_picture(path);
    write_png(name("b.png"), 9, 13, 8, PNG_COLOR_TYPE_RGB, rows, 27, 0, PNG_INTERLACE_ADAM7);
    interlaced = read_picture(path);
    TEST_ASSERT_EQUAL_FLOAT((float)from_srgb(37 / 255.0), plain.rgb[1]);
    TEST_ASSERT_EQUAL_FLOAT_ARRAY(plain.rgb, interlaced.rgb, 9 * 13 * 3);
    picture_finish(&plain);
    picture_finish(&interlaced);
}

static void png_cut_anywhere_is_refused(void)
{
    struct picture ramp = make_ramp(20, 10);
    struct nacre_error error = {""};
    unsigned char *bytes = NULL;
    size_t size = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_encode_png(&ramp, &bytes, &size, &error),
                                  error.text);
    (void)name("cut.png");
    for (size_t cut = 0; cut < size; cut += cut < 60 ? 1 : 13) {
        file_write(path, bytes, cut);
        expect_refusal(path, "PNG:");
    }
    bytes[size / 2] ^= 0x55;
    file_write(path, bytes, size);
    expect_refusal(path, "PNG:");
    free(bytes);
    picture_finish(&ramp);
}

static void png_that_claims_more_than_it_can_hold_is_refused_without_allocating(void)
{
    static const unsigned char one[] = {7};
    write_png(name("a.png"), 1, 1, 8, PNG_COLOR_TYPE_GRAY, one, 1, 0, PNG_INTERLACE_NONE);
    size_t size = 0;
    uint8_t *bytes = file_read(path, &size);
    TEST_ASSERT_TRUE(bytes && size > 33);
    bytes[17] = bytes[21] = 1; /* 65537 x 65537; the header's checksum must be right again */
    unsigned crc = 0xffffffffU;
    for (size_t i = 12; i < 29; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = crc & 1 ? crc >> 1 ^ 0xedb88320U : crc >> 1;
        }
    }
    for (size_t i = 0; i < 4; i++) {
        bytes[29 + i] = (unsigned char)(~crc >> (24 - 8 * i));
    }
    file_write(name("big.png"), bytes, size);
    free(bytes);
    expect_refusal(path, "truncated");
}

static void names_without_a_known_ending_are_refused(void)
{
    static const char *const bad[] = {"a.jpg", "png", "a.exr.txt", "a", "x.png/a"};
    struct picture ramp = make_ramp(1, 1);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct nacre_error error = {""};
        (void)name(bad[i]);
        expect_refusal(path, ".exr or .png");
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, picture_write(path, &ramp, NULL, &error));
        TEST_ASSERT_NOT_NULL(strstr(error.text, ".exr or .png"));
    }
    picture_finish(&ramp);
}

static void files_that_are_not_there_or_something_else_are_refused(void)
{
    expect_refusal(name("none.png"), "No such file or directory");
    expect_refusal(name("none.exr"), "none.exr");
    file_write(name("text.png"), "this is text", 12);
    expect_refusal(path, "PNG:");
    file_write(name("text.exr"), "this is text", 12);
    expect_refusal(path, "text.exr");
    file_write(name("empty.png"), "", 0);
    expect_refusal(path, "PNG:");
}

static void a_failed_write_leaves_no_file(void)
{
    struct picture ramp = make_ramp(4, 4);
    static const char *const leaves[] = {"none/a.png", "none/a.exr"};
    for (size_t i = 0; i < 2; i++) {
        struct nacre_error error = {""};
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, picture_write(name(leaves[i]), &ramp, NULL, &error));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, leaves[i]), error.text);
    }
    picture_finish(&ramp);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(pictures_of_impossible_sizes_are_refused);
    RUN_TEST(exr_keeps_values_to_the_precision_of_half);
    RUN_TEST(exr_keeps_what_half_cannot_hold_by_floats);
    RUN_TEST(exr_carries_the_attributes_given);
    RUN_TEST(attributes_without_key_or_value_are_refused);
    RUN_TEST(exr_of_one_channel_is_grey_and_others_are_refused);
    RUN_TEST(png_round_trips_every_byte_value);
    RUN_TEST(png_keeps_attributes_as_text);
    RUN_TEST(png_clips_and_shows_nan_as_magenta);
    RUN_TEST(png_of_every_kind_is_read);
    RUN_TEST(png_that_says_its_gamma_is_read_by_it);
    RUN_TEST(interlaced_png_is_read_like_the_other);
    RUN_TEST(png_cut_anywhere_is_refused);
    RUN_TEST(png_that_claims_more_than_it_can_hold_is_refused_without_allocating);
    RUN_TEST(names_without_a_known_ending_are_refused);
    RUN_TEST(files_that_are_not_there_or_something_else_are_refused);
    RUN_TEST(a_failed_write_leaves_no_file);
    return UNITY_END();
}
