/* OpenEXR files in memory, written and read back. */
#include "nacre/exr_file.h"
#include "nacre/material.h"
#include "scratch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unity.h>

void setUp(void)
{
    scratch_make();
}

void tearDown(void)
{
    scratch_limit_files(0);
    scratch_remove();
}

static uint32_t next_random(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return *state ^ *state >> 15;
}

static float from_bits(uint32_t bits)
{
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Any 32 bits, with the numbers that break conversions in front. */
static void fill_awkward(float *values, size_t count, uint32_t seed)
{
    static const float awkward[] = {0.0f,     -0.0f,   1.0f,          65504.0f,      65519.99f,
                                    65520.0f, 1e30f,   -1e30f,        INFINITY,      -INFINITY,
                                    NAN,      6.1e-5f, 5.9604645e-8f, 2.9802322e-8f, 2.98023224e-8f,
                                    3e-8f,    1e-40f,  1.00048828f,   1.00146484f,   2049.0f};
    for (size_t i = 0; i < count; i++) {
        values[i] =
            i < sizeof awkward / sizeof awkward[0] ? awkward[i] : from_bits(next_random(&seed));
    }
}

/* The nearest HALF by its definition: 11 significant bits, exponents from -14, ties to even, infinity from 65520. */
static double nearest_half(double value)
{
    int exponent = 0;
    if (isnan(value) || isinf(value) || value == 0) {
        return value;
    }
    (void)frexp(value, &exponent); /* 0.5 <= |mantissa| < 1 */
    double quantum = ldexp(1, (exponent - 1 > -14 ? exponent - 1 : -14) - 10);
    double rounded = rint(value / quantum) * quantum;
    return fabs(rounded) >= 65520 ? copysign(INFINITY, value) : rounded;
}

enum { WIDTH = 37, HEIGHT = 41, POINTS = WIDTH * HEIGHT };

/* Two parts of different size with each pixel type and each kind of attribute. */
static void build(struct exr_file *file)
{
    static const float floats[] = {1.5f, -2.25f, 1e-30f};
    static const char *const strings[] = {"first", "", "third one"};
    *file = (struct exr_file){0};
    struct exr_part *part = exr_file_add_part(file, "one", WIDTH, HEIGHT);
    TEST_ASSERT_NOT_NULL(part);
    struct exr_plane *plane = exr_part_add_plane(part, "Y", NACRE_FLOAT);
    fill_awkward(plane->values, POINTS, 1);
    plane = exr_part_add_plane(part, "a", NACRE_UINT);
    for (uint32_t i = 0; i < POINTS; i++) {
        plane->integers[i] = i * 2654435761u;
    }
    plane = exr_part_add_plane(part, "t00.R", NACRE_HALF);
    fill_awkward(plane->values, POINTS, 2);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_part_add_int(part, "nacre.int", -7));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_part_add_float(part, "nacre.float", 0.1f));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_part_add_string(part, "nacre.string", "caf\xc3\xa9 \"x\""));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_part_add_floats(part, "nacre.floats", floats, 3));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_part_add_strings(part, "nacre.strings", strings, 3));
    part = exr_file_add_part(file, "two", 3, 100);
    plane = exr_part_add_plane(part, "Y", NACRE_FLOAT);
    fill_awkward(plane->values, 300, 3);
}

static void expect_same_bits(const void *expected, const void *got, size_t count)
{
    TEST_ASSERT_EQUAL_HEX32_ARRAY(expected, got, count);
}

static void expect_round_trip(enum exr_compression compression)
{
    struct nacre_error error = {0};
    struct exr_file file;
    struct exr_file back;
    build(&file);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, exr_file_write(scratch_path("a.exr"), &file, compression, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exr_file_read(scratch_path("a.exr"), &back, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_UINT64(2, back.part_count);
    const struct exr_part *part = exr_file_find_part(&back, "one");
    TEST_ASSERT_NOT_NULL(part);
    TEST_ASSERT_EQUAL_INT(WIDTH, part->width);
    TEST_ASSERT_EQUAL_INT(HEIGHT, part->height);
    TEST_ASSERT_EQUAL_UINT64(3, part->plane_count);
    expect_same_bits(file.parts[0].planes[0].values, exr_part_find_plane(part, "Y")->values,
                     POINTS);
    expect_same_bits(file.parts[0].planes[1].values, exr_part_find_plane(part, "a")->values,
                     POINTS);
    TEST_ASSERT_EQUAL_INT(NACRE_UINT, exr_part_find_plane(part, "a")->pixel);
    TEST_ASSERT_EQUAL_INT(NACRE_HALF, exr_part_find_plane(part, "t00.R")->pixel);
    TEST_ASSERT_NULL(exr_part_find_plane(part, "Z"));
    part = exr_file_find_part(&back, "two");
    TEST_ASSERT_EQUAL_INT(3, part->width);
    expect_same_bits(file.parts[1].planes[0].values, part->planes[0].values, 300);
    TEST_ASSERT_NULL(exr_file_find_part(&back, "three"));
    exr_file_finish(&file);
    exr_file_finish(&back);
}

static void uncompressed_pixels_come_back_bit_for_bit(void)
{
    expect_round_trip(EXR_UNCOMPRESSED);
}

static void compressed_pixels_come_back_bit_for_bit(void)
{
    expect_round_trip(EXR_ZIP);
}

/* Random bits behind a few zeros: over 400 chunks compress to about their own size, some to exactly that. */
static void pixels_that_hardly_shrink_come_back(void)
{
    enum { COLUMNS = 49, ROWS = 16 * 400 };
    struct nacre_error error = {0};
    struct exr_file file = {0}, got = {0};
    struct exr_part *part = exr_file_add_part(&file, "", COLUMNS, ROWS);
    struct exr_plane *plane = exr_part_add_plane(part, "Y", NACRE_FLOAT);
    uint32_t state = 7;
    for (int i = 0; i < COLUMNS * ROWS; i++) {
        int chunk = i / (16 * COLUMNS), place = i % (16 * COLUMNS);
        plane->values[i] = place < chunk % 20 ? 0 : from_bits(next_random(&state) % 0x7f000000u);
    }
    TEST_ASSERT_EQUAL_MESSAGE(
        NACRE_OK, exr_file_write(scratch_path("n.exr"), &file, EXR_ZIP, &error), error.text);
    TEST_ASSERT_EQUAL_MESSAGE(NACRE_OK, exr_file_read(scratch_path("n.exr"), &got, &error),
                              error.text);
    for (int y = 0; y < ROWS; y += 16) {
        expect_same_bits(plane->values + y * COLUMNS, got.parts[0].planes[0].values + y * COLUMNS,
                         16 * COLUMNS);
    }
    exr_file_finish(&file);
    exr_file_finish(&got);
}

static void attributes_come_back(void)
{
    struct nacre_error error = {0};
    struct exr_file file;
    struct exr_file back;
    build(&file);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_write(scratch_path("a.exr"), &file, EXR_ZIP, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_read(scratch_path("a.exr"), &back, &error));
    const struct exr_part *part = &back.parts[0];
    TEST_ASSERT_EQUAL_UINT64(5, part->attribute_count); /* OpenEXR's own are not among them */
    TEST_ASSERT_EQUAL_INT(-7, exr_part_find(part, "nacre.int", EXR_INT)->integer);
    TEST_ASSERT_TRUE(exr_part_find(part, "nacre.float", EXR_FLOAT)->real == 0.1f);
    TEST_ASSERT_EQUAL_STRING("caf\xc3\xa9 \"x\"",
                             exr_part_find(part, "nacre.string", EXR_STRING)->string);
    const struct exr_attribute *list = exr_part_find(part, "nacre.floats", EXR_FLOATS);
    TEST_ASSERT_EQUAL_UINT64(3, list->count);
    expect_same_bits(file.parts[0].attributes[3].floats, list->floats, 3);
    list = exr_part_find(part, "nacre.strings", EXR_STRINGS);
    TEST_ASSERT_EQUAL_UINT64(3, list->count);
    TEST_ASSERT_EQUAL_STRING("first", list->strings[0]);
    TEST_ASSERT_EQUAL_STRING("", list->strings[1]);
    TEST_ASSERT_EQUAL_STRING("third one", list->strings[2]);
    TEST_ASSERT_NULL(exr_part_find(part, "nacre.int", EXR_FLOAT));
    TEST_ASSERT_NULL(exr_part_find(&back.parts[1], "nacre.int", EXR_INT));
    exr_file_finish(&file);
    exr_file_finish(&back);
}

/* Every value that comes back from a HALF plane is the nearest one by HALF's definition, and the one that
 * nacre_material_round gives. */
static void half_rounds_to_the_nearest(void)
{
    enum { COUNT = 65536 };
    struct nacre_error error = {0};
    struct exr_file file = {0};
    struct exr_file back;
    struct exr_part *part = exr_file_add_part(&file, "", 256, 256);
    struct exr_plane *plane = exr_part_add_plane(part, "Y", NACRE_HALF);
    fill_awkward(plane->values, COUNT, 99);
    for (size_t i = COUNT / 2; i < COUNT; i++) { /* half of them where HALF has values */
        float value = plane->values[i];
        if (isfinite(value) && value != 0) {
            plane->values[i] = ldexpf(value, (int)(i % 36) - 18 - ilogbf(value));
        }
    }
    float *rounded = malloc(COUNT * sizeof *rounded);
    memcpy(rounded, plane->values, COUNT * sizeof *rounded);
    struct nacre_material material = {.width = 256,
                                      .height = 256,
                                      .channels = 1,
                                      .terms = 1,
                                      .factor_channels = 1,
                                      .pixel = NACRE_HALF,
                                      .f = rounded};
    nacre_material_round(&material);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          exr_file_write(scratch_path("a.exr"), &file, EXR_UNCOMPRESSED, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_read(scratch_path("a.exr"), &back, &error));
    int finite = 0;
    for (size_t i = 0; i < COUNT; i++) {
        float value = plane->values[i];
        float got = back.parts[0].planes[0].values[i];
        double expected = nearest_half((double)value);
        if (isnan(value)) {
            TEST_ASSERT_TRUE(isnan(got) && isnan(rounded[i]));
            continue;
        }
        finite += isfinite(got) && got != 0;
        TEST_ASSERT_TRUE(expected == (double)got && !signbit(expected) == !signbit(got));
        TEST_ASSERT_TRUE(rounded[i] == got && !signbit(rounded[i]) == !signbit(got));
    }
    TEST_ASSERT_TRUE(finite > COUNT / 4); /* else nothing was tested */
    free(rounded);
    exr_file_finish(&file);
    exr_file_finish(&back);
}

static void long_names_come_back(void)
{
    static const char name[] = "a.name.of.more.than.thirty.one.characters.that.is.allowed.x";
    struct nacre_error error = {0};
    struct exr_file file = {0};
    struct exr_file back;
    struct exr_part *part = exr_file_add_part(&file, "", 1, 1);
    exr_part_add_plane(part, name, NACRE_FLOAT)->values[0] = 3;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, exr_file_write(scratch_path("a.exr"), &file, EXR_ZIP, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exr_file_read(scratch_path("a.exr"), &back, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_STRING(name, back.parts[0].planes[0].name);
    TEST_ASSERT_EQUAL_STRING("", back.parts[0].name);
    TEST_ASSERT_TRUE(back.parts[0].planes[0].values[0] == 3);
    exr_file_finish(&file);
    exr_file_finish(&back);
}

static void names_of_more_than_63_characters_are_not_added(void)
{
    char name[65];
    memset(name, 'n', 64);
    name[64] = '\0';
    struct exr_file file = {0};
    TEST_ASSERT_NULL(exr_file_add_part(&file, name, 1, 1));
    struct exr_part *part = exr_file_add_part(&file, "", 1, 1);
    TEST_ASSERT_NULL(exr_part_add_plane(part, name, NACRE_FLOAT));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, exr_part_add_int(part, name, 1));
    TEST_ASSERT_EQUAL_UINT64(1, file.part_count);
    TEST_ASSERT_EQUAL_UINT64(0, part->plane_count + part->attribute_count);
    exr_file_finish(&file);
    exr_file_finish(NULL);
}

static void expect_unwritable(const struct exr_file *file, const char *why)
{
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          exr_file_write(scratch_path("a.exr"), file, EXR_ZIP, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
    TEST_ASSERT_EQUAL_INT(0, scratch_count());
}

static void files_that_no_reader_would_take_are_not_written(void)
{
    struct exr_file file = {0};
    expect_unwritable(&file, "no parts");
    (void)exr_file_add_part(&file, "", 4, 4);
    expect_unwritable(&file, "no channels");
    (void)exr_part_add_plane(&file.parts[0], "Y", NACRE_FLOAT);
    (void)exr_part_add_plane(&file.parts[0], "Y", NACRE_HALF);
    expect_unwritable(&file, "channel Y twice");
    (void)snprintf(file.parts[0].planes[1].name, 64, "%s", "Z");
    (void)exr_file_add_part(&file, "b", 4, 4);
    expect_unwritable(&file, "has no name");
    (void)snprintf(file.parts[0].name, 64, "%s", "b");
    expect_unwritable(&file, "two parts are named b");
    exr_file_finish(&file);
    (void)exr_file_add_part(&file, "", 0, 4);
    expect_unwritable(&file, "0 x 4 pixels");
    exr_file_finish(&file);
}

static void expect_unreadable(const char *path, const char *why)
{
    struct nacre_error error = {0};
    struct exr_file file;
    scratch_hush();
    int status = exr_file_read(path, &file, &error);
    scratch_hush_end();
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
    TEST_ASSERT_NULL_MESSAGE(strchr(error.text, '\n'), error.text);
    TEST_ASSERT_EQUAL_UINT64(0, file.part_count);
    TEST_ASSERT_NULL(file.parts);
}

static void what_is_no_exr_file_is_refused(void)
{
    expect_unreadable(scratch_path("none.exr"), "none.exr: cannot open: No such file");
    expect_unreadable(scratch_path(""), "not a plain file");
    TEST_ASSERT_EQUAL_INT(0, mkfifo(scratch_path("pipe"), 0600));
    expect_unreadable(scratch_path("pipe"), "pipe: cannot open: not a plain file");
    scratch_store("a.exr", "", 0);
    expect_unreadable(scratch_path("a.exr"), "a.exr: not an OpenEXR file: it is empty");
    scratch_store("a.exr", "\x76\x2f", 2);
    expect_unreadable(scratch_path("a.exr"), "not an OpenEXR file");
    scratch_store("a.exr", "%PDF-1.4 and so on", 18);
    expect_unreadable(scratch_path("a.exr"), "not an OpenEXR file: it begins with other bytes");
    scratch_store("a.exr", "\x76\x2f\x31\x01\x02\0\0\0", 8);
    expect_unreadable(scratch_path("a.exr"), "header is damaged or incomplete");
}

/* A header that announces more than the file can hold costs no memory. */
static void hostile_sizes_are_refused_before_anything_is_allocated(void)
{
    static const int32_t huge[4] = {0, 0, 400000000, 400000000};
    static const int32_t upside_down[4] = {0, 0, -5, 3};
    struct nacre_error error = {0};
    struct exr_file file = {0};
    size_t size = 0;
    (void)exr_part_add_plane(exr_file_add_part(&file, "", 16, 16), "Y", NACRE_FLOAT);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_write(scratch_path("a.exr"), &file, EXR_ZIP, &error));
    exr_file_finish(&file);
    unsigned char *bytes = scratch_load("a.exr", &size);
    size_t window = scratch_find(bytes, size, "dataWindow\0box2i\0\x10\0\0\0", 21) + 21;
    memcpy(bytes + window, huge, sizeof huge);
    scratch_store("a.exr", bytes, size);
    expect_unreadable(scratch_path("a.exr"), "a.exr: ");
    memcpy(bytes + window, upside_down, sizeof upside_down);
    scratch_store("a.exr", bytes, size);
    expect_unreadable(scratch_path("a.exr"), "a.exr: ");
    free(bytes);
}

static void file_cut_off_anywhere_is_refused(void)
{
    struct nacre_error error = {0};
    struct exr_file file;
    size_t size = 0;
    build(&file);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_write(scratch_path("a.exr"), &file, EXR_ZIP, &error));
    exr_file_finish(&file);
    unsigned char *bytes = scratch_load("a.exr", &size);
    for (size_t length = 0; length < size; length += length < 1500 ? 7 : 331) {
        scratch_store("cut.exr", bytes, length);
        expect_unreadable(scratch_path("cut.exr"), "cut.exr: ");
    }
    scratch_store("cut.exr", bytes, size - 1);
    expect_unreadable(scratch_path("cut.exr"), "part two: ");
    free(bytes);
}

/* Whatever a damaged file says, reading ends with success or an error, and prints nothing. Run under the address
 * sanitizer this is the test of memory safety. */
static void damaged_bytes_never_crash(void)
{
    struct nacre_error error = {0};
    struct exr_file file;
    size_t size = 0;
    uint32_t state = 7;
    int refused = 0;
    build(&file);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_write(scratch_path("a.exr"), &file, EXR_ZIP, &error));
    exr_file_finish(&file);
    unsigned char *bytes = scratch_load("a.exr", &size);
    scratch_hush();
    for (int i = 0; i < 1500; i++) {
        size_t range = i % 3 ? 1700 : size; /* mostly in the headers */
        size_t at = next_random(&state) % (range < size ? range : size);
        unsigned char before = bytes[at];
        bytes[at] ^= (unsigned char)(1u << next_random(&state) % 8);
        scratch_store("b.exr", bytes, size);
        refused += exr_file_read(scratch_path("b.exr"), &file, &error) != NACRE_OK;
        exr_file_finish(&file);
        bytes[at] = before;
    }
    scratch_hush_end();
    TEST_ASSERT_TRUE(refused > 300); /* else the damage was no damage */
    free(bytes);
}

static void full_disk_leaves_the_old_file_alone(void)
{
    struct nacre_error error = {0};
    struct exr_file file;
    build(&file);
    scratch_store("a.exr", "old", 3);
    for (size_t limit = 100; limit < 9000; limit += 2900) { /* in the header, in the pixels */
        scratch_hush();
        scratch_limit_files(limit);
        int status = exr_file_write(scratch_path("a.exr"), &file, EXR_ZIP, &error);
        scratch_limit_files(0);
        scratch_hush_end();
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "File too large"), error.text);
        TEST_ASSERT_EQUAL_INT(1, scratch_count());
    }
    size_t size = 0;
    unsigned char *bytes = scratch_load("a.exr", &size);
    TEST_ASSERT_EQUAL_UINT64(3, size);
    free(bytes);
    exr_file_finish(&file);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(uncompressed_pixels_come_back_bit_for_bit);
    RUN_TEST(compressed_pixels_come_back_bit_for_bit);
    RUN_TEST(pixels_that_hardly_shrink_come_back);
    RUN_TEST(attributes_come_back);
    RUN_TEST(half_rounds_to_the_nearest);
    RUN_TEST(long_names_come_back);
    RUN_TEST(names_of_more_than_63_characters_are_not_added);
    RUN_TEST(files_that_no_reader_would_take_are_not_written);
    RUN_TEST(what_is_no_exr_file_is_refused);
    RUN_TEST(hostile_sizes_are_refused_before_anything_is_allocated);
    RUN_TEST(file_cut_off_anywhere_is_refused);
    RUN_TEST(damaged_bytes_never_crash);
    RUN_TEST(full_disk_leaves_the_old_file_alone);
    return UNITY_END();
}
