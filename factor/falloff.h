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

/* f(r) of one window[K][K], NaN where not measured: radii[(K-1)/2 + 1], NaN where nothing was. */
void features_of_window(const float *window, int size, float *radii);

void features_finish(struct features *features);

#endif
