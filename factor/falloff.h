/* What responses are clustered by: how each falls off with distance, whatever its albedo (paper, section 5.4). */
#ifndef FACTOR_FALLOFF_H
#define FACTOR_FALLOFF_H

#include "factor/responses.h"

struct features {
    size_t count;   /* measured points */
    size_t length;  /* channels x radii; radii are 0 ... (K-1)/2 points */
    size_t *points; /* [count]: y * width + x */
    float *values;  /* [count][length] */
};

/* f(r) = max over the angle of R(x_i, p(angle, r)), bilinear in the window, each channel divided by its Euclidean norm
 * and all channels behind one another, so that they are clustered together. A radius of which nothing was measured
 * inside the sample takes the mean of the other points. */
int features_new(const struct responses *responses, struct features *features,
                 struct nacre_error *error);

/* The places on circles around the middle of a window of size x size at which f(r) looks. circles_free it. */
struct circles;
int circles_new(int size, struct circles **circles, struct nacre_error *error);
void circles_free(struct circles *circles); /* NULL is allowed */

/* f(r) of one window[K][K], NaN where not measured: radii[(K-1)/2 + 1], NaN where nothing was. */
void features_of_window(const struct circles *circles, const float *window, float *radii);

void features_finish(struct features *features);

#endif
