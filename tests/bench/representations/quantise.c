/* Rounding planes and kernels. */
#include "quantise.h"

#include "../timing.h"

#include <math.h>
#include <stdlib.h>

static double greatest_of(const double *values, size_t count)
{
    double greatest = 0;
    for (size_t i = 0; i < count; i++) {
        greatest = fmax(greatest, fabs(values[i]));
    }
    return greatest;
}

void quantise_root(double *values, size_t count, int bits)
{
    double steps = ldexp(1, bits) - 1, greatest = greatest_of(values, count);
    for (size_t i = 0; i < count && greatest > 0; i++) {
        double step = round(sqrt(fmax(0, values[i]) / greatest) * steps) / steps;
        values[i] = step * step * greatest;
    }
}

void quantise_evenly(double *values, size_t count, int bits)
{
    double steps = ldexp(1, bits) - 1, least = INFINITY, greatest = -INFINITY;
    for (size_t i = 0; i < count; i++) {
        least = fmin(least, values[i]);
        greatest = fmax(greatest, values[i]);
    }
    for (size_t i = 0; i < count && greatest > least; i++) {
        values[i] = least + round((values[i] - least) / (greatest - least) * steps) / steps *
                                (greatest - least);
    }
}

void quantise_logarithm(double *values, size_t count, int bits)
{
    double steps = ldexp(1, bits) - 2, greatest = greatest_of(values, count), least = greatest;
    for (size_t i = 0; i < count; i++) {
        least = values[i] >= 1e-3 * greatest ? fmin(least, values[i]) : least;
    }
    double range = least > 0 ? log(greatest / least) : 0;
    for (size_t i = 0; i < count; i++) {
        if (values[i] < least || least <= 0) {
            values[i] = values[i] < least / 2 ? 0 : least;
        } else if (range > 0) {
            values[i] = least * exp(round(log(values[i] / least) / range * steps) / steps * range);
        }
    }
}

void quantise_half(double *values, size_t count)
{
    int exponent = 0;
    (void)frexp(greatest_of(values, count), &exponent);
    for (size_t i = 0; i < count; i++) {
        int own = 0;
        (void)frexp(values[i], &own);
        /* 11 bits, less where the number is below the smallest normal one, 2^-29 of the greatest */
        int unit = (own - exponent > -29 ? own : exponent - 29) - 11;
        values[i] = ldexp(nearbyint(ldexp(values[i], -unit)), unit);
    }
}

static void quantise_planes(float *planes, size_t count, size_t size, int bits)
{
    double *plane = allocate(size * sizeof *plane);
    for (size_t p = 0; p < count; p++) {
        for (size_t i = 0; i < size; i++) {
            plane[i] = (double)planes[p * size + i];
        }
        quantise_root(plane, size, bits);
        for (size_t i = 0; i < size; i++) {
            planes[p * size + i] = (float)plane[i];
        }
    }
    free(plane);
}

void quantise_material(struct nacre_material *m, int bits)
{
    size_t points = (size_t)m->width * (size_t)m->height;
    size_t planes = (size_t)m->terms * (size_t)m->factor_channels;
    size_t area = (size_t)m->window * (size_t)m->window;
    quantise_planes(m->f, planes, points, bits);
    if (m->h) {
        quantise_planes(m->h, planes, points, bits);
    }
    double *kernel = allocate(area * sizeof *kernel);
    for (size_t j = 0; j < (size_t)nacre_material_kernel_count(m) * (size_t)m->channels; j++) {
        for (size_t i = 0; i < area; i++) {
            kernel[i] = (double)m->kernels[j * area + i];
        }
        quantise_half(kernel, area);
        for (size_t i = 0; i < area; i++) {
            m->kernels[j * area + i] = (float)kernel[i];
        }
    }
    free(kernel);
    m->pixel = NACRE_FLOAT;
    m->bits = bits;
}
