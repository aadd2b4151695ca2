/* OpenEXR files in memory: building, looking up and freeing them. */
#include "nacre/exr_file.h"

#include <stdlib.h>
#include <string.h>

/* One more zeroed element at the end of a list; NULL when memory runs out. */
static void *grow(void **list, size_t *count, size_t element)
{
    char *longer = reallocarray(*list, *count + 1, element);
    if (!longer) {
        return NULL;
    }
    *list = longer;
    void *added = longer + *count * element;
    memset(added, 0, element);
    *count += 1;
    return added;
}

static int set_name(char name[64], const char *text)
{
    size_t length = strlen(text);
    if (length >= 64) {
        return NACRE_FAILED;
    }
    memcpy(name, text, length + 1);
    return NACRE_OK;
}

struct exr_part *exr_file_add_part(struct exr_file *file, const char *name, int width, int height)
{
    void *list = file->parts;
    struct exr_part *part = grow(&list, &file->part_count, sizeof *part);
    file->parts = list;
    if (!part) {
        return NULL;
    }
    part->width = width;
    part->height = height;
    if (set_name(part->name, name) != NACRE_OK) {
        file->part_count--;
        return NULL;
    }
    return part;
}

struct exr_plane *exr_part_add_plane(struct exr_part *part, const char *name,
                                     enum nacre_pixel pixel)
{
    void *list = part->planes;
    struct exr_plane *plane = grow(&list, &part->plane_count, sizeof *plane);
    part->planes = list;
    if (!plane) {
        return NULL;
    }
    size_t size = (size_t)part->width * (size_t)part->height;
    plane->pixel = pixel;
    if (set_name(plane->name, name) == NACRE_OK) {
        plane->values = calloc(size ? size : 1, sizeof(float));
    }
    if (!plane->values) {
        part->plane_count--;
        return NULL;
    }
    return plane;
}

static void finish_attribute(struct exr_attribute *attribute)
{
    for (size_t i = 0; attribute->strings && i < attribute->count; i++) {
        free(attribute->strings[i]);
    }
    free(attribute->strings);
    free(attribute->floats);
    free(attribute->string);
}

static struct exr_attribute *add_attribute(struct exr_part *part, const char *name,
                                           enum exr_attribute_kind kind)
{
    void *list = part->attributes;
    struct exr_attribute *attribute = grow(&list, &part->attribute_count, sizeof *attribute);
    part->attributes = list;
    if (!attribute) {
        return NULL;
    }
    attribute->kind = kind;
    if (set_name(attribute->name, name) != NACRE_OK) {
        part->attribute_count--;
        return NULL;
    }
    return attribute;
}

int exr_part_add_int(struct exr_part *part, const char *name, int value)
{
    struct exr_attribute *attribute = add_attribute(part, name, EXR_INT);
    if (!attribute) {
        return NACRE_FAILED;
    }
    attribute->integer = value;
    return NACRE_OK;
}

int exr_part_add_float(struct exr_part *part, const char *name, float value)
{
    struct exr_attribute *attribute = add_attribute(part, name, EXR_FLOAT);
    if (!attribute) {
        return NACRE_FAILED;
    }
    attribute->real = value;
    return NACRE_OK;
}

/* Take back the attribute just added, for which memory ran out. */
static int drop_last(struct exr_part *part)
{
    part->attribute_count--;
    finish_attribute(&part->attributes[part->attribute_count]);
    return NACRE_FAILED;
}

int exr_part_add_string(struct exr_part *part, const char *name, const char *value)
{
    struct exr_attribute *attribute = add_attribute(part, name, EXR_STRING);
    if (!attribute) {
        return NACRE_FAILED;
    }
    attribute->string = strdup(value);
    return attribute->string ? NACRE_OK : drop_last(part);
}

int exr_part_add_floats(struct exr_part *part, const char *name, const float *values, size_t count)
{
    struct exr_attribute *attribute = add_attribute(part, name, EXR_FLOATS);
    if (!attribute) {
        return NACRE_FAILED;
    }
    attribute->floats = calloc(count ? count : 1, sizeof *values);
    if (!attribute->floats) {
        return drop_last(part);
    }
    if (count > 0) {
        memcpy(attribute->floats, values, count * sizeof *values);
    }
    attribute->count = count;
    return NACRE_OK;
}

int exr_part_add_strings(struct exr_part *part, const char *name, const char *const *values,
                         size_t count)
{
    struct exr_attribute *attribute = add_attribute(part, name, EXR_STRINGS);
    if (!attribute) {
        return NACRE_FAILED;
    }
    attribute->strings = calloc(count ? count : 1, sizeof *attribute->strings);
    if (!attribute->strings) {
        return drop_last(part);
    }
    for (; attribute->count < count; attribute->count++) {
        attribute->strings[attribute->count] = strdup(values[attribute->count]);
        if (!attribute->strings[attribute->count]) {
            return drop_last(part);
        }
    }
    return NACRE_OK;
}

struct exr_part *exr_file_find_part(const struct exr_file *file, const char *name)
{
    for (size_t i = 0; i < file->part_count; i++) {
        if (strcmp(file->parts[i].name, name) == 0) {
            return &file->parts[i];
        }
    }
    return NULL;
}

struct exr_plane *exr_part_find_plane(const struct exr_part *part, const char *name)
{
    for (size_t i = 0; i < part->plane_count; i++) {
        if (strcmp(part->planes[i].name, name) == 0) {
            return &part->planes[i];
        }
    }
    return NULL;
}

const struct exr_attribute *exr_part_find(const struct exr_part *part, const char *name,
                                          enum exr_attribute_kind kind)
{
    for (size_t i = 0; i < part->attribute_count; i++) {
        if (part->attributes[i].kind == kind && strcmp(part->attributes[i].name, name) == 0) {
            return &part->attributes[i];
        }
    }
    return NULL;
}

void exr_file_finish(struct exr_file *file)
{
    if (!file) {
        return;
    }
    for (size_t p = 0; p < file->part_count; p++) {
        struct exr_part *part = &file->parts[p];
        for (size_t i = 0; i < part->plane_count; i++) {
            free(part->planes[i].values);
        }
        for (size_t i = 0; i < part->attribute_count; i++) {
            finish_attribute(&part->attributes[i]);
        }
        free(part->planes);
        free(part->attributes);
    }
    free(file->parts);
    *file = (struct exr_file){0};
}
