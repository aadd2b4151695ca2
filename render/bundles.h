/* Points in space in runs that lie close together: receivers and light samples that are treated alike. */
#ifndef RENDER_BUNDLES_H
#define RENDER_BUNDLES_H

#include <stddef.h>
#include <stdint.h>

struct bundle_box {
    float low[3], high[3];
};

/* Reorder indices along a curve that fills space, so that runs of them are compact. positions[index * stride] begins a
 * point. Returns 0, or -1 when memory ran out. */
int bundles_order(const float *positions, size_t stride, uint32_t *order, size_t count);

/* The box of some of the points; with no order, of the first. */
struct bundle_box bundles_box(const float *positions, size_t stride, const uint32_t *order,
                              size_t count);

/* The distance between two boxes; 0 where they meet. */
double bundles_gap(const struct bundle_box *a, const struct bundle_box *b);

#endif
