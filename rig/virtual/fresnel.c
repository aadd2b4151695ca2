/* Fresnel reflection at a smooth boundary, and its means over directions. */
#include "rig/virtual/fresnel.h"

#include <math.h>

double fresnel_inside(double index, double cosine)
{
    double sine_outside = index * sqrt(fmax(0, 1 - cosine * cosine));
    if (sine_outside >= 1) {
        return 1;
    }
    double outside = sqrt(1 - sine_outside * sine_outside);
    double s = (index * cosine - outside) / (index * cosine + outside);
    double p = (cosine - index * outside) / (cosine + index * outside);
    return 0.5 * (s * s + p * p);
}

double fresnel_through_normal(double index)
{
    double amplitude = (index - 1) / (index + 1);
    return 1 - amplitude * amplitude;
}

double fresnel_boundary_a(double index)
{
    /* The midpoint rule; with the square-root kink at the critical angle it leaves about 1e-6. */
    enum { STEPS = 4096 };
    double first = 0;
    double second = 0;
    for (int i = 0; i < STEPS; i++) {
        double cosine = (i + 0.5) / STEPS;
        double reflected = fresnel_inside(index, cosine);
        first += reflected * cosine / STEPS;
        second += reflected * cosine * cosine / STEPS;
    }
    return (1 + 3 * second) / (1 - 2 * first);
}
