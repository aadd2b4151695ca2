/* How far one scan is from another of the same sample: a developed one from exact responses. */
#ifndef STUDY_DIFFERENCE_H
#define STUDY_DIFFERENCE_H

#include "nacre/error.h"
#include "nacre/scan.h"

#include <stddef.h>

/* Over the points that both have measured and that `exact` has not as 0. */
struct scan_difference {
    size_t points, left_out;
    double least, mean,
        greatest; /* of ||other - exact|| / ||exact||, all channels, entries both have */
    double bias;  /* mean of (sum other / sum exact - 1) */
};

/* Fails where size, window or channels differ. */
int scan_difference(const struct nacre_scan *exact, const struct nacre_scan *other,
                    struct scan_difference *difference, struct nacre_error *error);

#endif
