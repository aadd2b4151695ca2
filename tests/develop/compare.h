/* How far a scan developed from a made session is from the exact responses. */
#ifndef TESTS_DEVELOP_COMPARE_H
#define TESTS_DEVELOP_COMPARE_H

#include "made.h"

#include <stddef.h>

struct comparison {
    double error;   /* mean over the points of ||developed - exact|| / ||exact|| */
    double far_rms; /* of entries in the corners of windows, where nothing arrives */
    double bias;    /* mean of (sum developed / sum exact - 1) */
    size_t missing; /* points without a response */
};

struct comparison made_compare(const struct made_station *station, const char *scan_path);

#endif
