/* What pixels of a camera out of focus see. */
#ifndef RIG_DEVELOP_BLUR_H
#define RIG_DEVELOP_BLUR_H

#include "rig/develop/footprint.h"

/* The widest blur there is. */
#define BLUR_MOST 2.0

/* Make the footprints of a sharp camera of width pixels across those of one whose lens spreads light over neighbouring
 * pixels with this deviation in x and in y, 0 to BLUR_MOST. */
int blur_footprints(struct footprints *footprints, int width, double pixels,
                    struct nacre_error *error);

/* The share of light that goes `offset` pixels aside in x or in y, with that deviation: weights[0 ... 2 reach], the
 * middle one being that of no offset; returns the reach. */
enum { BLUR_REACH = 16 };
int blur_weights(double pixels, double weights[2 * BLUR_REACH + 1]);

#endif
