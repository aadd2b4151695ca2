/* A material in memory: its planes, their rounding and its size. */
#include "nacre/material.h"

#include "half_float.h"
#include "material_check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

int nacre_material_kernel_count(const struct nacre_material *material)
{
    switch (material->layout) {
    case NACRE_KERNEL_SINGLE:
        return material->clusters;
    case NACRE_KERNEL_PAIR:
        return material->clusters * material->clusters;
    case NACRE_KERNEL_PER_TERM:
        return material->terms;
    }
    return 0;
}

static size_t points(const struct nacre_material *material)
{
    return (size_t)material->width * (size_t)material->height;
}

static size_t factor_size(const struct nacre_material *material)
{
    return (size_t)material->terms * (size_t)material->factor_channels * points(material);
}

static size_t kernel_size(const struct nacre_material *material)
{
    return (size_t)nacre_material_kernel_count(material) * (size_t)material->channels *
           (size_t)material->window * (size_t)material->window;
}

static size_t profile_size(const struct nacre_material *material)
{
    return (size_t)nacre_material_kernel_count(material) * (size_t)material->channels *
           (size_t)material->radii;
}

static void *zeroed(size_t count)
{
    return calloc(count ? count : 1, sizeof(float));
}

int nacre_material_allocate(struct nacre_material *material, bool with_h, bool with_centre,
                            struct nacre_error *error)
{
    int status = material_check_sizes(material, error);
    if (status != NACRE_OK) {
        return status;
    }
    size_t colours = (size_t)material->channels * points(material);
    size_t labels = (size_t)material->mixed * points(material);
    material->albedo = zeroed(colours);
    material->f = zeroed(factor_size(material));
    material->h = with_h ? zeroed(factor_size(material)) : NULL;
    material->kernels = zeroed(kernel_size(material));
    material->ids = labels ? zeroed(labels) : NULL;
    material->weights = labels ? zeroed(labels) : NULL;
    material->centre = with_centre ? zeroed(colours) : NULL;
    if (material->radii > 0) {
        material->radius = zeroed((size_t)material->radii);
        material->profiles = zeroed(profile_size(material));
    }
    if (!material->albedo || !material->f || (with_h && !material->h) || !material->kernels ||
        (labels && (!material->ids || !material->weights)) || (with_centre && !material->centre) ||
        (material->radii > 0 && (!material->radius || !material->profiles))) {
        nacre_material_finish(material);
        return nacre_fail_memory(error, "the material's planes");
    }
    return NACRE_OK;
}

/* A profile at a distance from the centre. */
static float profile_at(const struct nacre_material *material, const float *profile,
                        double distance)
{
    const float *radius = material->radius;
    int last = material->radii - 1, k = 0;
    while (k < last && (double)radius[k + 1] <= distance) {
        k++;
    }
    double share = distance - (double)radius[k];
    if (share <= 0 || k == last) {
        return share > 0 ? 0 : profile[k];
    }
    share /= (double)radius[k + 1] - (double)radius[k];
    return (float)((1 - share) * (double)profile[k] + share * (double)profile[k + 1]);
}

void nacre_material_spread(struct nacre_material *material)
{
    int window = material->window, half = window / 2;
    size_t area = (size_t)window * (size_t)window;
    size_t count = (size_t)nacre_material_kernel_count(material) * (size_t)material->channels;
    for (size_t i = 0; material->radii > 0 && i < count; i++) {
        const float *profile = material->profiles + i * (size_t)material->radii;
        for (int j = 0; j < window * window; j++) {
            int dx = j % window - half, dy = j / window - half;
            material->kernels[i * area + (size_t)j] = profile_at(material, profile, hypot(dx, dy));
        }
    }
}

int nacre_material_warn(struct nacre_material *material, const char *text,
                        struct nacre_error *error)
{
    char **longer = reallocarray(material->warnings, material->warning_count + 1, sizeof *longer);
    if (!longer) {
        return nacre_fail_memory(error, "a warning");
    }
    material->warnings = longer;
    longer[material->warning_count] = strdup(text);
    if (!longer[material->warning_count]) {
        return nacre_fail_memory(error, "a warning");
    }
    material->warning_count++;
    return NACRE_OK;
}

void nacre_material_round(struct nacre_material *material)
{
    if (material->pixel != NACRE_HALF) {
        return;
    }
    if (material->gain) { /* the file's planes are neither F nor H */
        half_round(material->gain, points(material));
    } else {
        half_round(material->f, factor_size(material));
    }
    if (material->h && !material->gain) {
        half_round(material->h, factor_size(material));
    }
    if (material->bits > 0) {
        half_round(material->albedo, (size_t)material->channels * points(material));
    }
    if (material->centre) {
        half_round(material->centre, (size_t)material->channels * points(material));
    }
}

void nacre_material_finish(struct nacre_material *material)
{
    if (!material) {
        return;
    }
    for (size_t i = 0; i < material->warning_count; i++) {
        free(material->warnings[i]);
    }
    free(material->warnings);
    free(material->history_objective);
    free(material->history_seconds);
    free(material->history_error);
    free(material->albedo);
    free(material->f);
    free(material->h);
    free(material->kernels);
    free(material->ids);
    free(material->weights);
    free(material->centre);
    free(material->radius);
    free(material->profiles);
    free(material->gain);
    *material = (struct nacre_material){0};
}

static size_t stored_kernels(const struct nacre_material *material)
{
    return material->radii > 0 ? profile_size(material) : kernel_size(material);
}

size_t nacre_material_size(const struct nacre_material *material)
{
    size_t bits = material->bits > 0              ? (size_t)material->bits
                  : material->pixel == NACRE_HALF ? 16
                                                  : 32;
    size_t numbers = factor_size(material) * (material->h && !material->gain ? 2 : 1);
    if (material->gain) {
        numbers += points(material);
    }
    size_t centre = material->centre ? (size_t)material->channels * points(material) : 0;
    size_t centre_bits = bits < 8 ? 8 : bits;
    size_t bytes =
        (numbers * bits + centre * centre_bits + 7) / 8 + stored_kernels(material) * sizeof(float);
    if (material->mixed == 1) {
        bytes += points(material) * (material->clusters <= 256 ? 1 : sizeof(uint32_t));
    } else {
        bytes += (size_t)material->mixed * points(material) * (sizeof(uint32_t) + sizeof(float));
    }
    return bytes;
}
