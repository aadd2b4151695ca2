/* The plane-to-plane map between surface points and camera pixels, and finding it from pairs of points.
 *
 * Coordinates are continuous: pixel or surface point (i, j) covers i..i+1 by j..j+1. */
#ifndef RIG_DEVELOP_HOMOGRAPHY_H
#define RIG_DEVELOP_HOMOGRAPHY_H

#include "nacre/error.h"

#include <stdbool.h>
#include <stddef.h>

struct point {
    double x, y;
};

/* (x, y) goes to (m0 x + m1 y + m2, m3 x + m4 y + m5) / (m6 x + m7 y + m8). */
struct homography {
    double m[9];
};

/* A point of the surface, where the camera saw it, and whether it counts. */
struct point_pair {
    struct point surface, camera;
    bool outlier;
};

struct point homography_apply(const struct homography *homography, struct point point);

/* False where the map is singular. */
bool homography_invert(const struct homography *homography, struct homography *inverse);

/* Surface to camera from at least 4 pairs that are no outliers, by the normalised direct linear transform (SVD).
 * Fails where they lie on a line. */
int homography_fit(const struct point_pair *pairs, size_t count, struct homography *homography,
                   struct nacre_error *error);

/* Minimise the sum of squared distances in the camera over the pairs that are no outliers (Levenberg-Marquardt),
 * starting from *homography. */
int homography_refine(const struct point_pair *pairs, size_t count, struct homography *homography,
                      struct nacre_error *error);

/* Distance in the camera between a pair's point and where the map puts it. */
double homography_distance(const struct homography *homography, const struct point_pair *pair);

/* Root mean square of that over the pairs that are no outliers; NaN without any. */
double homography_rms(const struct homography *homography, const struct point_pair *pairs,
                      size_t count);

#endif
