/* The map from surface points to camera pixels: a homography, and the lens's radial distortion where it has one. */
#ifndef RIG_DEVELOP_CAMERA_MAP_H
#define RIG_DEVELOP_CAMERA_MAP_H

#include "nacre/error.h"
#include "rig/develop/homography.h"

#include <stddef.h>

/* A point that an ideal camera would see at distance r from the centre is seen at r (1 + k1 s + k2 s^2) in the same
 * direction, s = (r / unit)^2. */
struct lens {
    struct point centre;
    double unit; /* px; 0: no distortion */
    double k1, k2;
};

struct camera_map {
    struct homography plane; /* to the ideal camera */
    struct lens lens;
};

enum lens_model {
    LENS_IDEAL,
    LENS_RADIAL,  /* k1, about the middle of the frame */
    LENS_SHIFTED, /* k1, k2 and the centre */
};

/* Words in the order of the enum, NULL-terminated. */
extern const char *const lens_model_names[];

struct point camera_map_apply(const struct camera_map *map, struct point surface);

/* Where the ideal camera would see what this one sees at `seen`. */
struct point lens_undistort(const struct lens *lens, struct point seen);

/* Distance in the camera between a pair's point and where the map puts it, and the root mean square of that over the
 * pairs that are no outliers; NaN without any. */
double camera_map_distance(const struct camera_map *map, const struct point_pair *pair);
double camera_map_rms(const struct camera_map *map, const struct point_pair *pairs, size_t count);

/* Minimise the sum of squared distances over the pairs that are no outliers, starting from *map (Levenberg-Marquardt).
 * The model says what of the lens is free. map->lens.unit and centre are set. */
int camera_map_refine(const struct point_pair *pairs, size_t count, enum lens_model model,
                      struct camera_map *map, struct nacre_error *error);

#endif
