/* The measured responses in the working layout of the update kernels, scaled, with what was not measured masked.
 *
 * Neighbouring points of a row lie side by side, so that one vector holds the same entry of `lanes` responses:
 *
 *     values[channel]: lead | row (y, dy) = (0, 0) | (0, 1) | ... | (height-1, K-1) | lead | row of zeros | lead
 *     row (y, dy):     block 0 | block 1 | ... | block blocks-1       lanes points x each
 *     block:           dx = 0 | dx = 1 | ... | dx = K-1               window columns
 *     dx:              x = block * lanes + (0 | 1 | ... | lanes-1)    one aligned vector
 *
 * where (dx, dy) = (u, v) of scan.h. The leads and the row of zeros let the kernels read beyond a row's ends and beyond
 * the window without tests. */
#ifndef FACTOR_RESPONSES_H
#define FACTOR_RESPONSES_H

#include "nacre/scan.h"

#include "base/progress.h"

#include <stdbool.h>

#include <stdint.h>

enum { RESPONSES_CHANNELS = 3, RESPONSES_LANES = 16 };

struct responses {
    int width, height, channels, window;
    int lanes;       /* a power of two, at most RESPONSES_LANES */
    int blocks;      /* of `lanes` points in a row of points */
    size_t row;      /* floats of one row (y, dy) */
    size_t lead;     /* floats before the first row, a multiple of lanes */
    size_t size;     /* floats of one channel, with leads and zeros */
    size_t zeros;    /* index of the row of zeros */
    bool half;       /* values are stored as half floats */
    int mask_needed; /* some entry inside the sample was not measured */
    int negative;    /* some measured entry is below zero */
    float *values[RESPONSES_CHANNELS];
    uint16_t *mask
        [RESPONSES_CHANNELS]; /* one bit a lane, index = that of the vector in values: 1 = measured */
    int exponent[RESPONSES_CHANNELS]; /* values = responses * 2^-exponent, at most 1 in magnitude */
    uint8_t *measured;                /* [height][width]: some entry of the point was measured */
    size_t measured_count;
};

/* Bytes that responses of this size will take, or SIZE_MAX where that is no number. */
size_t responses_bytes(const struct nacre_scan_info *info, int lanes);

/* Make room for responses, none of them measured yet. Belongs to the caller, who calls responses_finish. */
int responses_begin(struct responses *responses, const struct nacre_scan_info *info, int lanes,
                    struct nacre_error *error);

/* Put the response of (x, y): response[channels][K][K], NaN or infinity where not measured. Several threads may put
 * points of different y. */
void responses_put(struct responses *responses, int x, int y, const float *response);

/* After the last put: scale each channel by a power of two so that its largest magnitude is in (0.5, 1]. */
void responses_scale(struct responses *responses);

/* All of the above for an open scan. Refuses, naming both figures, what does not fit the memory that is free. */
int responses_load(struct responses *responses, const struct nacre_scan *scan, int lanes,
                   struct progress *progress, struct nacre_error *error);

/* One channel of the response of (x, y) in scaled units: window[K][K], NaN where not measured or outside the sample. */
void responses_get(const struct responses *responses, int channel, int x, int y, float *window);

/* Index into values of entry (u, v) of the response of (x, y), and whether it was measured inside the sample. */
size_t responses_index(const struct responses *responses, int x, int y, int u, int v);
int responses_is_measured(const struct responses *responses, int channel, size_t index);

void responses_finish(struct responses *responses); /* zeroed ones are allowed */

#endif
