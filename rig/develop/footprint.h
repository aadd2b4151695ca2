/* Which surface points each camera pixel sees, and how much of its view each takes. */
#ifndef RIG_DEVELOP_FOOTPRINT_H
#define RIG_DEVELOP_FOOTPRINT_H

#include "nacre/error.h"
#include "rig/develop/camera_map.h"

#include <stddef.h>
#include <stdint.h>

/* Sparse rows: pixel i sees points[k] with share[k] for k from start[i] to start[i + 1]. Zero-initialised it is
 * empty; footprints_finish frees. */
struct footprints {
    size_t pixels;
    size_t *start;    /* [pixels + 1] */
    uint32_t *points; /* y * surface width + x */
    float *share;     /* of what the pixel sees of the sample: adds up to 1 */
    float *inside;    /* [pixels]: how much of the whole view is sample */
};

/* Map each of width x height camera pixels onto the surface of surface_width x surface_height points and intersect
 * with the points' squares. */
int footprints_init(struct footprints *footprints, const struct camera_map *surface_to_camera,
                    int width, int height, int surface_width, int surface_height,
                    struct nacre_error *error);
void footprints_finish(struct footprints *footprints);

#endif
