/* Sharpening kernels and transforming them. */
#include "render/convolve_kernels.h"

#include "render/convolve_plan.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>

/* Divide `count` values by the cubic B-spline's own samples (1, 4, 1) / 6: a recursive filter there and back. */
static void sharpen(double *values, size_t stride, int count)
{
    const double pole = sqrt(3) - 2;
    double before = 0;
    for (int i = 0; i < count; i++) {
        before = values[(size_t)i * stride] + pole * before;
        values[(size_t)i * stride] = before;
    }
    /* Beyond the end the values are 0, and what comes back from there is the series of the pole's powers. */
    double after = before * pole / (pole * pole - 1);
    values[(size_t)(count - 1) * stride] = 6 * after;
    for (int i = count - 2; i >= 0; i--) {
        after = pole * (after - values[(size_t)i * stride]);
        values[(size_t)i * stride] = 6 * after;
    }
}

/* Of a sharpened kernel on the lattice: nodes between its samples are 0. */
static int side_of(int window, int fine)
{
    return (window - 1) * fine + 1 + 2 * CONVOLVE_TAIL;
}

/* The kernel of a term and colour into plane[height][width], its middle at (0, 0) and what lies before it at the end. */
static void lay_out(const struct appearance *appearance, int term, int color, int fine,
                    double *work, int width, int height, float *plane)
{
    int window = appearance->window, side = side_of(window, fine);
    for (int i = 0; i < side * side; i++) {
        int x = i % side - CONVOLVE_TAIL, y = i / side - CONVOLVE_TAIL;
        bool inside = x >= 0 && y >= 0 && x % fine == 0 && y % fine == 0 && x / fine < window &&
                      y / fine < window;
        size_t place = ((size_t)(y / fine + 1) * (size_t)(window + 2) + (size_t)(x / fine + 1)) *
                       (size_t)appearance->terms;
        work[i] = inside ? appearance->kernels[(place + (size_t)term) * 4 + (size_t)color] : 0;
    }
    for (int i = 0; i < side; i++) {
        sharpen(work + (size_t)i * (size_t)side, 1, side);
    }
    for (int i = 0; i < side; i++) {
        sharpen(work + i, (size_t)side, side);
    }
    for (size_t i = 0; i < (size_t)width * (size_t)height; i++) {
        plane[i] = 0;
    }
    for (int i = 0; i < side * side; i++) {
        int x = (i % side - side / 2 + width) % width, y = (i / side - side / 2 + height) % height;
        plane[(size_t)y * (size_t)width + (size_t)x] = (float)(work[i] / ((double)width * height));
    }
}

int convolve_kernels_make(struct convolve_kernels *kernels, const struct appearance *appearance,
                          int colors, int fine, const struct fft_plane *ffts,
                          struct nacre_error *error)
{
    size_t side = (size_t)side_of(appearance->window, fine);
    *kernels = (struct convolve_kernels){.width = ffts->width,
                                         .height = ffts->height,
                                         .terms = appearance->kernel_count,
                                         .colors = colors};
    size_t plane = (size_t)ffts->width * (size_t)ffts->height;
    size_t spectrum = ((size_t)ffts->width / 2 + 1) * (size_t)ffts->height;
    int count = colors * kernels->terms, failed = 0;
    kernels->spectra = malloc((size_t)count * spectrum * sizeof *kernels->spectra);
    if (!kernels->spectra) {
        return nacre_fail_memory(error, "the kernels' spectra");
    }
#pragma omp parallel for schedule(dynamic, 1) reduction(| : failed)
    for (int i = 0; i < count; i++) {
        double *work = calloc(side * side, sizeof *work);
        float *values = malloc(plane * sizeof *values);
        failed |= !work || !values;
        if (work && values) {
            lay_out(appearance, i % kernels->terms, i / kernels->terms, fine, work, ffts->width,
                    ffts->height, values);
            fft_plane_forward(&ffts[omp_get_thread_num()], values, 0, ffts->height,
                              kernels->spectra + (size_t)i * spectrum);
        }
        free(work);
        free(values);
    }
    return failed ? nacre_fail_memory(error, "the kernels' spectra") : NACRE_OK;
}

void convolve_kernels_finish(struct convolve_kernels *kernels)
{
    free(kernels->spectra);
    *kernels = (struct convolve_kernels){0};
}

/* Mirroring a kernel along x turns its spectrum's x round; of a real one that is the conjugate with y turned round. */
void convolve_kernels_apply(const struct convolve_kernels *kernels, int color, int term,
                            bool mirror_x, bool mirror_y, const float complex *spectrum,
                            float complex *out)
{
    size_t height = (size_t)kernels->height, columns = (size_t)kernels->width / 2 + 1;
    const float complex *kernel =
        kernels->spectra +
        ((size_t)color * (size_t)kernels->terms + (size_t)term) * columns * height;
    bool turned = mirror_x != mirror_y;
    float sign = mirror_x ? -1 : 1;
    for (size_t x = 0; x < columns; x++, kernel += height, spectrum += height, out += height) {
        for (size_t y = 0; y < height; y++) {
            const float complex k = kernel[turned && y > 0 ? height - y : y], s = spectrum[y];
            float real = crealf(k), imaginary = sign * cimagf(k);
            out[y] = CMPLXF(real * crealf(s) - imaginary * cimagf(s),
                            real * cimagf(s) + imaginary * crealf(s));
        }
    }
}
