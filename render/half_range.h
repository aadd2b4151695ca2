/* Keeping POV-Ray's pictures within what its half floats hold. */
#ifndef RENDER_HALF_RANGE_H
#define RENDER_HALF_RANGE_H

#include "render/stage.h"

/* The power of two by which the exposure is multiplied for POV-Ray, and its picture divided again: 1 where the largest
 * values are neither near 65504 nor so small that they lose digits. The stage was baked. */
double half_range_scale(const struct stage *stage);

#endif
