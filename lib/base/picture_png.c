/* Pictures from and to PNG, whose values are sRGB. */
#include "base/picture_png.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <png.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* What libpng's longjmp must find again. */
struct png_task {
    const char *name;
    struct nacre_error *error;
    jmp_buf failed;
    FILE *file;
    png_structp png;
    png_infop info;
    unsigned char *bytes; /* the whole image, row by row */
    png_bytep *rows;
    float *linear; /* the linear value of each stored one */
};

static void note_failure(png_structp png, png_const_charp message)
{
    struct png_task *task = png_get_error_ptr(png);
    (void)nacre_fail(task->error, "%s: PNG: %s", task->name, message);
    longjmp(task->failed, 1); /* NOLINT(cert-err52-cpp): libpng has no other way */
}

static void ignore_warning(png_structp png, png_const_charp message)
{
    (void)png;
    (void)message; /* a stray chunk is no reason to stop or to print */
}

/* The values that a PNG with this gAMA stands for; 0: it has none. Nearly everything that says 0.45455 means sRGB. */
static void fill_linear(float *linear, size_t count, double gamma)
{
    bool is_srgb = gamma <= 0 || fabs(gamma - 0.45455) < 0.005;
    for (size_t i = 0; i < count; i++) {
        double value = (double)i / (double)(count - 1);
        double from_srgb = value <= 0.04045 ? value / 12.92 : pow((value + 0.055) / 1.055, 2.4);
        linear[i] = (float)(is_srgb ? from_srgb : pow(value, 1 / gamma));
    }
}

/* 0..255 of a linear value. */
static unsigned char encode_srgb(float linear)
{
    double value = linear < 0 ? 0 : linear > 1 ? 1 : (double)linear;
    value = value <= 0.0031308 ? 12.92 * value : 1.055 * pow(value, 1 / 2.4) - 0.055;
    return (unsigned char)(255 * value + 0.5);
}

/* Have libpng turn every kind of PNG into R G B A of 8 or 16 bits. Returns the bytes a sample takes. */
static size_t choose_conversions(struct png_task *task)
{
    png_set_expand(task->png);
    png_set_gray_to_rgb(task->png);
    bool wide = png_get_bit_depth(task->png, task->info) == 16;
    png_set_add_alpha(task->png, wide ? 0xffff : 0xff, PNG_FILLER_AFTER);
    (void)png_set_interlace_handling(task->png);
    png_read_update_info(task->png, task->info);
    return wide ? 2 : 1;
}

/* deflate cannot shrink anything by more than 1032, so a larger image is not in the file. */
static void check_size(struct png_task *task, size_t row_bytes, size_t height)
{
    struct stat status;
    int channels = 4; /* an image of one grey bit a pixel grows by 32 when expanded to R G B A */
    if (fstat(fileno(task->file), &status) == 0 &&
        (double)row_bytes * (double)height > ((double)status.st_size + 64) * 1032 * 8 * channels) {
        png_error(task->png, "truncated");
    }
}

static void copy_pixels(const struct png_task *task, size_t sample_bytes, struct picture *picture)
{
    size_t width = (size_t)picture->width;
    float most = sample_bytes == 2 ? 65535.0F : 255.0F;
    for (size_t y = 0; y < (size_t)picture->height; y++) {
        for (size_t x = 0; x < width; x++) {
            size_t sample[4];
            for (size_t c = 0; c < 4; c++) {
                const unsigned char *byte = task->rows[y] + (4 * x + c) * sample_bytes;
                sample[c] = sample_bytes == 2 ? (size_t)byte[0] << 8 | byte[1] : byte[0];
            }
            for (size_t c = 0; c < 3; c++) {
                picture->rgb[3 * (y * width + x) + c] =
                    task->linear[sample[c]] * ((float)sample[3] / most);
            }
        }
    }
}

/* Everything between creating and destroying the reader; libpng's errors jump out of it. */
static int read_image(struct png_task *task, struct picture *picture)
{
    double gamma = 0;
    int intent = 0;
    if (setjmp(task->failed)) { /* NOLINT(cert-err52-cpp) */
        return NACRE_FAILED;
    }
    png_init_io(task->png, task->file);
    png_read_info(task->png, task->info);
    if (!png_get_gAMA(task->png, task->info, &gamma) ||
        png_get_sRGB(task->png, task->info, &intent)) {
        gamma = 0;
    }
    size_t sample_bytes = choose_conversions(task);
    size_t height = png_get_image_height(task->png, task->info);
    size_t row_bytes = png_get_rowbytes(task->png, task->info);
    check_size(task, row_bytes, height);
    if (picture_allocate(picture, (int)png_get_image_width(task->png, task->info), (int)height,
                         task->error) != NACRE_OK) {
        return nacre_fail_within(task->error, "%s", task->name);
    }
    task->bytes = calloc(height, row_bytes);
    task->rows = calloc(height, sizeof *task->rows);
    task->linear = calloc((size_t)1 << 8 * sample_bytes, sizeof *task->linear);
    if (!task->bytes || !task->rows || !task->linear) {
        return nacre_fail_memory(task->error, task->name);
    }
    for (size_t y = 0; y < height; y++) {
        task->rows[y] = task->bytes + y * row_bytes;
    }
    png_read_image(task->png, task->rows);
    png_read_end(task->png, NULL);
    fill_linear(task->linear, (size_t)1 << 8 * sample_bytes, gamma);
    copy_pixels(task, sample_bytes, picture);
    return NACRE_OK;
}

static void free_buffers(struct png_task *task)
{
    free(task->bytes);
    free(task->rows);
    free(task->linear);
}

/* A pipe would be waited for. */
static int open_plain(struct png_task *task, const char *path)
{
    struct stat status;
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file >= 0 && fstat(file, &status) == 0 && !S_ISREG(status.st_mode)) {
        (void)close(file);
        return nacre_fail(task->error, "%s: cannot be read: not a plain file", path);
    }
    task->file = file >= 0 ? fdopen(file, "r") : NULL;
    if (!task->file) {
        int number = errno;
        if (file >= 0) {
            (void)close(file);
        }
        return nacre_fail_errno(task->error, number, "%s: cannot be read", path);
    }
    return NACRE_OK;
}

int picture_read_png(const char *path, struct picture *picture, struct nacre_error *error)
{
    struct png_task task = {.name = path, .error = error};
    int result = NACRE_FAILED;
    *picture = (struct picture){0};
    if (open_plain(&task, path) != NACRE_OK) {
        return NACRE_FAILED;
    }
    task.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &task, note_failure, ignore_warning);
    task.info = task.png ? png_create_info_struct(task.png) : NULL;
    if (task.info) {
        result = read_image(&task, picture);
    } else {
        (void)nacre_fail_memory(error, path);
    }
    if (result != NACRE_OK) {
        picture_finish(picture);
    }
    png_destroy_read_struct(&task.png, &task.info, NULL);
    free_buffers(&task);
    (void)fclose(task.file);
    return result;
}

static void write_bytes(png_structp png, png_bytep bytes, png_size_t size)
{
    struct png_task *task = png_get_io_ptr(png);
    if (fwrite(bytes, 1, size, task->file) != size) {
        png_error(png, "out of memory");
    }
}

static void flush_bytes(png_structp png)
{
    (void)png; /* the stream is in memory */
}

static void encode_row(const struct picture *picture, size_t y, unsigned char *row)
{
    static const unsigned char magenta[3] = {255, 0, 255};
    for (size_t x = 0; x < (size_t)picture->width; x++) {
        const float *pixel = picture->rgb + 3 * (y * (size_t)picture->width + x);
        bool is_nan = isnan(pixel[0]) || isnan(pixel[1]) || isnan(pixel[2]);
        for (size_t c = 0; c < 3; c++) {
            row[3 * x + c] = is_nan ? magenta[c] : encode_srgb(pixel[c]);
        }
    }
}

/* tEXt, or where there is more than ASCII iTXt, which is UTF-8. */
static void write_text(struct png_task *task, const char *attribute)
{
    char key[80];
    const char *equals = strchr(attribute, '=');
    const char *value = equals ? equals + 1 : "";
    (void)snprintf(key, sizeof key, "nacre.%.*s", equals ? (int)(equals - attribute) : 0,
                   attribute);
    char *text = strdup(value);
    if (!text) {
        png_error(task->png, "out of memory");
    }
    bool ascii = true;
    for (const char *c = text; *c; c++) {
        ascii = ascii && (unsigned char)*c < 0x80;
    }
    png_text chunk = {.compression = ascii ? PNG_TEXT_COMPRESSION_NONE : PNG_ITXT_COMPRESSION_NONE,
                      .key = key,
                      .text = text};
    png_set_text(task->png, task->info, &chunk, 1); /* keeps a copy */
    free(text);
}

static int write_image(struct png_task *task, const struct picture *picture,
                       const char *const *attributes)
{
    if (setjmp(task->failed)) { /* NOLINT(cert-err52-cpp) */
        return NACRE_FAILED;
    }
    png_set_write_fn(task->png, task, write_bytes, flush_bytes);
    png_set_IHDR(task->png, task->info, (png_uint_32)picture->width, (png_uint_32)picture->height,
                 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_set_sRGB(task->png, task->info, PNG_sRGB_INTENT_PERCEPTUAL);
    for (size_t i = 0; attributes && attributes[i]; i++) {
        write_text(task, attributes[i]);
    }
    png_write_info(task->png, task->info);
    for (size_t y = 0; y < (size_t)picture->height; y++) {
        encode_row(picture, y, task->bytes);
        png_write_row(task->png, task->bytes);
    }
    png_write_end(task->png, NULL);
    return NACRE_OK;
}

int picture_encode_png_text(const struct picture *picture, const char *const *attributes,
                            unsigned char **bytes, size_t *size, struct nacre_error *error)
{
    struct png_task task = {.name = "a picture", .error = error};
    char *stream = NULL;
    int result = NACRE_FAILED;
    *bytes = NULL;
    *size = 0;
    task.file = open_memstream(&stream, size);
    task.bytes = calloc((size_t)picture->width, 3);
    task.png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &task, note_failure, ignore_warning);
    task.info = task.png ? png_create_info_struct(task.png) : NULL;
    if (task.file && task.bytes && task.info) {
        result = write_image(&task, picture, attributes);
    } else {
        (void)nacre_fail_memory(error, task.name);
    }
    png_destroy_write_struct(&task.png, &task.info);
    free_buffers(&task);
    if (task.file && fclose(task.file) != 0 && result == NACRE_OK) {
        result = nacre_fail_memory(error, task.name);
    }
    if (result == NACRE_OK) {
        *bytes = (unsigned char *)stream;
    } else {
        free(stream);
        *size = 0;
    }
    return result;
}

int picture_encode_png(const struct picture *picture, unsigned char **bytes, size_t *size,
                       struct nacre_error *error)
{
    return picture_encode_png_text(picture, NULL, bytes, size, error);
}
