/* The samples that representations are compared on: scans, and simulated slabs with noise of a known size. */
#ifndef TESTS_BENCH_REPRESENTATIONS_SAMPLE_H
#define TESTS_BENCH_REPRESENTATIONS_SAMPLE_H

#include "factor/responses.h"

#include <stdbool.h>

enum { SAMPLE_ALL = 1 << 20 };

struct sample {
    char name[64];
    double pitch_mm;
    int width, height, channels, window;
    struct responses responses; /* as measured, which is what is fitted */
    float *measured;            /* the same, [height][width][channels][K][K]; NaN where not known */
    float
        *exact; /* the same without noise, or NULL where nobody knows: judge by reciprocal pairs */
    struct responses kept; /* one of each reciprocal pair; empty where `exact` is known */
    float *kept_measured;  /* the same as `measured` */
};

/* A scan as it is, of larger ones the middle `limit` points a side: what its noise hides is judged by reciprocal pairs.
 * Lanes are those of the device that factors it. Ends the program where it cannot be read. sample_finish. */
void sample_read(const char *path, int lanes, int limit, struct sample *sample);

/* Simulate the described slab with the program `nacre` and add noise as of counting, of 0.6 % of each response's norm on
 * average. Channels that are all alike count once. */
void sample_simulate(const char *nacre, const char *path, int lanes, int limit,
                     struct sample *sample);

/* Numbers of one response, and of all of them. */
size_t sample_response_size(const struct sample *sample);
size_t sample_size(const struct sample *sample);

void sample_finish(struct sample *sample);

#endif
