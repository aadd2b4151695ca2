/* Scans, written and read back response by response. */
#include "nacre/exr_file.h"
#include "nacre/scan.h"
#include "scratch.h"

#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
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

static struct nacre_scan_info plain(void)
{
    return (struct nacre_scan_info){.width = 7,
                                    .height = 5,
                                    .window = 9,
                                    .channels = 3,
                                    .pixel = NACRE_FLOAT,
                                    .pitch_mm = 0.375,
                                    .source = "a test"};
}

/* A value that tells point, channel and entry apart, exact in HALF too: 11 bits and a power of 2. */
static float value_at(int x, int y, int i)
{
    return ldexpf((float)(1 + (x * 131 + y * 71 + i * 17) % 2047), -11 - i % 5);
}

static bool inside(const struct nacre_scan_info *info, int x, int y, int i)
{
    int window = info->window;
    int xo = x + i % window - window / 2;
    int yo = y + i / window % window - window / 2;
    return xo >= 0 && yo >= 0 && xo < info->width && yo < info->height;
}

/* Every entry is filled, those outside the sample as well. */
static void fill(const struct nacre_scan_info *info, int x, int y, float *response)
{
    int size = (int)nacre_scan_response_size(info);
    for (int i = 0; i < size; i++) {
        response[i] = value_at(x, y, i);
    }
}

static float *allocate(const struct nacre_scan_info *info)
{
    float *response = calloc(nacre_scan_response_size(info), sizeof *response);
    TEST_ASSERT_NOT_NULL(response);
    return response;
}

static struct nacre_scan_writer *create(const char *name, const struct nacre_scan_info *info)
{
    struct nacre_error error = {0};
    struct nacre_scan_writer *writer = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, nacre_scan_create(scratch_path(name), info, &writer, &error), error.text);
    return writer;
}

static void write_point(struct nacre_scan_writer *writer, int x, int y, const float *response)
{
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_scan_write(writer, x, y, response, &error),
                                  error.text);
}

static void commit(struct nacre_scan_writer *writer)
{
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_scan_commit(writer, &error), error.text);
}

/* Write all points of a made scan, the last first and then every other one: no order that a file would have. */
static void write_scan(const char *name, const struct nacre_scan_info *info)
{
    struct nacre_scan_writer *writer = create(name, info);
    float *response = allocate(info);
    int count = info->width * info->height;
    for (int pass = 0; pass < 2; pass++) {
        for (int i = count - 1 - pass; i >= 0; i -= 2) {
            fill(info, i % info->width, i / info->width, response);
            write_point(writer, i % info->width, i / info->width, response);
        }
    }
    commit(writer);
    free(response);
}

static struct nacre_scan *open_scan(const char *name)
{
    struct nacre_error error = {0};
    struct nacre_scan *scan = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_scan_open(scratch_path(name), &scan, &error),
                                  error.text);
    return scan;
}

/* 0 where the response of (x, y) is what was written, with 0 outside the sample. */
static int wrong_entries(const struct nacre_scan *scan, int x, int y, float *response)
{
    const struct nacre_scan_info *info = nacre_scan_info(scan);
    int size = (int)nacre_scan_response_size(info);
    int wrong = 0;
    if (nacre_scan_read(scan, x, y, response, NULL) != NACRE_OK) {
        return size;
    }
    for (int i = 0; i < size; i++) {
        wrong += response[i] != (inside(info, x, y, i) ? value_at(x, y, i) : 0);
    }
    return wrong;
}

static void expect_round_trip(const struct nacre_scan_info *info)
{
    write_scan("a.exr", info);
    struct nacre_scan *scan = open_scan("a.exr");
    const struct nacre_scan_info *got = nacre_scan_info(scan);
    TEST_ASSERT_EQUAL_INT(info->width, got->width);
    TEST_ASSERT_EQUAL_INT(info->height, got->height);
    TEST_ASSERT_EQUAL_INT(info->window, got->window);
    TEST_ASSERT_EQUAL_INT(info->channels, got->channels);
    TEST_ASSERT_EQUAL_INT(info->pixel, got->pixel);
    TEST_ASSERT_TRUE((float)info->pitch_mm == (float)got->pitch_mm);
    TEST_ASSERT_EQUAL_STRING(info->source, got->source);
    float *response = allocate(info);
    for (int y = 0; y < info->height; y++) {
        for (int x = 0; x < info->width; x++) {
            TEST_ASSERT_EQUAL_INT(0, wrong_entries(scan, x, y, response));
        }
    }
    free(response);
    nacre_scan_close(scan);
    TEST_ASSERT_EQUAL_INT(1, scratch_count());
}

static void scan_comes_back_in_every_pixel_type(void)
{
    struct nacre_scan_info info = plain();
    expect_round_trip(&info);
    info.pixel = NACRE_HALF;
    expect_round_trip(&info);
    info.compress = true;
    expect_round_trip(&info);
    info.pixel = NACRE_FLOAT;
    expect_round_trip(&info);
    info.channels = 1;
    expect_round_trip(&info);
}

static void awkward_sizes_come_back(void)
{
    static const int sizes[][3] = {{1, 1, 1}, {1, 1, 25}, {3, 1, 5}, {1, 4, 3}, {2, 3, 1}};
    struct nacre_scan_info info = plain();
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        info.width = sizes[i][0];
        info.height = sizes[i][1];
        info.window = sizes[i][2];
        expect_round_trip(&info);
    }
}

static void float_keeps_every_bit_and_half_the_nearest(void)
{
    static const float values[] = {0.1f,           1e-30f,   1.17549435e-38f, 3.0000002f,
                                   1.00048828125f, 65504.0f, 7e-8f,           2e-8f};
    static const float halves[] = {0.0999755859375f,       0, 0, 3, 1, 65504.0f,
                                   5.9604644775390625e-8f, 0};
    struct nacre_scan_info info = plain();
    info.width = info.height = 1;
    info.window = 1;
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        for (int half = 0; half < 2; half++) {
            float response[3] = {values[i], values[i], values[i]};
            info.pixel = half ? NACRE_HALF : NACRE_FLOAT;
            struct nacre_scan_writer *writer = create("a.exr", &info);
            write_point(writer, 0, 0, response);
            commit(writer);
            struct nacre_scan *scan = open_scan("a.exr");
            TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_scan_read(scan, 0, 0, response, NULL));
            nacre_scan_close(scan);
            TEST_ASSERT_TRUE(response[1] == (half ? halves[i] : values[i]));
        }
    }
}

static void nan_is_kept_and_points_never_written_are_nan(void)
{
    for (int half = 0; half < 2; half++) {
        struct nacre_scan_info info = plain();
        info.pixel = half ? NACRE_HALF : NACRE_FLOAT;
        struct nacre_scan_writer *writer = create("a.exr", &info);
        float *response = allocate(&info);
        int size = (int)nacre_scan_response_size(&info);
        int centre = info.window * info.window / 2;
        fill(&info, 3, 2, response);
        response[centre] = NAN;
        write_point(writer, 3, 2, response);
        commit(writer);
        struct nacre_scan *scan = open_scan("a.exr");
        TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_scan_read(scan, 3, 2, response, NULL));
        TEST_ASSERT_TRUE(isnan(response[centre]));
        TEST_ASSERT_TRUE(response[centre + 1] == value_at(3, 2, centre + 1));
        TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_scan_read(scan, 6, 4, response, NULL));
        for (int i = 0; i < size; i++) {
            TEST_ASSERT_TRUE(inside(&info, 6, 4, i) ? isnan(response[i]) : response[i] == 0);
        }
        free(response);
        nacre_scan_close(scan);
    }
}

struct reader {
    const struct nacre_scan *scan;
    int offset, wrong;
};

static void *read_all(void *argument)
{
    struct reader *reader = argument;
    const struct nacre_scan_info *info = nacre_scan_info(reader->scan);
    float *response = malloc(nacre_scan_response_size(info) * sizeof *response);
    int count = info->width * info->height;
    for (int i = 0; i < 4 * count && response; i++) {
        int point = (i * 37 + reader->offset) % count;
        reader->wrong +=
            wrong_entries(reader->scan, point % info->width, point / info->width, response);
    }
    reader->wrong += !response;
    free(response);
    return NULL;
}

/* Compressing on all cores changes nothing: the same responses in the same order are the same bytes. */
static void bytes_do_not_depend_on_threads(void)
{
    struct nacre_scan_info info = plain();
    size_t size = 0;
    size_t other_size = 0;
    info.width = 23;
    info.pixel = NACRE_HALF;
    info.compress = true;
    write_scan("a.exr", &info);
    unsigned char *bytes = scratch_load("a.exr", &size);
    for (int i = 0; i < 5; i++) {
        write_scan("b.exr", &info);
        unsigned char *other = scratch_load("b.exr", &other_size);
        TEST_ASSERT_EQUAL_UINT64(size, other_size);
        TEST_ASSERT_EQUAL_INT(0, memcmp(bytes, other, size));
        free(other);
    }
    free(bytes);
}

static void several_threads_read_one_scan(void)
{
    enum { THREADS = 4 };
    struct nacre_scan_info info = plain();
    info.width = 23;
    info.pixel = NACRE_HALF;
    info.compress = true;
    write_scan("a.exr", &info);
    struct nacre_scan *scan = open_scan("a.exr");
    struct reader readers[THREADS];
    pthread_t threads[THREADS];
    for (int i = 0; i < THREADS; i++) {
        readers[i] = (struct reader){.scan = scan, .offset = i * 11};
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&threads[i], NULL, read_all, &readers[i]));
    }
    for (int i = 0; i < THREADS; i++) {
        TEST_ASSERT_EQUAL_INT(0, pthread_join(threads[i], NULL));
        TEST_ASSERT_EQUAL_INT(0, readers[i].wrong);
    }
    nacre_scan_close(scan);
}

static void scan_is_seen_only_when_committed(void)
{
    struct nacre_scan_info info = plain();
    scratch_store("a.exr", "old", 3);
    struct nacre_scan_writer *writer = create("a.exr", &info);
    float *response = allocate(&info);
    write_point(writer, 0, 0, response);
    size_t size = 0;
    free(scratch_load("a.exr", &size));
    TEST_ASSERT_EQUAL_UINT64(3, size);
    nacre_scan_discard(writer);
    TEST_ASSERT_EQUAL_INT(1, scratch_count());
    nacre_scan_discard(NULL);
    nacre_scan_close(NULL);
    free(response);
}

static void expect_text(int status, const struct nacre_error *error, const char *text)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error->text, text), error->text);
    TEST_ASSERT_NULL_MESSAGE(strchr(error->text, '\n'), error->text);
}

static void points_outside_or_twice_are_refused(void)
{
    struct nacre_error error = {0};
    struct nacre_scan_info info = plain();
    struct nacre_scan_writer *writer = create("a.exr", &info);
    float *response = allocate(&info);
    expect_text(nacre_scan_write(writer, 7, 0, response, &error), &error,
                "a.exr: cannot write surface point (7, 0); the scan has 7 x 5");
    expect_text(nacre_scan_write(writer, 0, -1, response, &error), &error, "(0, -1)");
    write_point(writer, 1, 2, response);
    expect_text(nacre_scan_write(writer, 1, 2, response, &error), &error,
                "surface point (1, 2) was written already");
    commit(writer);
    struct nacre_scan *scan = open_scan("a.exr");
    TEST_ASSERT_EQUAL_STRING(scratch_path("a.exr"), nacre_scan_path(scan));
    expect_text(nacre_scan_read(scan, 7, 0, response, &error), &error,
                "a.exr: there is no surface point (7, 0); the scan has 7 x 5");
    expect_text(nacre_scan_read(scan, 0, 5, response, &error), &error, "(0, 5)");
    nacre_scan_close(scan);
    free(response);
}

static void expect_uncreatable(struct nacre_scan_info info, const char *text)
{
    struct nacre_error error = {0};
    struct nacre_scan_writer *writer = NULL;
    expect_text(nacre_scan_create(scratch_path("a.exr"), &info, &writer, &error), &error, text);
    TEST_ASSERT_NULL(writer);
    TEST_ASSERT_EQUAL_INT(0, scratch_count());
}

static void scans_that_cannot_be_are_not_created(void)
{
    struct nacre_scan_info info = plain();
    info.width = 0;
    expect_uncreatable(info, "0 x 5 surface points");
    info = plain();
    info.window = 8;
    expect_uncreatable(info, "a window of 8; it must be odd");
    info = plain();
    info.window = -3;
    expect_uncreatable(info, "a window of -3");
    info = plain();
    info.channels = 2;
    expect_uncreatable(info, "2 channels");
    info = plain();
    info.pixel = NACRE_UINT;
    expect_uncreatable(info, "store HALF or FLOAT");
    info = plain();
    info.pitch_mm = 0;
    expect_uncreatable(info, "a pitch of 0 mm");
    info.pitch_mm = NAN;
    expect_uncreatable(info, "a pitch of");
    info = plain();
    info.width = 100000000;
    info.window = 101;
    expect_uncreatable(info, "make the window smaller");
    struct nacre_error error = {0};
    struct nacre_scan_writer *writer = NULL;
    info = plain();
    expect_text(nacre_scan_create(scratch_path("no/a.exr"), &info, &writer, &error), &error,
                "does not exist");
}

static void expect_unopenable(const char *name, const char *text)
{
    struct nacre_error error = {0};
    struct nacre_scan *scan = NULL;
    scratch_hush();
    int status = nacre_scan_open(scratch_path(name), &scan, &error);
    scratch_hush_end();
    expect_text(status, &error, text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, name), error.text);
    TEST_ASSERT_NULL(scan);
}

static void files_that_are_no_scan_are_refused(void)
{
    struct nacre_error error = {0};
    struct exr_file file = {0};
    expect_unopenable("none.exr", "cannot open: No such file");
    scratch_store("text.exr", "not a picture", 13);
    expect_unopenable("text.exr", "not an OpenEXR file");
    struct exr_part *part = exr_file_add_part(&file, "one", 9, 9);
    (void)exr_part_add_plane(part, "Y", NACRE_FLOAT);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_write(scratch_path("s.exr"), &file, EXR_ZIP, &error));
    expect_unopenable("s.exr", "not a scan: it has no tiles");
    part = exr_file_add_part(&file, "two", 9, 9);
    (void)exr_part_add_plane(part, "Y", NACRE_FLOAT);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_write(scratch_path("s.exr"), &file, EXR_ZIP, &error));
    expect_unopenable("s.exr", "not a scan: it has several parts");
    exr_file_finish(&file);
}

/* Replace `length` bytes behind the text `mark` of a good scan and open the result. */
static void expect_patch_refused(const char *mark, size_t mark_length, const void *patch,
                                 size_t length, const char *text)
{
    size_t size = 0;
    unsigned char *bytes = scratch_load("good.exr", &size);
    size_t at = scratch_find(bytes, size, mark, mark_length) + mark_length;
    memcpy(bytes + at, patch, length);
    scratch_store("bad.exr", bytes, size);
    free(bytes);
    expect_unopenable("bad.exr", text);
}

static void headers_that_are_no_scan_are_refused(void)
{
    static const uint32_t not_square[2] = {9, 7};
    static const uint32_t even[2] = {10, 10};
    static const uint32_t not_whole[2] = {11, 11};
    static const int32_t huge[4] = {0, 0, 9 * 30000000 - 1, 44};
    static const float nothing = 0;
    static const float negative = -1;
    static const float nan = NAN;
    static const int32_t other_window = 11;
    struct nacre_scan_info info = plain();
    write_scan("good.exr", &info);
    nacre_scan_close(open_scan("good.exr"));
#define MARK(text) text, sizeof(text) - 1
    expect_patch_refused(MARK("tiledesc\0\x09\0\0\0"), not_square, 8, "tiles are 9 x 7 pixels");
    expect_patch_refused(MARK("tiledesc\0\x09\0\0\0"), even, 8, "tiles are 10 x 10 pixels");
    expect_patch_refused(MARK("tiledesc\0\x09\0\0\0"), not_whole, 8, "no whole number of 11 x 11");
    expect_patch_refused(MARK("dataWindow\0box2i\0\x10\0\0\0"), huge, 16, "an incomplete file");
    expect_patch_refused(MARK("nacre.form"), "AT", 2, "nacre.format is missing");
    expect_patch_refused(MARK("scan "), "9", 1,
                         "nacre.format is \"scan 9\", and this program reads \"scan 1\"");
    expect_patch_refused(MARK("nacre.pitc"), "H", 1, "nacre.pitch (float, mm");
    expect_patch_refused(MARK("nacre.pitch\0float\0\x04\0\0\0"), &nothing, 4,
                         "nacre.pitch is 0 mm; it must be positive");
    expect_patch_refused(MARK("nacre.pitch\0float\0\x04\0\0\0"), &negative, 4, "nacre.pitch is -1");
    expect_patch_refused(MARK("nacre.pitch\0float\0\x04\0\0\0"), &nan, 4, "nacre.pitch is");
    expect_patch_refused(MARK("nacre.window\0int\0\x04\0\0\0"), &other_window, 4,
                         "nacre.window differs from the tiles of 9 x 9");
    expect_patch_refused(MARK("chlist\0\x37\0\0\0"), "A", 1, "channel A is none of R, G, B");
    expect_patch_refused(MARK("chlist\0\x37\0\0\0B\0"), "\0", 1, "channel B is UINT");
    expect_patch_refused(MARK("compression\0compression\0\x01\0\0\0"), "\x05", 1, "loses data");
    expect_patch_refused(MARK("compression\0compression\0\x01\0\0\0"), "\x08", 1, "loses data");
#undef MARK
}

/* Wherever it is cut off, and even by one byte: the writer above writes no tile where a reader would expect the last. */
static void scan_cut_off_anywhere_is_refused_when_opened(void)
{
    struct nacre_scan_info info = plain();
    size_t size = 0;
    info.pixel = NACRE_HALF;
    info.compress = true;
    write_scan("good.exr", &info);
    unsigned char *bytes = scratch_load("good.exr", &size);
    for (size_t length = 0; length < size; length += length < 800 ? 5 : 61) {
        scratch_store("cut.exr", bytes, length);
        expect_unopenable("cut.exr", "cut.exr: ");
    }
    scratch_store("cut.exr", bytes, size - 1);
    expect_unopenable("cut.exr", "an incomplete file: not all of its 7 x 5 responses are there");
    free(bytes);
}

/* The tile that is damaged is named; the others can still be read. Compressed pixels, or the length of those that are
 * not. */
static void expect_damage_named(bool compress, size_t skip, size_t count)
{
    struct nacre_scan_info info = plain();
    struct nacre_error error = {0};
    float *response = allocate(&info);
    size_t size = 0;
    info.compress = compress;
    write_scan("good.exr", &info);
    unsigned char *bytes = scratch_load("good.exr", &size);
    /* the leader of tile (2, 3) at level (0, 0), as it stands before its length and its pixels */
    static const int32_t leader[4] = {2, 3, 0, 0};
    size_t at = scratch_find(bytes, size, leader, sizeof leader) + sizeof leader + skip;
    memset(bytes + at, 0x01, count);
    scratch_store("bad.exr", bytes, size);
    free(bytes);
    struct nacre_scan *scan = open_scan("bad.exr");
    scratch_hush();
    int status = nacre_scan_read(scan, 2, 3, response, &error);
    scratch_hush_end();
    expect_text(status, &error,
                "bad.exr: tile (2, 3) is damaged or incomplete; make the scan "
                "again: ");
    TEST_ASSERT_EQUAL_INT(0, wrong_entries(scan, 3, 3, response));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, nacre_scan_read(scan, 2, 3, response, NULL));
    TEST_ASSERT_EQUAL_INT(0, wrong_entries(scan, 2, 2, response));
    nacre_scan_close(scan);
    free(response);
}

static void damaged_tile_is_named(void)
{
    expect_damage_named(true, 4, 40);
    expect_damage_named(false, 0, 1);
}

/* Reading ends with success or an error whatever the bytes are, and prints nothing. */
static void damaged_bytes_never_crash(void)
{
    struct nacre_scan_info info = plain();
    float *response = allocate(&info);
    size_t size = 0;
    uint32_t state = 5;
    int refused = 0;
    info.pixel = NACRE_HALF;
    info.compress = true;
    write_scan("good.exr", &info);
    unsigned char *bytes = scratch_load("good.exr", &size);
    scratch_hush();
    for (int i = 0; i < 1500; i++) {
        struct nacre_scan *scan = NULL;
        state = state * 1664525u + 1013904223u;
        size_t at = (state >> 8) % (i % 3 ? 900 : size);
        unsigned char before = bytes[at];
        bytes[at] ^= (unsigned char)(1u << (state >> 5) % 8);
        scratch_store("bad.exr", bytes, size);
        int status = nacre_scan_open(scratch_path("bad.exr"), &scan, NULL);
        if (status == NACRE_OK) {
            const struct nacre_scan_info *got = nacre_scan_info(scan);
            float *entries = allocate(got);
            for (int p = 0; p < got->width * got->height && p < 100; p++) {
                status |= nacre_scan_read(scan, p % got->width, p / got->width, entries, NULL);
            }
            free(entries);
        }
        refused += status != NACRE_OK;
        nacre_scan_close(scan);
        bytes[at] = before;
    }
    scratch_hush_end();
    TEST_ASSERT_TRUE(refused > 300);
    free(bytes);
    free(response);
}

static void full_disk_leaves_the_old_scan_alone(void)
{
    struct nacre_scan_info info = plain();
    struct nacre_error error = {0};
    scratch_store("a.exr", "old", 3);
    for (size_t limit = 100; limit < 30000; limit += 13000) { /* in the header, among tiles */
        struct nacre_scan_writer *writer = NULL;
        info.compress = limit < 1000;
        scratch_hush();
        scratch_limit_files(limit);
        int status = nacre_scan_create(scratch_path("a.exr"), &info, &writer, &error);
        if (status == NACRE_OK) {
            status = nacre_scan_commit(writer, &error);
        }
        scratch_limit_files(0);
        scratch_hush_end();
        expect_text(status, &error, "File too large");
        TEST_ASSERT_EQUAL_INT(1, scratch_count());
    }
    size_t size = 0;
    free(scratch_load("a.exr", &size));
    TEST_ASSERT_EQUAL_UINT64(3, size);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(scan_comes_back_in_every_pixel_type);
    RUN_TEST(awkward_sizes_come_back);
    RUN_TEST(float_keeps_every_bit_and_half_the_nearest);
    RUN_TEST(nan_is_kept_and_points_never_written_are_nan);
    RUN_TEST(bytes_do_not_depend_on_threads);
    RUN_TEST(several_threads_read_one_scan);
    RUN_TEST(scan_is_seen_only_when_committed);
    RUN_TEST(points_outside_or_twice_are_refused);
    RUN_TEST(scans_that_cannot_be_are_not_created);
    RUN_TEST(files_that_are_no_scan_are_refused);
    RUN_TEST(headers_that_are_no_scan_are_refused);
    RUN_TEST(scan_cut_off_anywhere_is_refused_when_opened);
    RUN_TEST(damaged_tile_is_named);
    RUN_TEST(damaged_bytes_never_crash);
    RUN_TEST(full_disk_leaves_the_old_scan_alone);
    return UNITY_END();
}
