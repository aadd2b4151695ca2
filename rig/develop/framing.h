/* What frames say for framing and focus, before anything is measured: the lit region, sharpness, a picture. */
#ifndef RIG_DEVELOP_FRAMING_H
#define RIG_DEVELOP_FRAMING_H

#include "base/picture.h"
#include "nacre/error.h"
#include "rig/bayer.h"
#include "rig/develop/homography.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Frames of one size, [height][width]. */
struct framing_frames {
    const uint16_t *black, *white; /* the projector all dark, all lit */
    const uint16_t *shown[2];      /* the pattern to look at, twice */
    int width, height, full_scale;
    enum bayer bayer;
};

struct framing_box {
    int left, top, width, height; /* raw pixels; all even, so that the order of colours stays */
};

struct framing {
    bool found;              /* the projector's picture stands out and is a quadrilateral */
    struct point corners[4]; /* of it, raw pixels; as quad_find has them */
    struct framing_box crop; /* what holds them, with a margin */
    double saturated;        /* share of the pattern's pixels at full scale */
    double
        focus; /* mean square of the slope a pixel over that of the deviation from the mean, inside the crop:
                     larger is sharper; noise has no part in it. NaN without contrast */
};

/* The margin around what is lit: pixels, and a share of its size. */
extern const int framing_margin_px;
extern const double framing_margin_share;

int framing_look(const struct framing_frames *frames, struct framing *framing,
                 struct nacre_error *error);

/* Where the region lies is known better: by a calibration. */
void framing_place(struct framing *framing, const struct point corners[4], int width, int height);

/* The pattern in colour, grey where the white frame is grey; the region's outline green, saturated pixels magenta. */
int framing_draw(const struct framing_frames *frames, const struct framing *framing,
                 struct picture *picture, struct nacre_error *error);

#endif
