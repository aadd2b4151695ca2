/* The gather in double precision, sample by sample: what gather.cl is checked against. */
#include "render/gather.h"
#include "render/receivers.h"

#include <math.h>
#include <stdlib.h>

/* Kernel value between surface points, at padded place (u, v). */
static double kernel_at(const struct appearance *appearance, size_t kernel, size_t c, double u,
                        double v)
{
    size_t side = (size_t)appearance->window + 2, x = (size_t)u, y = (size_t)v;
    double sum = 0, fx = u - (double)x, fy = v - (double)y;
    for (size_t k = 0; k < 4; k++) {
        size_t column = x + (k & 1), row = y + (k >> 1);
        size_t place = appearance->layout == NACRE_KERNEL_PER_TERM
                           ? (row * side + column) * (size_t)appearance->terms + kernel
                           : (kernel * side + row) * side + column;
        sum +=
            ((k & 1) ? fx : 1 - fx) * ((k >> 1) ? fy : 1 - fy) * appearance->kernels[place * 4 + c];
    }
    return sum;
}

static double response(const struct appearance *appearance, size_t texel, const struct receiver *to,
                       const float *h, size_t c, double u, double v)
{
    size_t terms = (size_t)appearance->terms, plane = appearance->factor_channels == 1 ? 0 : c;
    const float *f = appearance->f + (texel * (size_t)appearance->factor_channels + plane) * terms;
    double sum = 0, kernel = 0;
    for (size_t t = 0; t < terms; t++) {
        double g =
            appearance->layout == NACRE_KERNEL_PER_TERM ? kernel_at(appearance, t, c, u, v) : 1;
        sum += (double)f[t] * h[plane * terms + t] * g;
    }
    if (appearance->layout == NACRE_KERNEL_PER_TERM) {
        return sum;
    }
    for (size_t a = 0; a < (size_t)appearance->mixed; a++) {
        size_t place = texel * (size_t)appearance->mixed + a, id = appearance->ids[place];
        if (appearance->layout == NACRE_KERNEL_PAIR) {
            id = id * (size_t)appearance->clusters + (size_t)to->column;
        }
        kernel += appearance->weights[place] * kernel_at(appearance, id, c, u, v);
    }
    return sum * kernel;
}

static void add_pair(const struct gather *gather, const struct receiver *to, const float *h,
                     const struct light_sample *from, double sum[3])
{
    const struct mapping *mapping = gather->mapping;
    const struct appearance *appearance = gather->appearance;
    struct vec3 offset = vec3_subtract(vec3_from(to->position), vec3_from(from->position));
    double square = vec3_dot(offset, offset),
           half = appearance->window / 2 + 1; /* NOLINT: K is odd */
    double a = vec3_dot(offset, vec3_from(to->along_x)),
           b = vec3_dot(offset, vec3_from(to->along_y));
    if (gather->same_side && vec3_dot(vec3_from(to->normal), vec3_from(from->normal)) <= 0) {
        return;
    }
    if (!(a * a + b * b > 1e-10 * square)) {
        a = 1;
        b = 0;
    }
    double scale = sqrt(square / (a * a + b * b)) / mapping->point_mm;
    double u = to->flip_x * a * scale + half, v = to->flip_y * b * scale + half;
    if (!(u > 0 && u < 2 * half && v > 0 && v < 2 * half)) {
        return;
    }
    size_t texel = from->texel;
    if (from->chart != to->chart || fabs((double)to->along_x[3] - from->x) > half ||
        fabs((double)to->along_y[3] - from->y) > half) {
        int64_t x = (int64_t)floor(to->along_x[3] - a * scale);
        int64_t y = (int64_t)floor(to->along_y[3] - b * scale);
        texel = (size_t)mapping_wrap(y, mapping->height, mapping->mirror) * (size_t)mapping->width +
                (size_t)mapping_wrap(x, mapping->width, mapping->mirror);
    }
    for (size_t c = 0; c < 3; c++) {
        sum[c] += from->flux[c] * response(appearance, texel, to, h, c, u, v);
    }
}

int gather_reference(const struct gather *gather, float (*radiosity)[3], struct nacre_error *error)
{
    struct receivers receivers;
    size_t h_size = (size_t)gather->appearance->factor_channels * (size_t)gather->appearance->terms;
    double point = gather->mapping->point_mm;
    if (receivers_make(&receivers, gather->mesh, gather->mapping, gather->appearance, error) !=
        NACRE_OK) {
        return NACRE_FAILED;
    }
    for (size_t i = 0; i < receivers.count; i++) {
        double sum[3] = {0};
        for (size_t s = 0; s < gather->samples->count; s++) {
            add_pair(gather, &receivers.list[i], receivers.h + i * h_size,
                     &gather->samples->list[s], sum);
        }
        for (int c = 0; c < 3; c++) {
            radiosity[receivers.vertices[i]][c] += (float)(sum[c] / (point * point));
        }
    }
    receivers_finish(&receivers);
    return NACRE_OK;
}
