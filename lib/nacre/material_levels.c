/* Numbering the values of planes. */
#include "material_levels.h"

#include "half_float.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Half floats without an exponent of their own. */
enum { MOST_BITS = 10, MOST_LEVELS = 1 << MOST_BITS };
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

/* Values that a formula tells: number k of 0 ... last. With roots, values are largest (k / last)^2; else number 0 is 0, and
 * from 1 on logarithms are evenly spaced from least to largest. All are HALFs. */
struct formula {
    bool roots;
    double least, largest, last;
};

static float value_of(const struct formula *f, double number)
{
    double value = 0;
    if (f->roots) {
        value = f->largest * (number / f->last) * (number / f->last);
    } else if (number > 0) {
        value = f->least * exp((number - 1) / (f->last - 1) * log(f->largest / f->least));
    }
    return half_nearest((float)value);
}

static double inverse_of(const struct formula *f, float value)
{
    if (f->roots) {
        return rint(sqrt((double)value / f->largest) * f->last);
    }
    double share =
        f->largest > f->least ? log((double)value / f->least) / log(f->largest / f->least) : 0;
    return value > 0 ? 1 + rint(share * (f->last - 1)) : 0;
}

/* Whether the formula tells all values, which rise. */
static bool tells(const struct formula *f, const float *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        double number = inverse_of(f, values[i]);
        if (!(number >= 0 && number <= f->last) || value_of(f, number) != values[i]) {
            return false;
        }
    }
    return true;
}

/* A formula of so many bits that tells all of them. */
static bool find_formula(const float *values, size_t count, int bits, struct formula *f)
{
    size_t dark = count > 1 && values[0] == 0;
    double last = ldexp(1, bits) - 1, least = (double)values[dark],
           largest = (double)values[count - 1];
    if (bits < 2 || bits > MOST_BITS || values[0] < 0 || !(least > 0) || !isfinite(largest)) {
        return false;
    }
    *f = (struct formula){true, 0, largest, last};
    if (tells(f, values, count)) {
        return true;
    }
    *f = (struct formula){false, least, largest, last};
    return tells(f, values, count);
}

static int add_formula(struct exr_part *part, const struct formula *f)
{
    const float numbers[] = {(float)f->least, (float)f->largest, (float)f->last};
    return f->roots ? exr_part_add_floats(part, "nacre.roots", numbers + 1, 2)
                    : exr_part_add_floats(part, "nacre.logarithms", numbers, 3);
}

int levels_number(struct exr_part *part, int bits, bool *numbered, struct nacre_error *error)
{
    size_t size = (size_t)part->width * (size_t)part->height;
    size_t most = (size_t)1 << (bits < MOST_BITS ? bits : MOST_BITS);
    float *values = NULL;
    size_t count = list_values(part, &values);
    struct formula formula;
    int status = NACRE_OK;
    *numbered = false;
    if (count == SIZE_MAX) {
        return nacre_fail_memory(error, part->name);
    }
    if (count > 0 && count <= most) {
        bool told = find_formula(values, count, bits, &formula);
        if ((told ? add_formula(part, &formula)
                  : exr_part_add_floats(part, "nacre.values", values, count)) != NACRE_OK) {
            status = nacre_fail_memory(error, part->name);
            goto out;
        }
        for (size_t p = 0; p < part->plane_count; p++) {
            struct exr_plane *plane = &part->planes[p];
            plane->pixel = NACRE_HALF;
            for (size_t i = 0; i < size; i++) {
                if (!isnan(plane->values[i])) {
                    double number = told ? inverse_of(&formula, plane->values[i])
                                         : (double)number_of(values, count, plane->values[i]);
                    plane->values[i] = UNIT * (float)number;
                }
            }
        }
        *numbered = true;
    }
out:
    free(values);
    return status;
}

/* All values of a formula that a file tells, heap, or NULL where it tells none. */
static int list_formula(const struct exr_part *part, float **values, size_t *count,
                        struct nacre_error *error)
{
    const struct exr_attribute *roots = exr_part_find(part, "nacre.roots", EXR_FLOATS);
    const struct exr_attribute *logs = exr_part_find(part, "nacre.logarithms", EXR_FLOATS);
    const struct exr_attribute *told = roots ? roots : logs;
    size_t wanted = roots ? 2 : 3;
    *values = NULL;
    *count = 0;
    if (!told) {
        return NACRE_OK;
    }
    const char *name = roots ? "nacre.roots" : "nacre.logarithms";
    if (told->count != wanted) {
        return nacre_fail(error, "part %s: %s holds %zu numbers; it must hold %zu", part->name,
                          name, told->count, wanted);
    }
    struct formula f = {.roots = roots != NULL,
                        .least = roots ? 0 : (double)logs->floats[0],
                        .largest = (double)told->floats[wanted - 2],
                        .last = (double)told->floats[wanted - 1]};
    if (!(f.largest > 0) || !isfinite(f.largest) || !(f.last >= 2 && f.last < MOST_LEVELS) ||
        f.last != floor(f.last) || !(f.roots || (f.least > 0 && f.least <= f.largest))) {
        return nacre_fail(
            error,
            "part %s: %s is %g, %g; the least and the largest value must be positive, "
            "and the last number 2 to %d",
            part->name, name, f.largest, f.last, MOST_LEVELS - 1);
    }
    *count = (size_t)f.last + 1;
    *values = malloc(*count * sizeof **values);
    for (size_t i = 0; *values && i < *count; i++) {
        (*values)[i] = value_of(&f, (double)i);
    }
    return *values ? NACRE_OK : nacre_fail_memory(error, part->name);
}

static int restore(struct exr_part *part, const float *values, size_t count,
                   struct nacre_error *error)
{
    size_t size = (size_t)part->width * (size_t)part->height;
    bool halves = true;
    for (size_t i = 0; i < count; i++) {
        halves = halves && half_nearest(values[i]) == values[i];
    }
    for (size_t p = 0; p < part->plane_count; p++) {
        struct exr_plane *plane = &part->planes[p];
        if (plane->pixel == NACRE_UINT) {
            return nacre_fail(error, "part %s: channel %s must be HALF", part->name, plane->name);
        }
        plane->pixel = halves ? plane->pixel : NACRE_FLOAT;
        for (size_t i = 0; i < size; i++) {
            double number = (double)plane->values[i] / (double)UNIT;
            if (isnan(number)) {
                continue;
            }
            if (!(number >= 0 && number < (double)count) || number != floor(number)) {
                return nacre_fail(error,
                                  "part %s: channel %s: the value at (%zu, %zu) is no number of "
                                  "the %zu values that the part tells",
                                  part->name, plane->name, i % (size_t)part->width,
                                  i / (size_t)part->width, count);
            }
            plane->values[i] = values[(size_t)number];
        }
    }
    return NACRE_OK;
}

int levels_restore(struct exr_part *part, struct nacre_error *error)
{
    const struct exr_attribute *listed = exr_part_find(part, "nacre.values", EXR_FLOATS);
    float *values = NULL;
    size_t count = 0;
    int status = list_formula(part, &values, &count, error);
    if (status == NACRE_OK && (listed || values)) {
        status =
            restore(part, values ? values : listed->floats, values ? count : listed->count, error);
    }
    free(values);
    return status;
}
