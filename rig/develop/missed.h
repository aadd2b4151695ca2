/* Which dots were not found where they should be: words for an error. */
#ifndef RIG_DEVELOP_MISSED_H
#define RIG_DEVELOP_MISSED_H

#include "rig/develop/align.h"

#include <stddef.h>

/* Into text[size]: the dots pattern with the largest share of dots missing, and, where `map` is not NULL, the ninth of
 * the surface (width x height) with the largest: "dots pattern 4 shows 0 of 13, and in the upper left 2 of 14 were
 * found over all patterns". A dot is found where one was seen within 0.45 of `spacing`; without a map all that were
 * seen count. */
void missed_describe(const struct dots_view *views, size_t count, const struct camera_map *map,
                     double spacing, int width, int height, char *text, size_t size);

#endif
