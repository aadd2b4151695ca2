/* Samples to factor: exponential fall-offs of two materials, a vein that blocks light, noise. Made from a seed. */
#ifndef TESTS_FACTOR_SAMPLE_H
#define TESTS_FACTOR_SAMPLE_H

#include "factor/method.h"

struct sample {
    int width, height, channels, window;
    float *responses; /* [height][width][channels][K][K] */
};

/* Two materials on a chessboard of 5 x 5 points, a dark vein along the diagonal, 1 % noise. Entries outside the sample
 * are 0. sample_finish frees it. */
struct sample sample_new(int width, int height, int channels, int window, uint64_t seed);
void sample_finish(struct sample *sample);

/* The response of (x, y): [channels][K][K]. */
float *sample_at(const struct sample *sample, int x, int y);

/* Multiply everything by `factor`. */
void sample_scale(struct sample *sample, float factor);

/* Make holes of NaN: single entries, whole responses, a row of points, one channel of a point. */
void sample_punch_holes(struct sample *sample);

/* Load and scale it, as floats or as half floats. Ends the test where that fails. */
struct responses sample_load(const struct sample *sample, int lanes);
struct responses sample_load_half(const struct sample *sample, int lanes);

#endif
