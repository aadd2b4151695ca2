/* The attributes of material.exr: the numbers beside its planes. */
#include "material_attributes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Of a small material a long history would be a tenth: so many iterations at most are told of a quantised one. */
enum { HISTORY_MOST = 17 };

/* Every so manieth value up to the last; in place of one that is not known the last before it. */
static int add_thinned(struct exr_part *part, const char *name, const float *values, size_t count,
                       size_t every)
{
    float kept[HISTORY_MOST];
    size_t first = (count - 1) % every, next = 0;
    float known = NAN;
    for (size_t i = 0; i < count; i++) {
        known = isnan(values[i]) ? known : values[i];
        if (i >= first && (i - first) % every == 0) {
            kept[next++] = known;
            known = NAN;
        }
    }
    return exr_part_add_floats(part, name, kept, next);
}

static int add_history(struct exr_part *part, const struct nacre_material *m)
{
    size_t count = m->history_count, told = m->history_every > 1 ? (size_t)m->history_every : 1;
    size_t every = m->bits > 0 ? (count + HISTORY_MOST - 1) / HISTORY_MOST : 1;
    const char *const names[] = {"nacre.history.objective", "nacre.history.seconds",
                                 "nacre.history.error"};
    const float *const of[] = {m->history_objective, m->history_seconds, m->history_error};
    int status = NACRE_OK;
    for (int i = 0; i < 3; i++) {
        if (of[i]) {
            status |= every > 1 ? add_thinned(part, names[i], of[i], count, every)
                                : exr_part_add_floats(part, names[i], of[i], count);
        }
    }
    if (every * told > 1) {
        status |= exr_part_add_int(part, "nacre.history.every", (int)(every * told));
    }
    return status;
}

int material_add_attributes(struct exr_part *part, bool numbered,
                            const struct nacre_material *material)
{
    static const char *const layouts[] = {"single", "pair", "term"};
    int status = exr_part_add_string(
        part, "nacre.format",
        numbered || material->radii > 0 || material->gain ? "material 2" : "material 1");
    status |= exr_part_add_float(part, "nacre.pitch", (float)material->pitch_mm);
    status |= exr_part_add_int(part, "nacre.window", material->window);
    status |= exr_part_add_int(part, "nacre.terms", material->terms);
    if (material->layout != NACRE_KERNEL_PER_TERM) {
        status |= exr_part_add_int(part, "nacre.clusters", material->clusters);
    }
    status |= exr_part_add_int(part, "nacre.iterations", material->iterations);
    status |= exr_part_add_int(part, "nacre.seed", material->seed);
    status |= exr_part_add_string(part, "nacre.kernels", layouts[material->layout]);
    status |= exr_part_add_string(part, "nacre.method", material->method);
    status |= exr_part_add_float(part, "nacre.epsilon", (float)material->epsilon);
    status |= exr_part_add_float(part, "nacre.error.min", (float)material->error_min);
    status |= exr_part_add_float(part, "nacre.error.mean", (float)material->error_mean);
    status |= exr_part_add_float(part, "nacre.error.max", (float)material->error_max);
    if (material->bits > 0) {
        status |= exr_part_add_int(part, "nacre.bits", material->bits);
    }
    if (material->radii > 0) {
        status |=
            exr_part_add_floats(part, "nacre.radii", material->radius, (size_t)material->radii);
    }
    if (material->history_count > 0) {
        status |= add_history(part, material);
    }
    if (material->warning_count > 0) {
        status |=
            exr_part_add_strings(part, "nacre.warnings", (const char *const *)material->warnings,
                                 material->warning_count);
    }
    return status == NACRE_OK ? NACRE_OK : NACRE_FAILED;
}

/* An int attribute of the first part. */
static int get_int(const struct exr_part *part, const char *name, int *value,
                   struct nacre_error *error)
{
    const struct exr_attribute *attribute = exr_part_find(part, name, EXR_INT);
    if (!attribute) {
        return nacre_fail(error, "part %s: the attribute %s (int) is missing", part->name, name);
    }
    *value = attribute->integer;
    return NACRE_OK;
}

static int get_float(const struct exr_part *part, const char *name, double *value,
                     struct nacre_error *error)
{
    const struct exr_attribute *attribute = exr_part_find(part, name, EXR_FLOAT);
    if (!attribute) {
        return nacre_fail(error, "part %s: the attribute %s (float) is missing", part->name, name);
    }
    *value = (double)attribute->real;
    return NACRE_OK;
}

static const char *get_string(const struct exr_part *part, const char *name)
{
    const struct exr_attribute *attribute = exr_part_find(part, name, EXR_STRING);
    return attribute ? attribute->string : "";
}

static int read_format(const struct exr_part *first, struct nacre_material *material,
                       struct nacre_error *error)
{
    const char *format = get_string(first, "nacre.format");
    const char *layout = get_string(first, "nacre.kernels");
    if (format[0] == '\0') {
        return nacre_fail(error, "not a material: the attribute nacre.format is missing; it should "
                                 "be \"material 1\" or \"material 2\"");
    }
    if (strcmp(format, "material 1") != 0 && strcmp(format, "material 2") != 0) {
        return nacre_fail(error,
                          "not a material: nacre.format is \"%.64s\", and this program reads "
                          "\"material 1\" and \"material 2\"",
                          format);
    }
    if (strcmp(layout, "single") == 0) {
        material->layout = NACRE_KERNEL_SINGLE;
    } else if (strcmp(layout, "pair") == 0) {
        material->layout = NACRE_KERNEL_PAIR;
    } else if (strcmp(layout, "term") == 0) {
        material->layout = NACRE_KERNEL_PER_TERM;
    } else {
        return nacre_fail(error, "nacre.kernels is \"%.64s\"; it must be single, pair or term",
                          layout);
    }
    return NACRE_OK;
}

static int read_numbers(const struct exr_part *first, struct nacre_material *material,
                        struct nacre_error *error)
{
    const struct exr_attribute *bits = exr_part_find(first, "nacre.bits", EXR_INT);
    const char *method = get_string(first, "nacre.method");
    int status = get_float(first, "nacre.pitch", &material->pitch_mm, error);
    if (status == NACRE_OK) {
        status = get_int(first, "nacre.window", &material->window, error);
    }
    if (status == NACRE_OK) {
        status = get_int(first, "nacre.terms", &material->terms, error);
    }
    if (status == NACRE_OK && material->layout != NACRE_KERNEL_PER_TERM) {
        status = get_int(first, "nacre.clusters", &material->clusters, error);
    }
    if (status == NACRE_OK) {
        status = get_int(first, "nacre.iterations", &material->iterations, error);
    }
    if (status == NACRE_OK) {
        status = get_int(first, "nacre.seed", &material->seed, error);
    }
    if (status == NACRE_OK) {
        status = get_float(first, "nacre.epsilon", &material->epsilon, error);
    }
    if (status == NACRE_OK) {
        status = get_float(first, "nacre.error.min", &material->error_min, error);
    }
    if (status == NACRE_OK) {
        status = get_float(first, "nacre.error.mean", &material->error_mean, error);
    }
    if (status == NACRE_OK) {
        status = get_float(first, "nacre.error.max", &material->error_max, error);
    }
    if (status != NACRE_OK) {
        return status;
    }
    if (!(material->pitch_mm > 0) || !isfinite(material->pitch_mm)) {
        return nacre_fail(error, "nacre.pitch is %g mm; it must be positive", material->pitch_mm);
    }
    if (strlen(method) >= sizeof material->method) {
        return nacre_fail(error, "nacre.method is longer than %zu characters",
                          sizeof material->method - 1);
    }
    (void)snprintf(material->method, sizeof material->method, "%s", method);
    material->bits = bits ? bits->integer : 0;
    return NACRE_OK;
}

static float *copy_floats(const struct exr_attribute *attribute)
{
    float *copy = calloc(attribute->count, sizeof *copy);
    if (copy) {
        memcpy(copy, attribute->floats, attribute->count * sizeof *copy);
    }
    return copy;
}

static int read_history(const struct exr_part *first, struct nacre_material *material,
                        struct nacre_error *error)
{
    const struct exr_attribute *objective =
        exr_part_find(first, "nacre.history.objective", EXR_FLOATS);
    const struct exr_attribute *seconds = exr_part_find(first, "nacre.history.seconds", EXR_FLOATS);
    const struct exr_attribute *errors = exr_part_find(first, "nacre.history.error", EXR_FLOATS);
    const struct exr_attribute *warnings = exr_part_find(first, "nacre.warnings", EXR_STRINGS);
    if ((objective ? objective->count : 0) != (seconds ? seconds->count : 0)) {
        return nacre_fail(error,
                          "nacre.history.objective and nacre.history.seconds differ in length");
    }
    if (errors && errors->count != (objective ? objective->count : 0)) {
        return nacre_fail(error,
                          "nacre.history.objective and nacre.history.error differ in length");
    }
    const struct exr_attribute *every = exr_part_find(first, "nacre.history.every", EXR_INT);
    if (every && every->integer < 1) {
        return nacre_fail(error, "nacre.history.every is %d; it must be positive", every->integer);
    }
    if (objective && objective->count > 0) {
        material->history_every = every ? every->integer : 1;
        material->history_objective = copy_floats(objective);
        material->history_seconds = copy_floats(seconds);
        material->history_error = errors ? copy_floats(errors) : NULL;
        material->history_count = objective->count;
        if (!material->history_objective || !material->history_seconds ||
            (errors && !material->history_error)) {
            return nacre_fail_memory(error, "the history");
        }
    }
    for (size_t i = 0; warnings && i < warnings->count; i++) {
        int status = nacre_material_warn(material, warnings->strings[i], error);
        if (status != NACRE_OK) {
            return status;
        }
    }
    return NACRE_OK;
}

int material_read_attributes(const struct exr_part *first, struct nacre_material *material,
                             struct nacre_error *error)
{
    int status = read_format(first, material, error);
    if (status == NACRE_OK && strcmp(first->name, "albedo") != 0) {
        status = nacre_fail(error, "the first part is \"%s\"; it must be albedo", first->name);
    }
    if (status == NACRE_OK) {
        status = read_numbers(first, material, error);
    }
    return status == NACRE_OK ? read_history(first, material, error) : status;
}
