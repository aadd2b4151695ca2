/* Writing material.exr. */
#include "channel.h"
#include "half_float.h"
#include "material_attributes.h"
#include "material_check.h"
#include "material_levels.h"
#include "nacre/exr_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* As many values as viewers need. */
enum { ALBEDO_BITS = 6 };

/* Add one plane with a copy of the values. */
static int add_plane(struct exr_part *part, const char *name, enum nacre_pixel pixel,
                     const void *values)
{
    struct exr_plane *plane = part ? exr_part_add_plane(part, name, pixel) : NULL;
    if (!plane) {
        return NACRE_FAILED;
    }
    memcpy(plane->values, values, (size_t)part->width * (size_t)part->height * sizeof(float));
    return NACRE_OK;
}

/* A part of `channels` colour planes [channels][height][width]. */
static int add_colours(struct exr_file *file, const char *name,
                       const struct nacre_material *material, enum nacre_pixel pixel,
                       const float *values)
{
    struct exr_part *part = exr_file_add_part(file, name, material->width, material->height);
    size_t size = (size_t)material->width * (size_t)material->height;
    int status = part ? NACRE_OK : NACRE_FAILED;
    for (int c = 0; c < material->channels && status == NACRE_OK; c++) {
        status =
            add_plane(part, channel_name(material->channels, c), pixel, values + (size_t)c * size);
    }
    return status;
}

static int add_factor(struct exr_file *file, const char *name,
                      const struct nacre_material *material, const float *values)
{
    struct exr_part *part = exr_file_add_part(file, name, material->width, material->height);
    size_t size = (size_t)material->width * (size_t)material->height;
    int status = part ? NACRE_OK : NACRE_FAILED;
    for (int t = 0; t < material->terms; t++) {
        for (int c = 0; c < material->factor_channels && status == NACRE_OK; c++) {
            char channel[32];
            (void)snprintf(channel, sizeof channel, "t%02d.%s", t,
                           channel_name(material->factor_channels, c));
            status = add_plane(part, channel, material->pixel, values);
            values += size;
        }
    }
    return status;
}

/* Kernels stand below each other in one plane a channel. */
static int add_kernels(struct exr_file *file, const struct nacre_material *material)
{
    int count = nacre_material_kernel_count(material);
    int window = material->window;
    size_t size = (size_t)window * (size_t)window;
    struct exr_part *part = exr_file_add_part(file, "kernel", window, window * count);
    for (int c = 0; c < material->channels; c++) {
        struct exr_plane *plane =
            part ? exr_part_add_plane(part, channel_name(material->channels, c), NACRE_FLOAT)
                 : NULL;
        if (!plane) {
            return NACRE_FAILED;
        }
        for (int j = 0; j < count; j++) {
            memcpy(plane->values + (size_t)j * size,
                   material->kernels + ((size_t)j * (size_t)material->channels + (size_t)c) * size,
                   size * sizeof(float));
        }
    }
    return part ? NACRE_OK : NACRE_FAILED;
}

static int add_clusters(struct exr_file *file, const struct nacre_material *material)
{
    struct exr_part *part = exr_file_add_part(file, "cluster", material->width, material->height);
    size_t size = (size_t)material->width * (size_t)material->height;
    int status = part ? NACRE_OK : NACRE_FAILED;
    for (int m = 0; m < material->mixed && status == NACRE_OK; m++) {
        char name[32];
        (void)snprintf(name, sizeof name, "id%d", m);
        status = add_plane(part, name, NACRE_UINT, material->ids + (size_t)m * size);
        (void)snprintf(name, sizeof name, "w%d", m);
        if (status == NACRE_OK) {
            status = add_plane(part, name, NACRE_FLOAT, material->weights + (size_t)m * size);
        }
    }
    return status;
}

/* Radial kernels are stored as one row each. */
static int add_profiles(struct exr_file *file, const struct nacre_material *material)
{
    int count = nacre_material_kernel_count(material);
    size_t radii = (size_t)material->radii, channels = (size_t)material->channels;
    struct exr_part *part = exr_file_add_part(file, "kernel", material->radii, count);
    for (size_t c = 0; c < channels; c++) {
        struct exr_plane *plane =
            part ? exr_part_add_plane(part, channel_name(material->channels, (int)c), NACRE_FLOAT)
                 : NULL;
        if (!plane) {
            return NACRE_FAILED;
        }
        for (size_t j = 0; j < (size_t)count; j++) {
            memcpy(plane->values + j * radii, material->profiles + (j * channels + c) * radii,
                   radii * sizeof *plane->values);
        }
    }
    return NACRE_OK;
}

/* U of F = gain U and H = U / gain, and the gain. */
static int add_gained(struct exr_file *file, const struct nacre_material *material)
{
    size_t count = (size_t)material->terms * (size_t)material->factor_channels *
                   (size_t)material->width * (size_t)material->height;
    float *planes = malloc(count * sizeof *planes);
    int status = planes ? NACRE_OK : NACRE_FAILED;
    for (size_t i = 0; planes && i < count; i++) {
        planes[i] = (float)sqrt((double)material->f[i] * (double)material->h[i]);
    }
    if (status == NACRE_OK) {
        half_round(planes, count); /* as they were before the gain */
        status = add_factor(file, "F", material, planes);
    }
    free(planes);
    struct exr_part *part = status == NACRE_OK
                                ? exr_file_add_part(file, "gain", material->width, material->height)
                                : NULL;
    return part ? add_plane(part, "Y", NACRE_HALF, material->gain) : NACRE_FAILED;
}

/* Quantised planes become numbers of their values, where each part has as few as it should. */
static int number_planes(struct exr_file *file, const struct nacre_material *material,
                         bool *numbered, struct nacre_error *error)
{
    static const char *const names[] = {"albedo", "F", "H", "centre"};
    int status = NACRE_OK;
    for (size_t i = 0; i < sizeof names / sizeof *names && status == NACRE_OK; i++) {
        struct exr_part *part = exr_file_find_part(file, names[i]);
        bool done = false;
        /* Albedo and centre are single numbers of a point and not sums of terms; albedo may be coarser, for viewers. */
        bool factor = names[i][1] == '\0';
        int bits = factor || material->bits > 8 ? material->bits : 8;
        if (part && i == 0) {
            status = levels_number(part, ALBEDO_BITS, &done, error);
        }
        if (part && !done && status == NACRE_OK) {
            status = levels_number(part, bits, &done, error);
        }
        *numbered = *numbered || done;
    }
    return status;
}

static int check(const char *path, const struct nacre_material *material, struct nacre_error *error)
{
    if (material_check_sizes(material, error) != NACRE_OK ||
        material_check_values(material, error) != NACRE_OK) {
        return nacre_fail_within(error, "%s: cannot write", path);
    }
    if (!(material->pitch_mm > 0) || !isfinite(material->pitch_mm)) {
        return nacre_fail(error, "%s: cannot write: the pitch is %g mm; it must be positive", path,
                          material->pitch_mm);
    }
    return NACRE_OK;
}

int nacre_material_write(const char *path, const struct nacre_material *material,
                         struct nacre_error *error)
{
    struct exr_file file = {0};
    bool numbered = false;
    int status = check(path, material, error);
    if (status != NACRE_OK) {
        return status;
    }
    status = add_colours(&file, "albedo", material,
                         material->bits > 0 ? material->pixel : NACRE_FLOAT, material->albedo);
    if (status == NACRE_OK) {
        status = material->gain ? add_gained(&file, material)
                                : add_factor(&file, "F", material, material->f);
    }
    if (status == NACRE_OK && material->h && !material->gain) {
        status = add_factor(&file, "H", material, material->h);
    }
    if (status == NACRE_OK) {
        status = material->radii > 0 ? add_profiles(&file, material) : add_kernels(&file, material);
    }
    if (status == NACRE_OK && material->mixed > 0) {
        status = add_clusters(&file, material);
    }
    if (status == NACRE_OK && material->centre) {
        status = add_colours(&file, "centre", material, material->pixel, material->centre);
    }
    if (status == NACRE_OK && material->bits > 0) {
        status = number_planes(&file, material, &numbered, error);
    }
    if (status == NACRE_OK) {
        status = material_add_attributes(&file.parts[0], numbered, material);
    }
    if (status != NACRE_OK) {
        status = nacre_fail_memory(error, path);
    } else {
        status = exr_file_write(path, &file, EXR_ZIP, error);
    }
    exr_file_finish(&file);
    return status;
}
