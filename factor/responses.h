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

/* How entries are stored. */
enum responses_store {
    RESPONSES_AUTO, /* as the scan's file has them */
    RESPONSES_FLOAT,
    RESPONSES_HALF /* half floats: 11 bits, over 29 binades below the channel's largest value */
};

struct responses {
    int width, height, channels, window;
    int lanes;    /* a power of two, at most RESPONSES_LANES */
    int blocks;   /* of `lanes` points in a row of points */
    size_t row;   /* values of one row (y, dy) */
    size_t lead;  /* values before the first row, a multiple of lanes */
    size_t size;  /* values of one channel, with leads and zeros */
    size_t zeros; /* index of the row of zeros */
    bool half;    /* which of the next two arrays holds them */
    float *values[RESPONSES_CHANNELS];
    uint16_t *halves[RESPONSES_CHANNELS];
    int mask_needed; /* some entry inside the sample was not measured */
    int negative;    /* some measured entry is below zero */
    uint16_t
        *mask[RESPONSES_CHANNELS]; /* where needed, else NULL: one bit a lane, index = that of the
                                         * vector in values: 1 = measured inside the sample */
    int exponent
        [RESPONSES_CHANNELS]; /* values = responses * 2^-exponent; in magnitude at most 1, as half
                                         * floats 2^15 */
    uint8_t *measured;        /* [height][width]: some entry of the point was measured */
    size_t measured_count;
    double *
        beyond; /* [height][width]: squares of what the scan's larger window had measured beside this one, in its own
                     * unit; NULL where the windows are the same */
    struct responses_point *points; /* until they are scaled: [height][width] */
};

/* Bytes that responses of this size will take, or SIZE_MAX where that is no number. */
size_t responses_bytes(const struct nacre_scan_info *info, int lanes, bool half);

/* Bytes that the kernel says programs may still take; SIZE_MAX where it does not say. */
size_t responses_free_bytes(void);

/* Make room for responses, none of them measured yet. Belongs to the caller, who calls responses_finish. */
int responses_begin(struct responses *responses, const struct nacre_scan_info *info, int lanes,
                    bool half, struct nacre_error *error);

/* Put the response of (x, y), each point at most once: response[channels][K][K], NaN or infinity where not measured.
 * Several threads may put points of different y. */
void responses_put(struct responses *responses, int x, int y, const float *response);

/* After the last put: scale each channel by a power of two so that its largest magnitude is in (0.5, 1], as half floats
 * in (2^14, 2^15]. Only now may the functions below be called. */
void responses_scale(struct responses *responses);

/* All of the above for an open scan, with the middle `window` x `window` entries of each response (0: all). Refuses, naming
 * both figures, what does not fit the memory that is free. */
int responses_load(struct responses *responses, const struct nacre_scan *scan, int window,
                   int lanes, enum responses_store store, struct progress *progress,
                   struct nacre_error *error);

/* The same responses in a smaller window, made without reading the scan again. */
int responses_shrink(struct responses *responses, const struct responses *from, int window,
                     struct nacre_error *error);

/* One entry in scaled units, NaN where not measured; of one outside the sample 0 or NaN. */
float responses_value(const struct responses *responses, int channel, int x, int y, int u, int v);

/* One channel of the response of (x, y) in scaled units: window[K][K], NaN where not measured or outside the sample. */
void responses_get(const struct responses *responses, int channel, int x, int y, float *window);

/* Row v of that: K values. */
void responses_get_row(const struct responses *responses, int channel, int x, int y, int v,
                       float *row);

/* The response of (x, y) in its own unit, response[channels][K][K], NaN where not measured or outside the sample. */
void responses_read(const struct responses *responses, int x, int y, float *response);

/* The sum of one channel of it in scaled units, NaN where nothing was measured. */
double responses_sum(const struct responses *responses, int channel, int x, int y);

/* Index into values or halves of entry (u, v) of the response of (x, y), and whether one inside the sample was
 * measured. */
size_t responses_index(const struct responses *responses, int x, int y, int u, int v);
int responses_is_measured(const struct responses *responses, int channel, size_t index);

void responses_finish(struct responses *responses); /* zeroed ones are allowed */

#endif
