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
    enum { STEPS = 1024 };
    /* Below the critical angle's cosine all is reflected; above it R begins like a square root, which is smooth in the
     * root t of the way to 1. */
    double critical = sqrt(1 - 1 / (index * index));
    double first = critical * critical / 2;
    double second = critical * critical * critical / 3;
    for (int i = 0; i < STEPS; i++) {
        double t = (i + 0.5) / STEPS;
        double cosine = critical + (1 - critical) * t * t;
        double reflected = fresnel_inside(index, cosine) * (1 - critical) * 2 * t / STEPS;
        first += reflected * cosine;
        second += reflected * cosine * cosine;
    }
    return (1 + 3 * second) / (1 - 2 * first);
}
