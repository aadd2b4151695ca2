/* The spectra of a material's kernels, sharpened for reading between lattice nodes. */
#ifndef RENDER_CONVOLVE_KERNELS_H
#define RENDER_CONVOLVE_KERNELS_H

#include "render/appearance.h"
#include "render/convolve_fft.h"

struct convolve_kernels {
    int width, height;      /* of the transform */
    int terms, colors;      /* colors is 1 where all have the same kernels */
    float complex *spectra; /* [colors][terms][width / 2 + 1][height], over width times height */
};

/* For a lattice of `fine` nodes to a surface point; ffts[thread]. */
int convolve_kernels_make(struct convolve_kernels *kernels, const struct appearance *appearance,
                          int colors, int fine, const struct fft_plane *ffts,
                          struct nacre_error *error);
void convolve_kernels_finish(struct convolve_kernels *kernels);

/* out = spectrum times a kernel's, mirrored as told. */
void convolve_kernels_apply(const struct convolve_kernels *kernels, int color, int term,
                            bool mirror_x, bool mirror_y, const float complex *spectrum,
                            float complex *out);

#endif
