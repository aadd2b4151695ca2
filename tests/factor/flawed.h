/* A reciprocal sample of slowly varying albedo, and what a station may spoil of it. */
#ifndef TESTS_FACTOR_FLAWED_H
#define TESTS_FACTOR_FLAWED_H

#include "sample.h"

struct flaws {
    double noise;          /* standard deviation */
    double gain;           /* of the points' own brightness as x_o alone, from side to side */
    double peak_x, peak_y; /* off the centre */
    double length;         /* of the fall-off */
    double ceiling;        /* values above saturate */
};

/* One channel. The caller calls sample_finish. */
struct sample flawed_sample(int width, int height, int window, struct flaws flaws);

#endif
