/* Parts of a surface on which the material lies true to scale and in one piece: what reaches a vertex there hangs on places
 * in the texture alone.
 *
 * A patch's triangles hang together in the texture and lie there as in space, but for a factor below 1.4 along each edge.
 * How well a vertex is served by its place in the texture is its misfit: by how much the offsets of all that is around it
 * in space, as the gather takes them, change what it would get under even light. */
#ifndef RENDER_CONVOLVE_PATCHES_H
#define RENDER_CONVOLVE_PATCHES_H

#include "render/receivers.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { CONVOLVE_PATCHES = 16 };

struct convolve_patch {
    int32_t chart;
    int x, y, width, height; /* box around it in the texture, unwrapped, whole surface points */
    size_t receivers;
    int cell, columns, rows; /* side of a cell (surface points) and number of them */
    uint32_t *places;        /* [rows][columns]: a receiver in the cell, or CONVOLVE_NONE */
};

#define CONVOLVE_NONE UINT32_MAX

struct convolve_patches {
    size_t count;
    struct convolve_patch list[CONVOLVE_PATCHES];
    int16_t *of;   /* [receivers]: its patch, or -1 */
    float *misfit; /* [receivers]: share; HUGE_VALF outside patches */
};

int convolve_patches_make(struct convolve_patches *patches, const struct mesh *mesh,
                          const struct mapping *mapping, const struct appearance *appearance,
                          const struct receivers *receivers, bool same_side,
                          struct nacre_error *error);
int convolve_patches_copy(struct convolve_patches *copy, const struct convolve_patches *patches,
                          size_t receivers, struct nacre_error *error);
void convolve_patches_finish(struct convolve_patches *patches);

/* Which patch light at a place of the texture and of space falls on, or -1. The surface's normal there tells the two sides of
 * something thin apart. */
int convolve_patch_at(const struct convolve_patches *patches, const struct receiver *receivers,
                      int32_t chart, double x, double y, const float position[3],
                      const float normal[3], double point_mm);

/* The receiver that stands for the cell in which a receiver of the patch lies: the first in it. */
uint32_t convolve_place(const struct convolve_patch *patch, const struct receiver *receiver);

/* Work out the misfits of the receivers in patches; areas[receivers] in mm^2. Returns 0, or -1 when memory ran out. */
int convolve_misfit(struct convolve_patches *patches, const struct mapping *mapping,
                    const struct appearance *appearance, const struct receivers *receivers,
                    const float *areas, bool same_side);

#endif
