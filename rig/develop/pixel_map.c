/* The map of a camera's pixels that cannot be trusted, in memory and as a file that other sessions can use. */
#include "rig/develop/pixel_map.h"

#include "nacre/exr_file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *const pixel_class_names[] = {"good", "dead", "hot", "nonlinear", "noisy", NULL};

int pixel_map_init(struct pixel_map *map, int width, int height, enum bayer bayer,
                   struct nacre_error *error)
{
    size_t pixels = (size_t)width * (size_t)height;
    *map = (struct pixel_map){.width = width,
                              .height = height,
                              .bayer = bayer,
                              .classes = calloc(pixels, sizeof *map->classes),
                              .slope = malloc(pixels * sizeof *map->slope),
                              .offset = malloc(pixels * sizeof *map->offset),
                              .dark = malloc(pixels * sizeof *map->dark)};
    if (!map->classes || !map->slope || !map->offset || !map->dark) {
        pixel_map_finish(map);
        return nacre_fail_memory(error, "the map of pixels");
    }
    for (size_t i = 0; i < pixels; i++) {
        map->slope[i] = map->offset[i] = map->dark[i] = NAN;
    }
    return NACRE_OK;
}

void pixel_map_finish(struct pixel_map *map)
{
    if (map) {
        free(map->classes);
        free(map->slope);
        free(map->offset);
        free(map->dark);
        *map = (struct pixel_map){0};
    }
}

size_t pixel_map_count(const struct pixel_map *map, enum pixel_class which)
{
    size_t count = 0;
    for (size_t i = 0; i < (size_t)map->width * (size_t)map->height; i++) {
        count += map->classes[i] == which ? 1 : 0;
    }
    return count;
}

static int add_values(struct exr_part *part, const char *name, const float *values, size_t pixels)
{
    struct exr_plane *plane = exr_part_add_plane(part, name, NACRE_FLOAT);
    if (!plane) {
        return NACRE_FAILED;
    }
    memcpy(plane->values, values, pixels * sizeof *values);
    return NACRE_OK;
}

static int fill_part(const struct pixel_map *map, struct exr_part *part)
{
    size_t pixels = (size_t)map->width * (size_t)map->height;
    struct exr_plane *plane = exr_part_add_plane(part, "class", NACRE_UINT);
    for (size_t i = 0; plane && i < pixels; i++) {
        plane->integers[i] = map->classes[i];
    }
    if (!plane || add_values(part, "slope", map->slope, pixels) != NACRE_OK ||
        add_values(part, "offset", map->offset, pixels) != NACRE_OK ||
        add_values(part, "dark", map->dark, pixels) != NACRE_OK ||
        exr_part_add_string(part, "nacre.format", "pixels 1") != NACRE_OK ||
        exr_part_add_string(part, "nacre.bayer", bayer_names[map->bayer]) != NACRE_OK) {
        return NACRE_FAILED;
    }
    return exr_part_add_strings(part, "nacre.classes", pixel_class_names, PIXEL_CLASSES);
}

int pixel_map_write(const struct pixel_map *map, const char *path, struct nacre_error *error)
{
    struct exr_file file = {0};
    struct exr_part *part = exr_file_add_part(&file, "", map->width, map->height);
    int status =
        part && fill_part(map, part) == NACRE_OK ? NACRE_OK : nacre_fail_memory(error, path);
    if (status == NACRE_OK) {
        status = exr_file_write(path, &file, EXR_ZIP, error);
    }
    exr_file_finish(&file);
    return status;
}

static int check_part(const struct pixel_map *map, const char *path, const struct exr_part *part,
                      struct nacre_error *error)
{
    const struct exr_attribute *format = exr_part_find(part, "nacre.format", EXR_STRING);
    const struct exr_attribute *bayer = exr_part_find(part, "nacre.bayer", EXR_STRING);
    if (!format || strcmp(format->string, "pixels 1") != 0) {
        return nacre_fail(error,
                          "%s: is no map of pixels (nacre.format is not \"pixels 1\"); make one "
                          "with nacre develop --pixels",
                          path);
    }
    if (part->width != map->width || part->height != map->height) {
        return nacre_fail(error, "%s: is %d x %d where the station's frames are %d x %d", path,
                          part->width, part->height, map->width, map->height);
    }
    if (!bayer || strcmp(bayer->string, bayer_names[map->bayer]) != 0) {
        return nacre_fail(error, "%s: has Bayer order %s where the station's camera has %s", path,
                          bayer ? bayer->string : "none", bayer_names[map->bayer]);
    }
    return NACRE_OK;
}

int pixel_map_add_known(struct pixel_map *map, const char *path, struct nacre_error *error)
{
    struct exr_file file = {0};
    size_t pixels = (size_t)map->width * (size_t)map->height;
    int status = exr_file_read(path, &file, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = check_part(map, path, &file.parts[0], error);
    if (status != NACRE_OK) {
        goto out;
    }
    const struct exr_plane *plane = exr_part_find_plane(&file.parts[0], "class");
    if (!plane || plane->pixel != NACRE_UINT) {
        status = nacre_fail(error, "%s: lacks the channel class of whole numbers", path);
        goto out;
    }
    for (size_t i = 0; i < pixels; i++) {
        if (plane->integers[i] >= PIXEL_CLASSES) {
            status = nacre_fail(error, "%s: pixel (%zu, %zu) is of class %u; there are 0 to %d",
                                path, i % (size_t)map->width, i / (size_t)map->width,
                                plane->integers[i], PIXEL_CLASSES - 1);
            goto out;
        }
    }
    for (size_t i = 0; i < pixels; i++) {
        map->classes[i] =
            map->classes[i] == PIXEL_GOOD ? (uint8_t)plane->integers[i] : map->classes[i];
    }
out:
    exr_file_finish(&file);
    return status;
}
