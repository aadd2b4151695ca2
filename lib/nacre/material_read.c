/* Reading material.exr. */
#include "channel.h"
#include "material_attributes.h"
#include "material_check.h"
#include "material_levels.h"
#include "nacre/exr_file.h"

#include <ctype.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A part that must be there, with its size. */
static int find_part(const struct exr_file *file, const char *name, int width, int height,
                     const struct exr_part **part, struct nacre_error *error)
{
    *part = exr_file_find_part(file, name);
    if (!*part) {
        (void)nacre_fail(error, "part %s is missing", name);
        return NACRE_FAILED;
    }
    if ((*part)->width != width || (*part)->height != height) {
        return nacre_fail(error, "part %s is %d x %d pixels; it must be %d x %d", name,
                          (*part)->width, (*part)->height, width, height);
    }
    return NACRE_OK;
}

static int find_plane(const struct exr_part *part, const char *name, bool integers,
                      const struct exr_plane **plane, struct nacre_error *error)
{
    *plane = exr_part_find_plane(part, name);
    if (!*plane) {
        return nacre_fail(error, "part %s: channel %s is missing", part->name, name);
    }
    if (((*plane)->pixel == NACRE_UINT) != integers) {
        return nacre_fail(error, "part %s: channel %s must be %s", part->name, name,
                          integers ? "UINT" : "HALF or FLOAT");
    }
    return NACRE_OK;
}

/* Channels that no reader would look at are a sign of a wrong file. */
static int check_count(const struct exr_part *part, size_t expected, struct nacre_error *error)
{
    if (part->plane_count != expected) {
        return nacre_fail(error, "part %s has %zu channels; it must have %zu", part->name,
                          part->plane_count, expected);
    }
    return NACRE_OK;
}

/* Colour planes into values[channels][height][width]. */
static int read_colours(const struct exr_part *part, int channels, float *values,
                        struct nacre_error *error)
{
    size_t size = (size_t)part->width * (size_t)part->height;
    int status = check_count(part, (size_t)channels, error);
    for (int c = 0; c < channels && status == NACRE_OK; c++) {
        const struct exr_plane *plane = NULL;
        status = find_plane(part, channel_name(channels, c), false, &plane, error);
        if (status == NACRE_OK) {
            memcpy(values + (size_t)c * size, plane->values, size * sizeof *values);
        }
    }
    return status;
}

/* Take "t07.G" apart; the number is parsed, so that t7 and t007 mean the same. False for anything
 * else. */
static bool parse_factor_name(const char *name, int channels, int *term, int *channel)
{
    char *end = NULL;
    if (name[0] != 't' || !isdigit((unsigned char)name[1])) {
        return false;
    }
    long number = strtol(name + 1, &end, 10);
    if (end[0] != '.' || number > INT_MAX) {
        return false;
    }
    *term = (int)number;
    *channel = channel_find(channels, end + 1);
    return *channel >= 0;
}

/* F or H into values[terms][factor_channels][height][width]. */
static int read_factor(const struct exr_part *part, const struct nacre_material *material,
                       float *values, struct nacre_error *error)
{
    size_t size = (size_t)part->width * (size_t)part->height;
    size_t count = (size_t)material->terms * (size_t)material->factor_channels;
    int status = check_count(part, count, error);
    if (status != NACRE_OK) {
        return status;
    }
    bool *seen = calloc(count, sizeof *seen);
    if (!seen) {
        return nacre_fail_memory(error, part->name);
    }
    for (size_t i = 0; i < count && status == NACRE_OK; i++) {
        const struct exr_plane *plane = &part->planes[i];
        int term = 0;
        int channel = 0;
        if (!parse_factor_name(plane->name, material->factor_channels, &term, &channel) ||
            term >= material->terms) {
            status = nacre_fail(error, "part %s: channel %s is none of t0 to t%d with .%s",
                                part->name, plane->name, material->terms - 1,
                                material->factor_channels == 1 ? "Y" : "R, .G or .B");
            break;
        }
        size_t index = (size_t)term * (size_t)material->factor_channels + (size_t)channel;
        if (plane->pixel == NACRE_UINT) {
            status = nacre_fail(error, "part %s: channel %s must be HALF or FLOAT", part->name,
                                plane->name);
        } else if (seen[index]) {
            status =
                nacre_fail(error, "part %s: channel %s is there twice", part->name, plane->name);
        } else {
            seen[index] = true;
            memcpy(values + index * size, plane->values, size * sizeof *values);
        }
    }
    free(seen);
    return status;
}

/* Profiles of radial kernels, a row each. */
static int read_profiles(const struct exr_file *file, struct nacre_material *material,
                         struct nacre_error *error)
{
    const struct exr_part *part = NULL;
    const struct exr_attribute *radii = exr_part_find(&file->parts[0], "nacre.radii", EXR_FLOATS);
    int count = nacre_material_kernel_count(material);
    size_t row = (size_t)material->radii, channels = (size_t)material->channels;
    int status = find_part(file, "kernel", material->radii, count, &part, error);
    if (status == NACRE_OK) {
        status = check_count(part, channels, error);
    }
    memcpy(material->radius, radii->floats, row * sizeof *material->radius);
    for (size_t c = 0; c < channels && status == NACRE_OK; c++) {
        const struct exr_plane *plane = NULL;
        status = find_plane(part, channel_name(material->channels, (int)c), false, &plane, error);
        for (size_t j = 0; j < (size_t)count && status == NACRE_OK; j++) {
            memcpy(material->profiles + (j * channels + c) * row, plane->values + j * row,
                   row * sizeof *plane->values);
        }
    }
    if (status == NACRE_OK) {
        nacre_material_spread(material);
    }
    return status;
}

/* F and H of U and their gain. */
static int read_gain(const struct exr_file *file, struct nacre_material *material,
                     struct nacre_error *error)
{
    size_t size = (size_t)material->width * (size_t)material->height;
    size_t planes = (size_t)material->terms * (size_t)material->factor_channels;
    const struct exr_part *part = NULL;
    int status = find_part(file, "gain", material->width, material->height, &part, error);
    if (status != NACRE_OK) {
        return status;
    }
    material->gain = calloc(size, sizeof *material->gain);
    if (!material->gain) {
        return nacre_fail_memory(error, "the gain");
    }
    status = read_colours(part, 1, material->gain, error);
    for (size_t i = 0; i < size && status == NACRE_OK; i++) {
        if (!(material->gain[i] > 0) || !isfinite(material->gain[i])) {
            status =
                nacre_fail(error, "part gain: the value at (%zu, %zu) is %g; it must be positive",
                           i % (size_t)material->width, i / (size_t)material->width,
                           (double)material->gain[i]);
        }
    }
    for (size_t i = 0; i < planes * size && status == NACRE_OK; i++) {
        material->h[i] = material->f[i] / material->gain[i % size];
        material->f[i] *= material->gain[i % size];
    }
    return status;
}

static int read_kernels(const struct exr_file *file, struct nacre_material *material,
                        struct nacre_error *error)
{
    const struct exr_part *part = NULL;
    int count = nacre_material_kernel_count(material);
    int window = material->window;
    size_t size = (size_t)window * (size_t)window;
    if (material->radii > 0) {
        return read_profiles(file, material, error);
    }
    if (count > INT_MAX / window) {
        return nacre_fail(error, "%d kernels of %d x %d pixels cannot be in one part", count,
                          window, window);
    }
    int status = find_part(file, "kernel", window, window * count, &part, error);
    if (status == NACRE_OK) {
        status = check_count(part, (size_t)material->channels, error);
    }
    for (int c = 0; c < material->channels && status == NACRE_OK; c++) {
        const struct exr_plane *plane = NULL;
        status = find_plane(part, channel_name(material->channels, c), false, &plane, error);
        for (int j = 0; j < count && status == NACRE_OK; j++) {
            memcpy(material->kernels + ((size_t)j * (size_t)material->channels + (size_t)c) * size,
                   plane->values + (size_t)j * size, size * sizeof(float));
        }
    }
    return status;
}

static int read_clusters(const struct exr_part *part, struct nacre_material *material,
                         struct nacre_error *error)
{
    size_t size = (size_t)part->width * (size_t)part->height;
    int status = NACRE_OK;
    for (int m = 0; m < material->mixed && status == NACRE_OK; m++) {
        char name[32];
        const struct exr_plane *plane = NULL;
        (void)snprintf(name, sizeof name, "id%d", m);
        status = find_plane(part, name, true, &plane, error);
        if (status == NACRE_OK) {
            memcpy(material->ids + (size_t)m * size, plane->integers, size * sizeof(uint32_t));
            (void)snprintf(name, sizeof name, "w%d", m);
            status = find_plane(part, name, false, &plane, error);
        }
        if (status == NACRE_OK) {
            memcpy(material->weights + (size_t)m * size, plane->values, size * sizeof(float));
        }
    }
    return status;
}

/* Radii at which radial kernels are known: rising from 0. */
static int read_radii(const struct exr_part *first, struct nacre_material *material,
                      struct nacre_error *error)
{
    const struct exr_attribute *radii = exr_part_find(first, "nacre.radii", EXR_FLOATS);
    for (size_t i = 0; radii && i < radii->count; i++) {
        if (!isfinite(radii->floats[i]) || radii->floats[i] < 0 ||
            (i > 0 && radii->floats[i] <= radii->floats[i - 1])) {
            return nacre_fail(error, "nacre.radii: number %zu is %g; radii rise from 0", i,
                              (double)radii->floats[i]);
        }
    }
    if (radii && radii->count > INT_MAX) {
        return nacre_fail(error, "nacre.radii: %zu radii are too many", radii->count);
    }
    material->radii = radii ? (int)radii->count : 0;
    return NACRE_OK;
}

static bool has_floats(const struct exr_part *part)
{
    bool found = false;
    for (size_t i = 0; i < part->plane_count; i++) {
        found = found || part->planes[i].pixel == NACRE_FLOAT;
    }
    return found;
}

/* Sizes that are told by the parts themselves, so that memory is only asked for what the file
 * holds. */
static int read_sizes(const struct exr_file *file, struct nacre_material *material,
                      const struct exr_part **clusters, struct nacre_error *error)
{
    const struct exr_part *first = &file->parts[0];
    const struct exr_part *factor = NULL;
    material->width = first->width;
    material->height = first->height;
    material->channels = first->plane_count == 1 ? 1 : 3;
    int status = find_part(file, "F", material->width, material->height, &factor, error);
    if (status != NACRE_OK) {
        return status;
    }
    const char *name = factor->plane_count ? factor->planes[0].name : "";
    size_t length = strlen(name);
    bool shared = length > 2 && strcmp(name + length - 2, ".Y") == 0;
    material->factor_channels = shared ? 1 : material->channels;
    material->pixel = NACRE_HALF;
    const struct exr_part *centre = exr_file_find_part(file, "centre");
    if (has_floats(factor) || (centre && has_floats(centre))) {
        material->pixel = NACRE_FLOAT;
    }
    *clusters = exr_file_find_part(file, "cluster");
    if (material->layout == NACRE_KERNEL_PER_TERM && *clusters) {
        return nacre_fail(error, "part cluster: a material with a kernel per term has none");
    }
    if (material->layout != NACRE_KERNEL_PER_TERM) {
        status = find_part(file, "cluster", material->width, material->height, clusters, error);
        if (status == NACRE_OK && ((*clusters)->plane_count == 0 || (*clusters)->plane_count % 2)) {
            status = nacre_fail(error,
                                "part cluster has %zu channels; it must have id0, w0 and so "
                                "on in pairs",
                                (*clusters)->plane_count);
        }
        material->mixed = status == NACRE_OK ? (int)((*clusters)->plane_count / 2) : 0;
    }
    return status == NACRE_OK ? material_check_sizes(material, error) : status;
}

/* The sizes that attributes tell must be those of the parts before memory is taken for them. */
static int check_parts(const struct exr_file *file, const struct nacre_material *material,
                       struct nacre_error *error)
{
    const struct exr_part *part = exr_file_find_part(file, "F");
    size_t planes = (size_t)material->terms * (size_t)material->factor_channels;
    int columns = material->radii > 0 ? material->radii : material->window;
    int64_t rows = (int64_t)nacre_material_kernel_count(material) *
                   (material->radii > 0 ? 1 : material->window);
    int status = check_count(part, planes, error);
    if (status != NACRE_OK) {
        return status;
    }
    part = exr_file_find_part(file, "kernel");
    if (!part) {
        return nacre_fail(error, "part kernel is missing");
    }
    if (part->width != columns || part->height != rows) {
        return nacre_fail(error, "part kernel is %d x %d pixels; it must be %d x %lld", part->width,
                          part->height, columns, (long long)rows);
    }
    return NACRE_OK;
}

static int read_planes(const struct exr_file *file, struct nacre_material *material,
                       const struct exr_part *clusters, struct nacre_error *error)
{
    const struct exr_part *part = NULL;
    int width = material->width;
    int height = material->height;
    int status = read_colours(&file->parts[0], material->channels, material->albedo, error);
    if (status == NACRE_OK) {
        status = read_factor(exr_file_find_part(file, "F"), material, material->f, error);
    }
    bool gained = exr_file_find_part(file, "gain") != NULL;
    if (status == NACRE_OK && gained) {
        status = read_gain(file, material, error);
    } else if (status == NACRE_OK && material->h) {
        status = find_part(file, "H", width, height, &part, error);
        if (status == NACRE_OK) {
            status = read_factor(part, material, material->h, error);
        }
    }
    if (status == NACRE_OK) {
        status = read_kernels(file, material, error);
    }
    if (status == NACRE_OK && clusters) {
        status = read_clusters(clusters, material, error);
    }
    if (status == NACRE_OK && material->centre) {
        status = find_part(file, "centre", width, height, &part, error);
        if (status == NACRE_OK) {
            status = read_colours(part, material->channels, material->centre, error);
        }
    }
    return status == NACRE_OK ? material_check_values(material, error) : status;
}

static int read_material(const struct exr_file *file, struct nacre_material *material,
                         struct nacre_error *error)
{
    const struct exr_part *first = &file->parts[0];
    const struct exr_part *clusters = NULL;
    int status = material_read_attributes(first, material, error);
    if (status == NACRE_OK) {
        status = read_radii(first, material, error);
    }
    if (status == NACRE_OK) {
        status = read_sizes(file, material, &clusters, error);
    }
    if (status == NACRE_OK) {
        status = check_parts(file, material, error);
    }
    if (status == NACRE_OK) {
        bool with_gain = exr_file_find_part(file, "gain") != NULL;
        if (with_gain && exr_file_find_part(file, "H")) {
            return nacre_fail(error, "part gain: a material with a part H has none");
        }
        status = nacre_material_allocate(material, exr_file_find_part(file, "H") || with_gain,
                                         exr_file_find_part(file, "centre") != NULL, error);
    }
    return status == NACRE_OK ? read_planes(file, material, clusters, error) : status;
}

int nacre_material_read(const char *path, struct nacre_material *material,
                        struct nacre_error *error)
{
    struct exr_file file = {0};
    *material = (struct nacre_material){0};
    int status = exr_file_read(path, &file, error);
    for (size_t i = 0; i < file.part_count && status == NACRE_OK; i++) {
        status = levels_restore(&file.parts[i], error);
        if (status != NACRE_OK) {
            status = nacre_fail_within(error, "%s", path);
        }
    }
    if (status == NACRE_OK) {
        status = read_material(&file, material, error);
        if (status != NACRE_OK) {
            status = nacre_fail_within(error, "%s", path);
        }
    }
    exr_file_finish(&file);
    if (status != NACRE_OK) {
        nacre_material_finish(material);
    }
    return status;
}
