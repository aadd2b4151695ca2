/* Finding the projected dots in a frame, to a small part of a pixel. */
#ifndef RIG_DEVELOP_DOTS_H
#define RIG_DEVELOP_DOTS_H

#include "nacre/error.h"
#include "rig/develop/homography.h"

#include <stddef.h>

/* Dots of one frame, in the order in which their first pixels come. Zero-initialised it is empty. */
struct dots {
    struct point *centres;
    size_t count;
};

/* Find the dots in lit[height][width], the frame divided by the white frame: the share of each pixel's view that is
 * lit, whatever the pixel's colour, vignetting or gain; NaN where the white frame is dark or the pixel defect: gaps of
 * one or two pixels are bridged. `share` is the part of the
 * picture that dots cover, about. Centres are centroids of the lit share over the dot and a margin, the local
 * background taken off. Dots at the frame's or the lit area's edge and blots of another size are left out. */
int dots_find(const float *lit, int width, int height, double share, struct dots *dots,
              struct nacre_error *error);
void dots_finish(struct dots *dots);

#endif
