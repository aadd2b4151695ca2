/* Whether it pays to sum light up before it is gathered. */
#ifndef RENDER_GATHER_COST_H
#define RENDER_GATHER_COST_H

#include "render/gather.h"
#include "render/levels.h"
#include "render/reach.h"

#include <stdbool.h>

/* Estimated nanoseconds of one processor, by counts alone, so that the choice is the same every time. */
struct gather_cost {
    double plain, summed;
};

struct gather_cost gather_cost_of(const struct gather *gather, const struct receivers *receivers,
                                  const struct reach_bundles *bundles,
                                  const struct source_set *samples, const struct levels *levels);

#endif
