/* What the model with a kernel per term is fitted to: the responses as its kernels want them, and their weights.
 *
 *     R(x_i, x_o) ~ sum_t F(x_i, t) g_t(x_o - x_i) H(t, x_o) + c(x_i) [x_i = x_o]
 *
 * c takes the centre whole, so that the rest is fitted to all entries but the centre. Where light goes the same way forth
 * and back H = F, and R(x_i, x_o) and R(x_o, x_i) are two measurements of one number: both are replaced by their weighted
 * mean. Where gains of projector and camera are left in the data, R(x_i, x_o) / R(x_o, x_i) = (gain(x_i) / gain(x_o))^2:
 * the gain is divided out first. */
#ifndef FACTOR_TERMS_DATA_H
#define FACTOR_TERMS_DATA_H

#include "factor/responses.h"

enum terms_reciprocity {
    TERMS_AUTO, /* as the responses are found to be */
    TERMS_RECIPROCAL,
    TERMS_GAINED, /* but for a gain at both ends */
    TERMS_ONE_WAY,
};

enum terms_weight { TERMS_WEIGHT_RESPONSE, TERMS_WEIGHT_KERNEL };

struct terms_options {
    enum terms_reciprocity reciprocity;
    enum terms_weight weight; /* W^2 = 1 / ||R_i||^2, or 1 / the mean response */
    bool full;                /* kernels of K x K numbers; else they depend on the distance alone */
    bool separate;            /* each colour channel has planes of its own */
};

/* Where the numbers of a kernel stand. */
struct terms_grid {
    int window, count; /* K; numbers of a kernel */
    float *radius;     /* [count] of radial ones, else NULL */
    int *first;        /* [K][K]: an entry lies between this number and the next ... */
    double *share;     /* ... by this share of their distance */
};

struct terms_data {
    const struct responses *responses;
    struct terms_options options; /* resolved: not TERMS_AUTO */
    struct terms_grid grid;
    int copy_count;                    /* 1, or 2 where one way: R and its transpose R(x_o, x_i) */
    struct responses copies[2];        /* as half floats */
    float *weights;                    /* [height][width]: W^2 of a point, 0 where it is dark */
    float *scales[RESPONSES_CHANNELS]; /* [K][K]: by which an entry's weight is multiplied */
    float *gain;                       /* [height][width] or NULL */
    int reach; /* nearly all light is so many rows and columns from the centre; half of K: not used */
    int exponent; /* the objective is 2^exponent times what weights and scales make it */
    double constant
        [RESPONSES_CHANNELS]; /* of the objective, before that: what the two of each pair differ by */
    double asymmetry, asymmetry_left; /* of pairs, beyond noise; after the gain is divided out */
};

/* Belongs to the caller, who calls terms_data_finish, also after a failure. Keeps `responses`. */
int terms_data_begin(struct terms_data *data, const struct responses *responses,
                     const struct terms_options *options, double epsilon,
                     struct nacre_error *error);
void terms_data_finish(struct terms_data *data); /* a zeroed one is allowed */

/* Sets of planes: one, or one for each channel. */
static inline int terms_data_sets(const struct terms_data *data)
{
    return data->options.separate ? data->responses->channels : 1;
}

/* The two measurements of one number, the gain divided out, in the responses' scaled unit; NaN where not measured. */
struct terms_pair {
    double forth, back;
    double weight_forth, weight_back;
};

/* Of entry (u, v) of (x, y), which lies inside the sample. */
struct terms_pair terms_data_pair(const struct terms_data *data, int channel, int x, int y, int u,
                                  int v);

/* How many numbers a radial kernel has. */
int terms_radii(int window);

/* A kernel[K][K] of its numbers. */
void terms_grid_spread(const struct terms_grid *grid, const float *numbers, float *kernel);

#endif
