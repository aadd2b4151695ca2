/* The responses of a grid pattern's lit points, cut out of its picture of the surface. */
#ifndef RIG_DEVELOP_EXTRACT_H
#define RIG_DEVELOP_EXTRACT_H

#include "nacre/error.h"
#include "nacre/scan.h"

#include <stddef.h>

enum { EXTRACT_RINGS = 256 };

/* What was extracted so far; zero-initialised it is empty. */
struct extract_sums {
    size_t responses;
    size_t entries, missing; /* inside the sample; of them NaN */
    double centre;           /* sum of the lit points' own entries, NaN left out */
    double rings
        [EXTRACT_RINGS]; /* sum of all entries at each chessboard distance from the lit point, for responses
                                    whose window lies inside the sample; the last ring takes those beyond */
};

/* Cut the K x K window around lit point (x, y) out of reflected[channels][height][width] of info's size into
 * response[channels][K][K]. Entries outside the sample become 0. */
void extract_window(const struct nacre_scan_info *info, const float *reflected, int x, int y,
                    float *response);

/* Add the response of (x, y) to what was extracted so far. */
void extract_add(const struct nacre_scan_info *info, int x, int y, const float *response,
                 struct extract_sums *sums);

/* Share of a response's energy that falls outside the window and, where windows touch, into those of the neighbours:
 * the rings' sums continued at the rate at which the outer half of them falls. NaN where no window was whole, 1 where
 * they do not fall. */
double extract_overlap(const struct extract_sums *sums, int window);

/* Share of the energy of whole windows that lies on their rim. */
double extract_rim_share(const struct extract_sums *sums, int window);

#endif
