/* Numbering the values of planes. */
#include "material_levels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Half floats without an exponent of their own. */
enum { MOST_LEVELS = 1024 };
#define UNIT 0x1p-24F

static int compare(const void *a, const void *b)
{
    float left = *(const float *)a, right = *(const float *)b;
    return (left > right) - (left < right);
}

/* Different values in rising order, into values[]; returns how many, or SIZE_MAX where there is no memory. */
static size_t list_values(const struct exr_part *part, float **values)
{
    size_t size = (size_t)part->width * (size_t)part->height, count = 0, kept = 0;
    float *all = malloc((part->plane_count * size + 1) * sizeof *all);
    if (!all) {
        return SIZE_MAX;
    }
    for (size_t i = 0; i < part->plane_count * size; i++) {
        float value = part->planes[i / size].values[i % size];
        if (!isnan(value)) {
            all[count++] = value;
        }
    }
    qsort(all, count, sizeof *all, compare);
    for (size_t i = 0; i < count; i++) {
        if (i == 0 || all[i] != all[kept - 1]) {
            all[kept++] = all[i];
        }
    }
    *values = all;
    return kept;
}

static size_t number_of(const float *values, size_t count, float value)
{
    const float *at = bsearch(&value, values, count, sizeof *values, compare);
    return (size_t)(at - values);
}

int levels_number(struct exr_part *part, size_t most, bool *numbered, struct nacre_error *error)
{
    size_t size = (size_t)part->width * (size_t)part->height;
    float *values = NULL;
    size_t count = list_values(part, &values);
    int status = NACRE_OK;
    *numbered = false;
    if (count == SIZE_MAX) {
        return nacre_fail_memory(error, part->name);
    }
    if (count > 0 && count <= most && count <= MOST_LEVELS) {
        if (exr_part_add_floats(part, "nacre.values", values, count) != NACRE_OK) {
            status = nacre_fail_memory(error, part->name);
            goto out;
        }
        for (size_t p = 0; p < part->plane_count; p++) {
            struct exr_plane *plane = &part->planes[p];
            plane->pixel = NACRE_HALF;
            for (size_t i = 0; i < size; i++) {
                if (!isnan(plane->values[i])) {
                    plane->values[i] = UNIT * (float)number_of(values, count, plane->values[i]);
                }
            }
        }
        *numbered = true;
    }
out:
    free(values);
    return status;
}

int levels_restore(struct exr_part *part, struct nacre_error *error)
{
    const struct exr_attribute *values = exr_part_find(part, "nacre.values", EXR_FLOATS);
    size_t size = (size_t)part->width * (size_t)part->height;
    for (size_t p = 0; values && p < part->plane_count; p++) {
        struct exr_plane *plane = &part->planes[p];
        if (plane->pixel == NACRE_UINT) {
            return nacre_fail(error, "part %s: channel %s must be HALF", part->name, plane->name);
        }
        for (size_t i = 0; i < size; i++) {
            double number = (double)plane->values[i] / (double)UNIT;
            if (isnan(number)) {
                continue;
            }
            if (!(number >= 0 && number < (double)values->count) || number != floor(number)) {
                return nacre_fail(error,
                                  "part %s: channel %s: the value at (%zu, %zu) is no number of "
                                  "the %zu in nacre.values",
                                  part->name, plane->name, i % (size_t)part->width,
                                  i / (size_t)part->width, values->count);
            }
            plane->values[i] = values->floats[(size_t)number];
        }
    }
    return NACRE_OK;
}
