/* material.exr: the factored material model, in memory and on disk.
 *
 * R_d(x_i, x_o) ~ (sum_t F(x_i, t) H(t, x_o)) G(x_i, x_o) inside the K x K window around x_i and inside the sample, 0
 * elsewhere; each colour channel by itself (Peers et al. 2006, section 5.2). How G is made of kernels g(x_o - x_i) is
 * told by the layout; with NACRE_KERNEL_PER_TERM the kernel stands inside the sum:
 * R_d(x_i, x_o) ~ sum_t F(x_i, t) g_t(x_o - x_i) H(t, x_o) + centre(x_i) [x_i = x_o].
 * The file's layout is described in docs/formats.md. */
#ifndef NACRE_MATERIAL_H
#define NACRE_MATERIAL_H

#include "nacre/error.h"
#include "nacre/pixel.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum nacre_layout {
    NACRE_KERNEL_SINGLE,   /* n = k: G = sum_j w_j(x_i) g_{id_j(x_i)}(x_o - x_i) */
    NACRE_KERNEL_PAIR,     /* n = k*k: G = sum_{a,b} w_a(x_i) w_b(x_o) g_{a*k+b}(x_o - x_i) */
    NACRE_KERNEL_PER_TERM, /* n = terms: kernel t belongs to term t; no clusters */
};

struct nacre_material {
    int width, height; /* surface points */
    int channels;      /* 3 (R, G, B) or 1 (Y) */
    int window;        /* K, odd */
    int terms;
    int clusters; /* k; 0 with NACRE_KERNEL_PER_TERM */
    int mixed; /* kernels mixed at a surface point: 1 with hard clusters, 0 with NACRE_KERNEL_PER_TERM */
    enum nacre_layout layout;
    enum nacre_pixel pixel; /* of F, H and centre in the file: NACRE_HALF or NACRE_FLOAT */
    int factor_channels;    /* of F and H: as channels, or 1 where all channels share them */
    int bits; /* planes take at most 2^bits values, those of the centre 2^8 or more, of the albedo 2^6; 0: not quantised */

    float *albedo;  /* [channels][height][width]; NaN where not measured; not part of the model */
    float *f;       /* [terms][factor_channels][height][width] */
    float *h;       /* the same, or NULL: H = F */
    float *kernels; /* [n][channels][K][K], epsilon already in */
    int radii; /* kernels are radial, known by profiles at so many radii; 0: each entry by itself */
    float *radius; /* [radii], rising, or NULL; in surface points */
    float
        *profiles; /* [n][channels][radii], which nacre_material_spread makes kernels of, or NULL */
    uint32_t *ids; /* [mixed][height][width], or NULL */
    float *weights; /* [mixed][height][width], sum to 1 over mixed, or NULL */
    float *centre;  /* [channels][height][width], or NULL */
    float *
        gain; /* [height][width], > 0, or NULL: F(x, t) = gain(x) U(x, t) and H(t, x) = U(x, t) / gain(x), and the
                  * file holds U in place of both; f and h are the products */

    double pitch_mm;
    double epsilon; /* relative to each kernel's maximum in each channel */
    int iterations; /* of H and F once each */
    int seed;
    char method[32];
    double error_min, error_mean, error_max; /* relative, of the model as stored */

    size_t history_count; /* optional: objective and seconds after each iteration */
    float *history_objective, *history_seconds;
    float *
        history_error; /* optional beside them: mean relative error of a few points; NaN where not looked at */
    int history_every; /* they tell each so manieth iteration, the last among them; 0 and 1: each */
    size_t warning_count; /* optional: what the data's user should know */
    char **warnings;
};

/* Number of kernels: clusters, clusters^2 or terms. */
int nacre_material_kernel_count(const struct nacre_material *material);

/* Allocate all planes, zeroed, for the sizes, layout, channels and radii already set in *material (gain stays NULL); `with_h` and
 * `with_centre` say whether the optional ones exist. nacre_material_finish frees them. */
int nacre_material_allocate(struct nacre_material *material, bool with_h, bool with_centre,
                            struct nacre_error *error);

/* Make the kernels of the profiles: linear between radii, 0 beyond the last. Without profiles nothing is done. */
void nacre_material_spread(struct nacre_material *material);

/* Append a copy of one warning. */
int nacre_material_warn(struct nacre_material *material, const char *text,
                        struct nacre_error *error);

/* Read a material. *material is filled on success and empty on failure; nacre_material_finish it. Every plane, its
 * size, type, and every id and weight is checked; what is wrong is named by file, part and channel. */
int nacre_material_read(const char *path, struct nacre_material *material,
                        struct nacre_error *error);

/* Write a material: the whole file or none. */
int nacre_material_write(const char *path, const struct nacre_material *material,
                         struct nacre_error *error);

/* Round F, H and centre, of a quantised material the albedo too, to the stored pixel type, as a write and a read would. */
void nacre_material_round(struct nacre_material *material);

/* Free everything and empty *material. */
void nacre_material_finish(struct nacre_material *material);

/* Bytes of the model as the paper's Table 1 counts them: every stored number of F, H, centre, kernels and clusters at
 * its stored width, quantised planes at their bits, a hard label 1 byte up to 256 clusters. */
size_t nacre_material_size(const struct nacre_material *material);

#endif
