/* What gathers on one object find alike, whatever light falls on it, kept from one to the next: where light leaves, what is
 * close together, F by terms, and the level parts of the surface. */
#ifndef RENDER_GATHER_SURFACE_H
#define RENDER_GATHER_SURFACE_H

#include "render/convolve_patches.h"
#include "render/reach.h"
#include "render/receivers.h"

#include <stdbool.h>

/* Zero-initialised it is empty, and filled when first asked for. */
struct gather_surface {
    struct receivers receivers;
    struct reach_bundles bundles; /* of the receivers */
    float *factors;               /* F: [height][width][terms][4] */
    struct convolve_patches patches;
    bool made, surveyed; /* all but the patches; the patches */
};

/* Fill all but the patches; and the patches, which needs the rest. What is there is left as it is: mesh, mapping and
 * appearance must be those of the first time. */
int gather_surface_make(struct gather_surface *surface, const struct mesh *mesh,
                        const struct mapping *mapping, const struct appearance *appearance,
                        struct nacre_error *error);
int gather_surface_survey(struct gather_surface *surface, const struct mesh *mesh,
                          const struct mapping *mapping, const struct appearance *appearance,
                          bool same_side, struct nacre_error *error);
void gather_surface_finish(struct gather_surface *surface);

/* from[planes][terms] to to[terms][4], planes being 1 or 3. */
void gather_by_terms(const float *from, size_t planes, size_t terms, float *to);

#endif
