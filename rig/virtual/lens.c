/* Brown's radial distortion and its inverse; places in a pixel. */
#include "rig/virtual/lens.h"

#include <math.h>

static const double PI = 3.14159265358979323846;

void lens_places_sharp(struct lens_places *places)
{
    enum { SIDE = 8 };
    places->count = LENS_SHARP;
    for (int i = 0; i < LENS_SHARP; i++) {
        places->u[i] = ((i % SIDE) + 0.5) / SIDE;
        places->v[i] = ((i / SIDE) + 0.5) / SIDE; // NOLINT(bugprone-integer-division): the row
    }
}

/* The fraction of i steps along an axis of Kronecker's sequence. */
static double part(int i, double step)
{
    double value = 0.5 + i * step;
    return value - floor(value);
}

void lens_places_defocused(double diameter_px, struct lens_places *places)
{
    /* The root of x^5 = x + 1, whose powers spread points evenly in four dimensions (Roberts 2018): two for the pixel's
     * square, two for the disc. */
    const double root = 1.1673039782614187;
    places->count = LENS_DEFOCUSED;
    for (int i = 0; i < LENS_DEFOCUSED; i++) {
        double radius = 0.5 * diameter_px * sqrt(part(i, pow(root, -3)));
        double angle = 2 * PI * part(i, pow(root, -4));
        places->u[i] = part(i, pow(root, -1)) + radius * cos(angle);
        places->v[i] = part(i, pow(root, -2)) + radius * sin(angle);
    }
}

static double distorted(const double k[2], double r)
{
    return r * (1 + r * r * (k[0] + r * r * k[1]));
}

static double slope(const double k[2], double r)
{
    return 1 + r * r * (3 * k[0] + 5 * r * r * k[1]);
}

bool lens_distortion_is_sound(const double k[2], double reach)
{
    enum { STEPS = 200 };
    for (int i = 0; i <= STEPS; i++) {
        double r = 2 * reach * i / STEPS;
        if (slope(k, r) <= 0.05) {
            return false;
        }
        if (distorted(k, r) >= reach) {
            return true;
        }
    }
    return false;
}

/* The radius that is seen at `seen`. */
static double undistorted(const double k[2], double seen)
{
    enum { STEPS = 60 };
    const double step = 0.02 * seen;
    double low = 0;
    double high = seen;
    while (distorted(k, high) < seen && high < 2 * seen) {
        low = high;
        high += step;
    }
    double r = high;
    for (int i = 0; i < STEPS; i++) {
        double off = distorted(k, r) - seen;
        double before = r;
        low = off < 0 ? r : low;
        high = off < 0 ? high : r;
        /* Newton's step, or half of the way where that would leave what is known to enclose the radius. */
        r -= off / slope(k, r);
        r = r >= low && r <= high ? r : 0.5 * (low + high);
        if (fabs(r - before) <= 1e-15 * seen) {
            break;
        }
    }
    return r;
}

void lens_straighten(const double k[2], int width, int height, double *u, double *v)
{
    double dx = *u - 0.5 * width;
    double dy = *v - 0.5 * height;
    double corner = 0.5 * hypot(width, height);
    double seen = hypot(dx, dy) / corner;
    if (seen > 0) {
        double r = undistorted(k, seen);
        *u = 0.5 * width + dx * r / seen;
        *v = 0.5 * height + dy * r / seen;
    }
}
