/* Whether it pays to sum light up before it is gathered. */
#ifndef RENDER_GATHER_COST_H
#define RENDER_GATHER_COST_H

#include "render/gather_stock.h"

/* Estimated nanoseconds of one processor, by counts alone, so that the choice is the same every time. */
struct gather_cost {
    double plain, summed;
};

struct gather_cost gather_cost_of(const struct gather_stock *stock, const struct levels *levels);

/* The same ahead of light and stock: `samples` spread evenly over a level surface of so many surface points. */
struct gather_cost gather_cost_ahead(const struct appearance *appearance,
                                     const struct levels *levels, double vertices, double samples,
                                     double points);

#endif
