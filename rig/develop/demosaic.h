/* Full colour from a Bayer mosaic by linear filters (Malvar, He and Cutler, ICASSP 2004). */
#ifndef RIG_DEVELOP_DEMOSAIC_H
#define RIG_DEVELOP_DEMOSAIC_H

#include "rig/bayer.h"

/* Fill planes[3][height][width] from mosaic[height][width]; mosaic's three colours should be balanced (a grey shows
 * the same value in all), as the filters carry differences from one colour over to another. Beyond its borders the
 * mosaic is mirrored about the last pixel, which keeps the order of colours. NaN makes every value NaN whose filter
 * reaches it. Needs at least 3 x 3 pixels; `bayer` is not mono. */
void demosaic_malvar(const float *mosaic, int width, int height, enum bayer bayer, float *planes);

#endif
