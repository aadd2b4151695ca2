/* Moments: for each basis kernel and term sum flux F U, of light and of the material itself. */
#ifndef RENDER_SOURCES_MOMENTS_H
#define RENDER_SOURCES_MOMENTS_H

#include "render/sources_lattice.h"

/* Hand the light of level `index`'s lattice to its nodes: sources->moments[index]. Returns 0, or -1 when memory ran out; so
 * do all below. */
int moments_sum(struct sources *sources, const struct appearance *appearance, int index,
                const struct lattice *lattice);

/* Means over squares of the material, at the border of what there is of them: sources->pyramid[index]. */
int moments_fill_pyramid(struct sources *sources, const struct appearance *appearance, int index);

#endif
