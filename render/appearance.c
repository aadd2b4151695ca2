/* Laying out a material for the gather. */
#include "render/appearance.h"

#include "render/mapping.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* planes[term][channel][texel] to out[texel][channel][terms of the appearance] */
static float *interleave(const struct appearance *appearance, const struct nacre_material *material,
                         const float *planes)
{
    size_t texels = (size_t)appearance->width * (size_t)appearance->height;
    size_t channels = (size_t)appearance->factor_channels, terms = (size_t)appearance->terms;
    float *out = calloc(texels * channels * terms, sizeof *out);
    for (size_t t = 0; out && t < (size_t)material->terms; t++) {
        for (size_t c = 0; c < channels; c++) {
            const float *plane = planes + (t * channels + c) * texels;
            for (size_t i = 0; i < texels; i++) {
                out[(i * channels + c) * terms + t] = plane[i];
            }
        }
    }
    return out;
}

/* What the kernel has at its middle beyond the mean of its four neighbours. */
static float peak_of(const float *kernel, int window)
{
    int half = window / 2;
    const float *middle = kernel + (size_t)half * (size_t)window + half;
    if (window == 1) {
        return *middle;
    }
    float around = (middle[-1] + middle[1] + middle[-window] + middle[window]) / 4;
    return fmaxf(*middle - around, 0);
}

/* Where kernel `index` keeps row y, column x (of the padded window). */
static float *kernel_place(const struct appearance *appearance, size_t index, size_t x, size_t y)
{
    size_t side = (size_t)appearance->window + 2;
    return appearance->layout == NACRE_KERNEL_PER_TERM
               ? appearance->kernels + ((y * side + x) * (size_t)appearance->terms + index) * 4
               : appearance->kernels + ((index * side + y) * side + x) * 4;
}

/* Copy the smooth parts and return the peaks[kernel][3]; NULL when memory ran out. */
static float *split_kernels(struct appearance *appearance, const struct nacre_material *material)
{
    size_t window = (size_t)material->window;
    float *peaks = calloc((size_t)appearance->kernel_count * 3, sizeof *peaks);
    for (size_t j = 0; peaks && j < (size_t)appearance->kernel_count; j++) {
        for (size_t c = 0; c < 3; c++) {
            size_t channel = material->channels == 1 ? 0 : c;
            const float *kernel =
                material->kernels + (j * (size_t)material->channels + channel) * window * window;
            peaks[j * 3 + c] = peak_of(kernel, material->window);
            for (size_t i = 0; i < window * window; i++) {
                bool middle = i == window * window / 2;
                float value = kernel[i] - (middle ? peaks[j * 3 + c] : 0);
                kernel_place(appearance, j, i % window + 1, i / window + 1)[c] = value;
                appearance->gathers = appearance->gathers || value > 0;
            }
        }
    }
    return peaks;
}

static float dot(const float *a, const float *b, size_t count)
{
    float sum = 0;
    for (size_t i = 0; i < count; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* The local part at one surface point and colour: the peak of R_d(x, x). */
static double local_at(const struct appearance *appearance, const float *peaks, size_t texel,
                       size_t c)
{
    size_t terms = (size_t)appearance->terms, mixed = (size_t)appearance->mixed;
    size_t plane = appearance->factor_channels == 1 ? 0 : c;
    const float *f = appearance->f + (texel * (size_t)appearance->factor_channels + plane) * terms;
    const float *h = appearance->h + (texel * (size_t)appearance->factor_channels + plane) * terms;
    double sum = 0;
    if (appearance->layout == NACRE_KERNEL_PER_TERM) {
        for (size_t t = 0; t < (size_t)appearance->kernel_count; t++) {
            sum += (double)f[t] * h[t] * peaks[t * 3 + c];
        }
        return sum;
    }
    for (size_t a = 0; a < mixed; a++) {
        size_t id = appearance->ids[texel * mixed + a];
        double weight = appearance->weights[texel * mixed + a];
        if (appearance->layout == NACRE_KERNEL_SINGLE) {
            sum += weight * peaks[id * 3 + c];
            continue;
        }
        for (size_t b = 0; b < mixed; b++) {
            size_t kernel = id * (size_t)appearance->clusters + appearance->ids[texel * mixed + b];
            sum += weight * appearance->weights[texel * mixed + b] * peaks[kernel * 3 + c];
        }
    }
    return sum * dot(f, h, terms);
}

static void copy_clusters(struct appearance *appearance, const struct nacre_material *material)
{
    size_t texels = (size_t)appearance->width * (size_t)appearance->height;
    size_t mixed = (size_t)appearance->mixed;
    for (size_t i = 0; i < texels; i++) {
        for (size_t a = 0; a < mixed; a++) {
            size_t to = i * mixed + a, from = a * texels + i;
            appearance->ids[to] = material->ids ? material->ids[from] : 0;
            appearance->weights[to] = material->weights ? material->weights[from] : a == 0;
        }
    }
}

static int check_values(const struct appearance *appearance, struct nacre_error *error)
{
    size_t texels = (size_t)appearance->width * (size_t)appearance->height;
    size_t planes = (size_t)appearance->factor_channels * (size_t)appearance->terms;
    for (size_t i = 0; i < texels * planes; i++) {
        if (!isfinite(appearance->f[i]) || !isfinite(appearance->h[i])) {
            return nacre_fail(error,
                              "surface point (%zu, %zu) of the material has factors that are not "
                              "finite; factor the scan again",
                              i / planes % (size_t)appearance->width,
                              i / planes / (size_t)appearance->width);
        }
    }
    for (size_t i = 0; i < texels * 3; i++) {
        if (!isfinite(appearance->local[i])) {
            return nacre_fail(error,
                              "surface point (%zu, %zu) of the material reflects no finite part; "
                              "factor the scan again",
                              i / 3 % (size_t)appearance->width, i / 3 / (size_t)appearance->width);
        }
    }
    return NACRE_OK;
}

int appearance_make(struct appearance *appearance, const struct nacre_material *material,
                    struct nacre_error *error)
{
    size_t texels = (size_t)material->width * (size_t)material->height;
    size_t side = (size_t)material->window + 2;
    bool per_term = material->layout == NACRE_KERNEL_PER_TERM;
    float *peaks = NULL;
    int status = NACRE_FAILED;
    *appearance = (struct appearance){
        .width = material->width,
        .height = material->height,
        .window = material->window,
        .terms = (material->terms + 3) / 4 * 4,
        .factor_channels = material->factor_channels,
        .layout = material->layout,
        .clusters = material->clusters > 0 ? material->clusters : 1,
        .mixed = material->mixed > 0 ? material->mixed : 1,
        .kernel_count = nacre_material_kernel_count(material),
        .pitch_mm = material->pitch_mm,
    };
    size_t mixed = (size_t)appearance->mixed;
    size_t kernels = (size_t)(per_term ? appearance->terms : appearance->kernel_count);
    appearance->f = interleave(appearance, material, material->f);
    appearance->h = material->h ? interleave(appearance, material, material->h) : appearance->f;
    appearance->kernels = calloc(kernels * side * side * 4, sizeof *appearance->kernels);
    appearance->ids = calloc(texels * mixed, sizeof *appearance->ids);
    appearance->weights = calloc(texels * mixed, sizeof *appearance->weights);
    appearance->local = calloc(texels * 3, sizeof *appearance->local);
    if (!appearance->f || !appearance->h || !appearance->kernels || !appearance->ids ||
        !appearance->weights || !appearance->local) {
        (void)nacre_fail_memory(error, "the material");
        goto out;
    }
    copy_clusters(appearance, material);
    peaks = split_kernels(appearance, material);
    if (!peaks) {
        (void)nacre_fail_memory(error, "the material's kernels");
        goto out;
    }
    for (size_t i = 0; i < texels * 3; i++) {
        size_t channel = material->channels == 1 ? 0 : i % 3;
        double centre = material->centre ? material->centre[channel * texels + i / 3] : 0;
        appearance->local[i] = (float)(local_at(appearance, peaks, i / 3, i % 3) + centre);
    }
    status = check_values(appearance, error);
    if (status == NACRE_OK && appearance->gathers) {
        status = basis_make(&appearance->basis, appearance, error);
    }
out:
    free(peaks);
    if (status != NACRE_OK) {
        appearance_finish(appearance);
    }
    return status;
}

void appearance_finish(struct appearance *appearance)
{
    if (appearance->h != appearance->f) {
        free(appearance->h);
    }
    basis_finish(&appearance->basis);
    free(appearance->f);
    free(appearance->kernels);
    free(appearance->ids);
    free(appearance->weights);
    free(appearance->local);
    *appearance = (struct appearance){0};
}

/* The smooth part of R_d(x_i, x_o) at padded offset (u, v), added to sum[3]. */
static void add_response(const struct appearance *appearance, size_t xi, size_t xo, size_t u,
                         size_t v, double sum[3])
{
    size_t terms = (size_t)appearance->terms, mixed = (size_t)appearance->mixed;
    size_t planes = (size_t)appearance->factor_channels;
    for (size_t c = 0; c < 3; c++) {
        const float *f = appearance->f + (xi * planes + (planes == 1 ? 0 : c)) * terms;
        const float *h = appearance->h + (xo * planes + (planes == 1 ? 0 : c)) * terms;
        double value = 0;
        if (appearance->layout == NACRE_KERNEL_PER_TERM) {
            for (size_t t = 0; t < (size_t)appearance->kernel_count; t++) {
                value += (double)f[t] * h[t] * kernel_place(appearance, t, u, v)[c];
            }
            sum[c] += value;
            continue;
        }
        bool pair = appearance->layout == NACRE_KERNEL_PAIR;
        for (size_t a = 0; a < mixed; a++) {
            size_t id = appearance->ids[xi * mixed + a];
            for (size_t b = 0; b < (pair ? mixed : 1); b++) {
                double weight = appearance->weights[xi * mixed + a];
                size_t kernel = id;
                if (pair) {
                    weight *= appearance->weights[xo * mixed + b];
                    kernel = id * (size_t)appearance->clusters + appearance->ids[xo * mixed + b];
                }
                value += weight * kernel_place(appearance, kernel, u, v)[c];
            }
        }
        sum[c] += value * dot(f, h, terms);
    }
}

void appearance_albedo(const struct appearance *appearance, bool mirror, float *albedo)
{
    int width = appearance->width, height = appearance->height, half = appearance->window / 2;
#pragma omp parallel for schedule(dynamic, 1)
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
            size_t xo = (size_t)y * (size_t)width + (size_t)x;
            double sum[3] = {0};
            for (int v = -half; v <= half; v++) {
                for (int u = -half; u <= half; u++) {
                    int column = mapping_wrap(x - u, width, mirror);
                    int row = mapping_wrap(y - v, height, mirror);
                    size_t xi = (size_t)row * (size_t)width + (size_t)column;
                    size_t across = (size_t)u + (size_t)half + 1; /* of the padded window */
                    size_t down = (size_t)v + (size_t)half + 1;
                    add_response(appearance, xi, xo, across, down, sum);
                }
            }
            for (size_t c = 0; c < 3; c++) {
                double smooth = appearance->packed ? sum[0] + sum[1] + sum[2] : sum[c];
                albedo[xo * 3 + c] = (float)smooth + appearance->local[xo * 3 + c];
            }
        }
    }
}
