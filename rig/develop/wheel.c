/* What a colour wheel does to exposures that are no whole number of its turns. */
#include "rig/develop/wheel.h"

#include <math.h>

/* Lit in the turn's first third; the integral of that from 0 to `turns`. */
static double lit_until(double turns)
{
    double whole = floor(turns);
    return whole / 3 + fmin(turns - whole, 1.0 / 3);
}

double wheel_colour_error(double turns)
{
    enum { PHASES = 3600 };
    double square = 0;
    double expected = turns / 3;
    for (int k = 0; k < PHASES; k++) {
        double begin = (k + 0.5) / PHASES;
        double off = lit_until(begin + turns) - lit_until(begin) - expected;
        square += off * off / PHASES;
    }
    return sqrt(square) / expected;
}
