/* The lit quadrilateral of a white frame: where in the camera's picture the projected region lies, roughly. */
#ifndef RIG_DEVELOP_QUAD_H
#define RIG_DEVELOP_QUAD_H

#include "nacre/error.h"
#include "rig/bayer.h"
#include "rig/develop/homography.h"

/* Corners of the largest lit area of white[height][width] (raw units a second, NaN where not measured), clockwise on
 * the screen beginning with the one nearest the upper left. Good to a pixel or two. Fails where nothing stands out
 * from the dark or what does is no quadrilateral. */
int quad_find(const float *white, int width, int height, enum bayer bayer, struct point corners[4],
              struct nacre_error *error);

#endif
