/* Fourier transforms of planes of real numbers, by kissfft. */
#ifndef RENDER_CONVOLVE_FFT_H
#define RENDER_CONVOLVE_FFT_H

#include "nacre/error.h"

#include <complex.h>
#include <stddef.h>

/* For one thread. Spectra are [width / 2 + 1][height]: columns follow each other, as they are transformed. */
struct fft_plane {
    int width, height;                     /* width is even */
    void *forward, *inverse;               /* of a row */
    void *column_forward, *column_inverse; /* of a column */
    float complex *rows, *column;          /* work space */
};

/* The least even size from `least` on that has no prime factor above 5. */
int fft_size(int least);

int fft_plane_make(struct fft_plane *fft, int width, int height, struct nacre_error *error);
void fft_plane_finish(struct fft_plane *fft);

/* plane[height][width] to its spectrum. Rows from `begin` to before `end` are read, the others taken for zeros. */
void fft_plane_forward(const struct fft_plane *fft, const float *plane, int begin, int end,
                       float complex *spectrum);

/* Rows `begin` to before `end` of the plane with that spectrum, times width times height. The spectrum is used up. */
void fft_plane_inverse(const struct fft_plane *fft, float complex *spectrum, int begin, int end,
                       float *rows);

#endif
