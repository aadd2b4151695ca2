/* The middle of a response. */
#include "factor/window.h"

#include <math.h>
#include <stdbool.h>

double window_cut(const struct window_cut *cut, int x, int y, const float *response, float *middle)
{
    int half = cut->from / 2, border = (cut->from - cut->to) / 2;
    double beyond = 0;
    for (int row = 0; row < cut->channels * cut->from; row++) {
        int v = row % cut->from, yo = y + v - half;
        bool is_inside = yo >= 0 && yo < cut->height;
        bool is_kept = v >= border && v < cut->from - border;
        for (int u = 0; u < cut->from; u++) {
            float value = *response++;
            int xo = x + u - half;
            if (is_kept && u >= border && u < cut->from - border) {
                *middle++ = value;
            } else if (is_inside && xo >= 0 && xo < cut->width && isfinite(value)) {
                beyond += (double)value * (double)value;
            }
        }
    }
    return beyond;
}
