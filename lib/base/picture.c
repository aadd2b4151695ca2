/* Pictures in memory and as OpenEXR files, and the choice of format by the file's name. */
#include "base/picture.h"

#include "base/picture_png.h"
#include "nacre/exr_file.h"
#include "nacre/whole_file.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { LARGEST_SIDE = 1 << 16, LARGEST_AREA = 1 << 28 };

int picture_allocate(struct picture *picture, int width, int height, struct nacre_error *error)
{
    *picture = (struct picture){0};
    if (width < 1 || height < 1 || width > LARGEST_SIDE || height > LARGEST_SIDE ||
        (size_t)width * (size_t)height > LARGEST_AREA) {
        return nacre_fail(error, "a picture of %d x %d pixels: 1 x 1 to %d million are handled",
                          width, height, LARGEST_AREA / 1000000);
    }
    picture->rgb = calloc((size_t)width * (size_t)height, 3 * sizeof *picture->rgb);
    if (!picture->rgb) {
        return nacre_fail_memory(error, "a picture");
    }
    picture->width = width;
    picture->height = height;
    return NACRE_OK;
}

void picture_finish(struct picture *picture)
{
    free(picture->rgb);
    *picture = (struct picture){0};
}

enum format { FORMAT_NONE, FORMAT_EXR, FORMAT_PNG };

static enum format format_of(const char *path, struct nacre_error *error)
{
    const char *slash = strrchr(path, '/');
    const char *dot = strrchr(slash ? slash : path, '.');
    if (dot && strcasecmp(dot, ".exr") == 0) {
        return FORMAT_EXR;
    }
    if (dot && strcasecmp(dot, ".png") == 0) {
        return FORMAT_PNG;
    }
    (void)nacre_fail(error, "%s: pictures are .exr or .png by the ending of their name", path);
    return FORMAT_NONE;
}

/* Copy a colour's plane, or the only one, into the picture. */
static int copy_plane(const char *path, const struct exr_part *part, int channel,
                      struct picture *picture, struct nacre_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    const struct exr_plane *plane = exr_part_find_plane(part, names[channel]);
    if (!plane) {
        plane = exr_part_find_plane(part, "Y");
    }
    if (!plane) {
        return nacre_fail(error, "%s: no channel %s: a picture has R, G and B, or Y", path,
                          names[channel]);
    }
    if (plane->pixel == NACRE_UINT) {
        return nacre_fail(error, "%s: channel %s holds integers: a picture is HALF or FLOAT", path,
                          plane->name);
    }
    size_t count = (size_t)part->width * (size_t)part->height;
    for (size_t i = 0; i < count; i++) {
        picture->rgb[3 * i + (size_t)channel] = plane->values[i];
    }
    return NACRE_OK;
}

static int read_exr(const char *path, struct picture *picture, struct nacre_error *error)
{
    struct exr_file file = {0};
    int result = exr_file_read(path, &file, error);
    if (result != NACRE_OK) {
        return result;
    }
    const struct exr_part *part = &file.parts[0];
    result = picture_allocate(picture, part->width, part->height, error);
    for (int channel = 0; channel < 3 && result == NACRE_OK; channel++) {
        result = copy_plane(path, part, channel, picture, error);
    }
    if (result != NACRE_OK) {
        picture_finish(picture);
    }
    exr_file_finish(&file);
    return result;
}

int picture_read(const char *path, struct picture *picture, struct nacre_error *error)
{
    *picture = (struct picture){0};
    switch (format_of(path, error)) {
    case FORMAT_EXR:
        return read_exr(path, picture, error);
    case FORMAT_PNG:
        return picture_read_png(path, picture, error);
    case FORMAT_NONE:
        break;
    }
    return NACRE_FAILED;
}

/* "scene=dragon.yaml" as the string attribute nacre.scene. */
static int add_attribute(struct exr_part *part, const char *attribute, struct nacre_error *error)
{
    char name[64];
    const char *equals = strchr(attribute, '=');
    int length = equals ? (int)(equals - attribute) : 0;
    if (length < 1 || snprintf(name, sizeof name, "nacre.%.*s", length, attribute) >= 64) {
        return nacre_fail(error, "'%s' is not KEY=VALUE with a short key", attribute);
    }
    return exr_part_add_string(part, name, equals + 1) == NACRE_OK
               ? NACRE_OK
               : nacre_fail_memory(error, "an attribute");
}

/* HALF ends at 65504: a brighter highlight needs FLOAT. */
static enum nacre_pixel pixel_for(const struct picture *picture)
{
    size_t count = (size_t)picture->width * (size_t)picture->height * 3;
    for (size_t i = 0; i < count; i++) {
        if (isfinite(picture->rgb[i]) && fabsf(picture->rgb[i]) > 65504.0F) {
            return NACRE_FLOAT;
        }
    }
    return NACRE_HALF;
}

static int add_plane(struct exr_part *part, const char *name, const struct picture *picture,
                     size_t channel, enum nacre_pixel pixel, struct nacre_error *error)
{
    struct exr_plane *plane = exr_part_add_plane(part, name, pixel);
    if (!plane) {
        return nacre_fail_memory(error, "a picture");
    }
    size_t count = (size_t)picture->width * (size_t)picture->height;
    for (size_t i = 0; i < count; i++) {
        plane->values[i] = picture->rgb[3 * i + channel];
    }
    return NACRE_OK;
}

static int write_exr(const char *path, const struct picture *picture, const char *const *attributes,
                     struct nacre_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    struct exr_file file = {0};
    int result = NACRE_OK;
    enum nacre_pixel pixel = pixel_for(picture);
    struct exr_part *part = exr_file_add_part(&file, "", picture->width, picture->height);
    if (!part) {
        result = nacre_fail_memory(error, path);
    }
    for (size_t channel = 0; channel < 3 && result == NACRE_OK; channel++) {
        result = add_plane(part, names[channel], picture, channel, pixel, error);
    }
    for (; attributes && *attributes && result == NACRE_OK; attributes++) {
        result = add_attribute(part, *attributes, error);
    }
    if (result == NACRE_OK) {
        result = exr_file_write(path, &file, EXR_ZIP, error);
    }
    exr_file_finish(&file);
    return result;
}

static int write_png(const char *path, const struct picture *picture, const char *const *attributes,
                     struct nacre_error *error)
{
    unsigned char *bytes = NULL;
    size_t size = 0;
    if (picture_encode_png_text(picture, attributes, &bytes, &size, error) != NACRE_OK) {
        return nacre_fail_within(error, "%s", path);
    }
    int result = whole_file_write(path, bytes, size, error);
    free(bytes);
    return result;
}

int picture_write(const char *path, const struct picture *picture, const char *const *attributes,
                  struct nacre_error *error)
{
    switch (format_of(path, error)) {
    case FORMAT_EXR:
        return write_exr(path, picture, attributes, error);
    case FORMAT_PNG:
        return write_png(path, picture, attributes, error);
    case FORMAT_NONE:
        break;
    }
    return NACRE_FAILED;
}
