/* A factored material laid out for gathering light.
 *
 * Each kernel is split in a smooth part, which is gathered from the samples around, and a peak at the offset 0: light
 * that enters and leaves at the same surface point. The peak, with the plane `centre`, is the local part: a diffuse
 * reflectance at x_o, which keeps shadows and projected pictures as sharp as the material's own resolution. */
#ifndef RENDER_APPEARANCE_H
#define RENDER_APPEARANCE_H

#include "nacre/error.h"
#include "nacre/material.h"
#include "render/basis.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct appearance {
    int width, height, window;
    int terms;           /* rounded up to a multiple of 4; the rest are 0 */
    int factor_channels; /* 1 or 3 */
    enum nacre_layout layout;
    int clusters, mixed; /* 1 where there are none */
    int kernel_count;
    bool gathers; /* some smooth part is not 0 */
    bool packed;  /* three terms stand in the places of the colours, see grey.h */
    float *f, *h; /* [height][width][factor_channels][terms]; h may be f */
    /* Smooth parts with a border of zeros, side K + 2: [kernel_count][side][side][4], or with a kernel per term
     * [side][side][terms][4]; R, G, B and an unused float. */
    float *kernels;
    uint32_t *ids;      /* [height][width][mixed] */
    float *weights;     /* [height][width][mixed] */
    float *local;       /* [height][width][3] */
    struct basis basis; /* of the smooth kernels */
    double pitch_mm;
};

int appearance_make(struct appearance *appearance, const struct nacre_material *material,
                    struct nacre_error *error);
void appearance_finish(struct appearance *appearance);

/* Reflectance under even light: albedo[height][width][3], the sum over x_i of R_d(x_i, x_o), where the material goes on
 * beyond its border mirrored (or repeated). */
void appearance_albedo(const struct appearance *appearance, bool mirror, float *albedo);

#endif
