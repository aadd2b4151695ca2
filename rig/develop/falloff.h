/* The projector's fall-off, told from the camera's vignetting by the reciprocity of the sample.
 *
 * White frames show V(x_o) E(x_o), camera vignetting times projector fall-off. Dividing by them leaves
 * R_d(x_i, x_o) E(x_i) / E(x_o), as E acts where light enters. Light that takes a path through the sample can take it
 * backwards: R_d(x_i, x_o) = R_d(x_o, x_i). What is not alike in the two is (E(x_i) / E(x_o))^2, in which V has no part.
 * log E is a polynomial of degree 4 in x and y, found by linear least squares over pairs of points. */
#ifndef RIG_DEVELOP_FALLOFF_H
#define RIG_DEVELOP_FALLOFF_H

#include "nacre/error.h"
#include "nacre/scan.h"

#include <stdbool.h>
#include <stddef.h>

/* Pairs lie 2 or 3 points apart in x or in y: next neighbours share camera pixels. */
enum { FALLOFF_NEAREST = 2, FALLOFF_REACH = 3, FALLOFF_TERMS = 14 };

/* What the pairs are made of. Zero-initialised it is empty; falloff_pairs_finish frees. */
struct falloff_pairs {
    int width, height;
    float *near; /* [height][width][2 * FALLOFF_REACH + 1][2 * FALLOFF_REACH + 1], sum of channels;
                    NaN where not measured */
};

/* The projector's light over the region. Zero-initialised it is empty; falloff_finish frees. */
struct falloff {
    int width, height;
    float *light; /* [height][width]: E relative to the middle */
    size_t pairs; /* it was found from; 0: not found, and even */
    double range; /* largest E over smallest in the region, less 1 */
    double doubt; /* standard error of log E between middle and corner, from the pairs' scatter */
};

int falloff_pairs_init(struct falloff_pairs *pairs, int width, int height,
                       struct nacre_error *error);
void falloff_pairs_finish(struct falloff_pairs *pairs);

/* Take note of the response[channels][K][K] of (x, y), divided by white. */
void falloff_pairs_add(struct falloff_pairs *pairs, const struct nacre_scan_info *info, int x,
                       int y, const float *response);

/* Find E. Where there are no pairs, or they do not tell it, E is even. */
int falloff_find(const struct falloff_pairs *pairs, struct falloff *falloff,
                 struct nacre_error *error);

void falloff_finish(struct falloff *falloff);

/* Make the response of (x, y) one of light that entered evenly: times E(x_o) / E(x_i). */
void falloff_apply(const struct falloff *falloff, const struct nacre_scan_info *info, int x, int y,
                   float *response);

#endif
