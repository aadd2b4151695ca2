/* A lattice of nodes over the texture to which sources are handed out by bilinear weights. */
#ifndef RENDER_SOURCES_LATTICE_H
#define RENDER_SOURCES_LATTICE_H

#include "render/groups.h"
#include "render/sources.h"

enum { LATTICE_CORNERS = 4 };

struct lattice_node;

/* `from`, `size` (surface points between nodes) and `point_mm` are given, the rest is zero at first. */
struct lattice {
    const struct source_set *from;
    double size, point_mm;
    uint32_t *links;      /* [sources][LATTICE_CORNERS]: nodes */
    float *shares;        /* of each source's light, alike */
    struct groups groups; /* whose count is that of the nodes */
    struct lattice_node *nodes;
};

/* Make the nodes, also as sources at their places. Returns 0, or -1 when memory ran out; finish it in any case. */
int lattice_make(struct lattice *lattice, struct source_set *to);
void lattice_finish(struct lattice *lattice);

#endif
