/* What summing up by places has in common. */
#ifndef RENDER_SOURCES_PLACE_H
#define RENDER_SOURCES_PLACE_H

#include <math.h>
#include <stdint.h>

/* Light of one place in the texture is parted where its normals' mean is shorter than this; and where it is farther spread
 * in space than SOURCES_WIDEST sides of the square. */
#define SOURCES_STRAIGHTEST 0.85

static inline double sources_brightness(const float flux[3])
{
    return (double)flux[0] + (double)flux[1] + (double)flux[2];
}

/* The number of the cell in which a coordinate lies. */
static inline int32_t sources_cell(double x, double size)
{
    return (int32_t)fmin(fmax(floor(x / size), -1e9), 1e9);
}

#endif
