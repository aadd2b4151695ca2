/* How two frames of the same pattern differ: in brightness, by a shift, and beyond that. */
#ifndef RIG_FRAME_COMPARE_H
#define RIG_FRAME_COMPARE_H

#include <stddef.h>
#include <stdint.h>

/* Frames of one size, [height][width], of a sensor that saturates at full_scale. */
struct frame_pair {
    const uint16_t *before;
    const uint16_t *now, *again; /* two in succession of the same, which tell the noise */
    int width, height, full_scale;
};

struct frame_difference {
    double gain;     /* of now over before, of what differs from their means */
    double right_px; /* by which the picture moved, in raw pixels */
    double down_px;
    double worst_px; /* the largest shift of a ninth of the picture, which may have turned */
    double
        rest; /* RMS of what gain, shift and a constant leave, over the larger contrast; noise is taken off */
    double doubt;     /* `rest` may be noise where it is not above this */
    double contrast;  /* RMS of the larger contrast, raw units */
    double saturated; /* share of pixels left out: saturated in both */
};

/* Shifts are looked for up to this many pixels each way. */
enum { FRAME_SHIFT_MAX = 24 };

/* Fit the frame of less contrast as gain * (shifted other frame) + constant. The shift is found on whole periods of the
 * Bayer pattern by correlation, its rest by derivatives over four pixels, which take sharp edges for softer ones and what
 * is left of a shift for up to a quarter more than it is. Frames without contrast have gain 1, rest 0 and an
 * infinite doubt. */
struct frame_difference frame_compare(const struct frame_pair *pair);

/* Share of pixels at full scale. */
double frame_saturation(const uint16_t *raw, size_t pixels, int full_scale);

#endif
