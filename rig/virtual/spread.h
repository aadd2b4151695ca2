/* What keeps the projector's picture from being sharp: defocus. */
#ifndef RIG_VIRTUAL_SPREAD_H
#define RIG_VIRTUAL_SPREAD_H

#include "nacre/error.h"

/* What a projector pixel out of focus sends to the points around it. Zero-initialised it is empty. */
struct spread {
    int radius;
    float *weights; /* [2 radius + 1][2 radius + 1], sum 1 */
};

/* A pixel's square, each place of which is spread evenly over a disc of that diameter. */
int spread_init(double diameter_points, struct spread *spread, struct nacre_error *error);
void spread_finish(struct spread *spread);

/* Light in[height][width] spread into out; what falls beyond the picture is lost. */
void spread_apply(const struct spread *spread, int width, int height, const float *in, float *out);

#endif
