/* Reading and checking sample files. */
#include "rig/virtual/sample.h"

#include "rig/virtual/effects.h"
#include "rig/virtual/settings_check.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The index of the material of that name; material_count where there is none. */
static size_t find_material(const struct sample *sample, const char *name)
{
    size_t i = 0;
    while (i < sample->material_count && strcmp(sample->materials[i].name, name) != 0) {
        i++;
    }
    return i;
}

static bool is_opaque(const struct sample_material *material)
{
    for (int c = 0; c < 3; c++) {
        if (material->scattering_per_mm[c] + material->absorption_per_mm[c] < 1e-3) {
            return false;
        }
    }
    return true;
}

static int check_material(struct sample_material *material, const char *path,
                          struct nacre_error *error)
{
    bool coefficients = material->scattering_line || material->absorption_line;
    bool paths = material->albedo_line || material->mean_free_path_line;
    if (coefficients == paths || (coefficients && !material->scattering_line) ||
        (coefficients && !material->absorption_line) || (paths && !material->albedo_line) ||
        (paths && !material->mean_free_path_line)) {
        return nacre_fail(error,
                          "%s:%d: material '%s' needs either scattering_per_mm and "
                          "absorption_per_mm or albedo and mean_free_path_mm",
                          path, material->line, material->name);
    }
    for (int c = 0; c < 3; c++) {
        if (paths) {
            double extinction = 1 / material->mean_free_path_mm[c];
            material->scattering_per_mm[c] = material->albedo[c] * extinction;
            material->absorption_per_mm[c] = (1 - material->albedo[c]) * extinction;
        }
    }
    if (!is_opaque(material)) {
        return nacre_fail(error,
                          "%s:%d: material '%s' is clear: scattering and absorption "
                          "together must reach 0.001 per mm in every channel",
                          path, material->line, material->name);
    }
    return NACRE_OK;
}

static int read_map(struct sample_map *map, const char *path, struct nacre_error *error)
{
    struct nacre_error cause = {0};
    if (picture_read(map->image, &map->picture, &cause)) {
        return nacre_fail(error, "%s:%d: %s", path, map->image_line, cause.text);
    }
    return NACRE_OK;
}

static int count_shapes(const struct sample_inclusion *inclusion)
{
    return !!inclusion->vein.line + !!inclusion->bands.line + !!inclusion->checker.line +
           !!inclusion->cells.line + !!inclusion->clouds.line + !!inclusion->map.line;
}

/* Shapes may lie over each other and over layers, as veins do; a place has one layer. */
static int check_overlap(const struct sample *sample, size_t which, const char *path,
                         struct nacre_error *error)
{
    const struct sample_inclusion *layer = &sample->inclusions[which];
    for (size_t i = 0; i < which && count_shapes(layer) == 0; i++) {
        const struct sample_inclusion *other = &sample->inclusions[i];
        double from = fmax(layer->depth_mm[0], other->depth_mm[0]);
        double to = fmin(layer->depth_mm[1], other->depth_mm[1]);
        if (count_shapes(other) == 0 && from < to) {
            return nacre_fail(error,
                              "%s:%d: depth_mm: the layer overlaps that of line %d from %g to %g "
                              "mm; let one end where the other begins",
                              path, layer->depth_line, other->depth_line, from, to);
        }
    }
    return NACRE_OK;
}

static int check_inclusion(struct sample *sample, struct sample_inclusion *inclusion,
                           const char *path, struct nacre_error *error)
{
    int shapes = count_shapes(inclusion);
    if (shapes > 1 || (shapes == 0 && !inclusion->depth_line)) {
        return nacre_fail(error,
                          "%s:%d: an inclusion has one shape of vein, bands, checker, cells, "
                          "clouds and map, or is a layer with depth_mm",
                          path, inclusion->line);
    }
    inclusion->material_index = find_material(sample, inclusion->material);
    if (inclusion->material_index == sample->material_count) {
        return nacre_fail(error, "%s:%d: no material is called '%s'", path,
                          inclusion->material_line, inclusion->material);
    }
    if (inclusion->depth_mm[1] <= inclusion->depth_mm[0] ||
        inclusion->depth_mm[0] >= sample->thickness_mm) {
        return nacre_fail(error,
                          "%s:%d: depth_mm from %g to %g is no part of the slab, which goes "
                          "from 0 to %g",
                          path, inclusion->depth_line, inclusion->depth_mm[0],
                          inclusion->depth_mm[1], sample->thickness_mm);
    }
    if (inclusion->vein.line &&
        (inclusion->vein.point_count < 4 || inclusion->vein.point_count % 2)) {
        return nacre_fail(error,
                          "%s:%d: points_mm has %zu numbers; a vein needs x and y of two "
                          "points or more",
                          path, inclusion->vein.points_line, inclusion->vein.point_count);
    }
    return inclusion->map.line ? read_map(&inclusion->map, path, error) : NACRE_OK;
}

/* Voxels must resolve the shortest mean free path. */
static int check_resolution(const struct sample *sample, const char *path,
                            struct nacre_error *error)
{
    enum { FINEST = 4 };
    static const double PATHS = 2; /* a voxel spans this many mean free paths at most */
    double shortest = sample_shortest_path_mm(sample);
    int subdivide = sample->voxels.subdivide > 0 ? sample->voxels.subdivide : FINEST;
    if (sample->pitch_mm / subdivide > PATHS * shortest * (1 + 1e-9)) {
        double needed = ceil(sample->pitch_mm / (PATHS * shortest) - 1e-9);
        return nacre_fail(error,
                          "%s: the shortest mean free path is %.3g mm, too short for voxels of "
                          "%.3g mm; set voxels: subdivide to %.0f or more, or pitch_mm to %.3g",
                          path, shortest, sample->pitch_mm / subdivide, needed,
                          PATHS * shortest * subdivide);
    }
    if (sample->thickness_mm < shortest) {
        return nacre_fail(error,
                          "%s:%d: thickness_mm is %g, less than one mean free path of %.3g "
                          "mm, which the diffusion solver cannot treat; make the slab thicker",
                          path, sample->thickness_line, sample->thickness_mm, shortest);
    }
    return NACRE_OK;
}

/* What of the light transport `without` may name, beside the station's effects. */
static const char *const transport_effects[] = {SAMPLE_ABSORPTION, SAMPLE_DIRECTED, SAMPLE_INSIDE,
                                                SAMPLE_HETEROGENEITY, NULL};

bool sample_forbids(const struct sample *sample, const char *effect)
{
    for (size_t i = 0; i < sample->without_count; i++) {
        if (strcmp(sample->without[i], effect) == 0) {
            return true;
        }
    }
    return false;
}

void sample_without_text(const struct sample *sample, char *text, size_t size)
{
    size_t used = 0;
    if (size > 0) {
        text[0] = '\0';
    }
    for (size_t i = 0; i < sample->without_count && used < size; i++) {
        int length = snprintf(text + used, size - used, "%s%s", i == 0 ? "; without " : ", ",
                              sample->without[i]);
        used += length > 0 ? (size_t)length : size;
    }
}

static void forbid_in_material(const struct sample *sample, struct sample_material *material)
{
    for (int c = 0; c < 3; c++) {
        if (sample_forbids(sample, SAMPLE_ABSORPTION)) {
            material->absorption_per_mm[c] = 0;
        }
        if (sample_forbids(sample, SAMPLE_DIRECTED)) {
            material->scattering_per_mm[c] *= 1 - material->anisotropy[c];
            material->anisotropy[c] = 0;
        }
    }
    if (sample_forbids(sample, SAMPLE_INSIDE)) {
        material->index = 1;
    }
}

/* Take out of the sample what the file forbids. */
static int forbid(struct sample *sample, const char *path, struct nacre_error *error)
{
    for (size_t i = 0; i < sample->material_count; i++) {
        struct sample_material *material = &sample->materials[i];
        forbid_in_material(sample, material);
        if (!is_opaque(material)) {
            return nacre_fail(error, "%s:%d: without: material '%s' is clear without its %s", path,
                              sample->without_line, material->name, SAMPLE_ABSORPTION);
        }
    }
    if (sample_forbids(sample, SAMPLE_HETEROGENEITY)) {
        sample->forbidden_inclusions = sample->inclusion_count;
        sample->inclusion_count = 0;
    }
    return NACRE_OK;
}

static int check(struct sample *sample, const char *path, struct nacre_error *error)
{
    for (size_t i = 0; i < sample->material_count; i++) {
        struct sample_material *material = &sample->materials[i];
        int status = check_material(material, path, error);
        if (status) {
            return status;
        }
        if (find_material(sample, material->name) != i) {
            return nacre_fail(error, "%s:%d: a second material is called '%s'", path,
                              material->line, material->name);
        }
    }
    sample->base_index = find_material(sample, sample->base);
    if (sample->base_index == sample->material_count) {
        return nacre_fail(error, "%s:%d: no material is called '%s'", path, sample->base_line,
                          sample->base);
    }
    for (size_t i = 0; i < sample->inclusion_count; i++) {
        int status = check_inclusion(sample, &sample->inclusions[i], path, error);
        status = status ? status : check_overlap(sample, i, path, error);
        if (status) {
            return status;
        }
    }
    int status = effects_check_names(path, sample->without_line, sample->without,
                                     sample->without_count, transport_effects, effect_names, error);
    if (status) {
        return status;
    }
    status = forbid(sample, path, error);
    return status ? status : check_resolution(sample, path, error);
}

int sample_read(const char *path, struct sample *sample, struct nacre_error *error)
{
    int status = settings_read(path, &sample_schema, sample, error);
    if (status) {
        return status;
    }
    status = check(sample, path, error);
    if (status) {
        sample_finish(sample);
    }
    return status;
}

void sample_finish(struct sample *sample)
{
    sample->inclusion_count += sample->forbidden_inclusions;
    for (size_t i = 0; i < sample->inclusion_count; i++) {
        picture_finish(&sample->inclusions[i].map.picture);
    }
    settings_finish(&sample_schema, sample);
}

const char *sample_shape_name(const struct sample_inclusion *inclusion)
{
    return inclusion->vein.line      ? "vein"
           : inclusion->bands.line   ? "bands"
           : inclusion->checker.line ? "checker"
           : inclusion->cells.line   ? "cells"
           : inclusion->clouds.line  ? "clouds"
           : inclusion->map.line     ? "map"
                                     : "layer";
}

double sample_shortest_path_mm(const struct sample *sample)
{
    double shortest = INFINITY;
    for (size_t i = 0; i < sample->material_count; i++) {
        const struct sample_material *material = &sample->materials[i];
        for (int c = 0; c < 3; c++) {
            shortest = fmin(shortest,
                            1 / (material->absorption_per_mm[c] +
                                 (1 - material->anisotropy[c]) * material->scattering_per_mm[c]));
        }
    }
    return shortest;
}
