/* Rows as real numbers, then columns; several rows at a time, as neighbours in a column lie far apart. */
#include "render/convolve_fft.h"

#include <kiss_fft.h>
#include <kiss_fftr.h>
#include <stdlib.h>
#include <string.h>

enum { ROWS = 8 };

int fft_size(int least)
{
    for (int size = least + least % 2;; size += 2) {
        int rest = size;
        for (int prime = 2; prime <= 5; prime++) {
            while (rest % prime == 0) {
                rest /= prime;
            }
        }
        if (rest == 1) {
            return size;
        }
    }
}

int fft_plane_make(struct fft_plane *fft, int width, int height, struct nacre_error *error)
{
    size_t half = (size_t)width / 2 + 1;
    *fft = (struct fft_plane){
        .width = width,
        .height = height,
        .forward = kiss_fftr_alloc(width, 0, NULL, NULL),
        .inverse = kiss_fftr_alloc(width, 1, NULL, NULL),
        .column_forward = kiss_fft_alloc(height, 0, NULL, NULL),
        .column_inverse = kiss_fft_alloc(height, 1, NULL, NULL),
        .rows = calloc(ROWS * half, sizeof *fft->rows),
        .column = calloc((size_t)height, sizeof *fft->column),
    };
    if (!fft->forward || !fft->inverse || !fft->column_forward || !fft->column_inverse ||
        !fft->rows || !fft->column) {
        fft_plane_finish(fft);
        return nacre_fail_memory(error, "a Fourier transform");
    }
    return NACRE_OK;
}

void fft_plane_finish(struct fft_plane *fft)
{
    free(fft->forward);
    free(fft->inverse);
    free(fft->column_forward);
    free(fft->column_inverse);
    free(fft->rows);
    free(fft->column);
    *fft = (struct fft_plane){0};
}

static void transform_columns(const struct fft_plane *fft, kiss_fft_cfg how,
                              float complex *spectrum)
{
    size_t height = (size_t)fft->height;
    for (size_t x = 0; x <= (size_t)fft->width / 2; x++) {
        float complex *column = spectrum + x * height;
        kiss_fft(how, (const kiss_fft_cpx *)column, (kiss_fft_cpx *)fft->column);
        memcpy(column, fft->column, height * sizeof *column);
    }
}

void fft_plane_forward(const struct fft_plane *fft, const float *plane, int begin, int end,
                       float complex *spectrum)
{
    size_t height = (size_t)fft->height, half = (size_t)fft->width / 2 + 1;
    memset(spectrum, 0, half * height * sizeof *spectrum);
    for (int y = begin; y < end; y += ROWS) {
        size_t count = (size_t)(end - y < ROWS ? end - y : ROWS);
        for (size_t i = 0; i < count; i++) {
            kiss_fftr(fft->forward, plane + ((size_t)y + i) * (size_t)fft->width,
                      (kiss_fft_cpx *)(fft->rows + i * half));
        }
        for (size_t x = 0; x < half; x++) {
            for (size_t i = 0; i < count; i++) {
                spectrum[x * height + (size_t)y + i] = fft->rows[i * half + x];
            }
        }
    }
    transform_columns(fft, fft->column_forward, spectrum);
}

void fft_plane_inverse(const struct fft_plane *fft, float complex *spectrum, int begin, int end,
                       float *rows)
{
    size_t height = (size_t)fft->height, half = (size_t)fft->width / 2 + 1;
    transform_columns(fft, fft->column_inverse, spectrum);
    for (int y = begin; y < end; y += ROWS) {
        size_t count = (size_t)(end - y < ROWS ? end - y : ROWS);
        for (size_t x = 0; x < half; x++) {
            for (size_t i = 0; i < count; i++) {
                fft->rows[i * half + x] = spectrum[x * height + (size_t)y + i];
            }
        }
        for (size_t i = 0; i < count; i++) {
            kiss_fftri(fft->inverse, (const kiss_fft_cpx *)(fft->rows + i * half),
                       rows + ((size_t)(y - begin) + i) * (size_t)fft->width);
        }
    }
}
