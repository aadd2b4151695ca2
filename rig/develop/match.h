/* Pairing the dots that were drawn with those that were seen. */
#ifndef RIG_DEVELOP_MATCH_H
#define RIG_DEVELOP_MATCH_H

#include "rig/develop/align.h"

/* The smallest distance in the drawing between the first dot and another, over all patterns. */
double match_dot_spacing(const struct dots_view *views, size_t count);

/* Pair every whole drawn dot with the nearest seen one within reach under the map. What perspective does to a
 * dot's centroid is taken off the camera's point, so that pairs obey a plain map of points. `pairs` holds one per
 * drawn dot. Writes the sum of squared distances with misses counted as the reach. */
size_t match_dots(const struct dots_view *views, size_t count, double spacing,
                  const struct camera_map *map, struct point_pair *pairs, double *cost);

#endif
