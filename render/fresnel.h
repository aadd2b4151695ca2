/* Light through a smooth boundary, by its angle: f_i and f_o of the paper, relative to light along the normal, by which
 * materials are measured. */
#ifndef RENDER_FRESNEL_H
#define RENDER_FRESNEL_H

#include <math.h>

/* Share of unpolarised light that a boundary to `index` mirrors, by the cosine of its angle outside. */
static inline double fresnel_mirrored(double index, double cosine)
{
    double inside = sqrt(1 - (1 - cosine * cosine) / (index * index));
    double s = (cosine - index * inside) / (cosine + index * inside);
    double p = (inside - index * cosine) / (inside + index * cosine);
    return (s * s + p * p) / 2;
}

/* 1 along the normal, 0 where light grazes; 1 at all angles without a boundary (index 1). */
static inline double fresnel_transmitted(double index, double cosine)
{
    double amplitude = (index - 1) / (index + 1);
    if (!(cosine > 0)) {
        return 0;
    }
    return (1 - fresnel_mirrored(index, fmin(cosine, 1))) / (1 - amplitude * amplitude);
}

#endif
