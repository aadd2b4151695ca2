/* Responses of large heterogeneous samples in closed form: what the benchmarks factor.
 *
 * The virtual station's solver takes minutes for a sample of the paper's size; this takes seconds, and is no easier to
 * factor: R(x_i, x_o) falls off as the dipole of a homogeneous medium would whose coefficients are the means along the
 * straight path from x_i to x_o, so that veins and borders between the points tell in each response differently, and a
 * product FH times one kernel cannot follow. tests/bench/describe.h compares it with path-traced samples. */
#ifndef TESTS_BENCH_FIELD_H
#define TESTS_BENCH_FIELD_H

#include "factor/responses.h"

#include "nacre/scan.h"

enum field_kind {
    FIELD_CANDLE, /* two waxes with soft and with sharp borders, pigment in fine lines */
    FIELD_MARBLE, /* a chessboard of 4 x 4 stones of four kinds, cloudy and veined, with joints */
    FIELD_KINDS
};

struct field {
    struct nacre_scan_info info;
    uint64_t seed;
    float (*media)
        [4]; /* [height][width]: attenuation of R, G, B and mean free path, 1/points and points */
    float (*transmission)[3]; /* [height][width]: of light that enters or leaves there */
    int *path_starts;         /* [K][K] + 1: where the path of each distance begins in path_steps */
    int *path_steps;          /* points between x_i and x_o, relative to x_i */
};

/* The field of a kind: the same for the same size and seed, up to the rounding of elementary functions. One channel is
 * the second of three. Ends the program without memory; field_finish frees it. */
struct field field_new(enum field_kind kind, int width, int height, int window, int channels,
                       uint64_t seed);
void field_finish(struct field *field);

/* The response of (x, y): response[channels][K][K], with about 0.6 % of noise. 0 outside the sample. */
void field_response(const struct field *field, int x, int y, float *response);

/* All of them in the working layout for `lanes`, as half floats or floats. Ends the program without memory;
 * responses_finish frees them. */
struct responses field_load(const struct field *field, int lanes, bool half);

/* All of them as a scan; takes the memory of a row of responses. Ends the program after an error. */
void field_write(const struct field *field, const char *path);

#endif
