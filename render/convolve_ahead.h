/* What will be convolved, told ahead of light. */
#ifndef RENDER_CONVOLVE_AHEAD_H
#define RENDER_CONVOLVE_AHEAD_H

#include "render/convolve_cost.h"
#include "render/gather_cost.h"

struct convolve_ahead {
    double fits; /* vertices that places in the texture serve */
    bool chosen; /* they are convolved, the others gathered */
    double ns;   /* of both together, as chosen; without the gather's check */
};

/* For so many samples, and the gather's cost without. Materials without a kernel for each term have nothing that fits. */
int convolve_ahead(struct convolve_ahead *ahead, const struct mesh *mesh,
                   const struct mapping *mapping, const struct appearance *appearance,
                   bool same_side, double tolerance, double samples, struct gather_cost cost,
                   struct nacre_error *error);

#endif
