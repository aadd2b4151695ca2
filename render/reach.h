/* Which light samples and squares of them each bundle of receivers takes, so that the error stays bounded. */
#ifndef RENDER_REACH_H
#define RENDER_REACH_H

#include "render/appearance.h"
#include "render/bundles.h"
#include "render/cells.h"
#include "render/receivers.h"

#include <stdbool.h>

enum { REACH_LANES = 16 };

/* 16 receivers or fewer, of one chart, that are close together. */
struct reach_bundle {
    struct bundle_box box;
    float centre[3], normal[3], radius_mm;
    float
        apart; /* no receiver's normal is farther from `normal`, as the length of the difference */
    float flat_mm;                      /* none is farther from the plane through the centre */
    float low_x, high_x, low_y, high_y; /* in the texture */
    float scale;                        /* the least that a frame makes of a length */
    int32_t chart;
    uint32_t begin, end; /* in reach.order */
};

struct reach {
    size_t bundle_count;
    struct reach_bundle *bundles;
    uint32_t *order;         /* receivers by bundle */
    uint32_t *point_starts;  /* [bundle_count + 1] into points */
    uint32_t *points;        /* of cells.points */
    uint32_t *square_starts; /* [bundle_count + 1] into squares */
    uint32_t *squares;       /* of cells.moments */
    double
        *bounds; /* [bundle_count]: of what summing up costs a receiver at most, times point_mm^2 */
};

/* A node is taken as a whole where the bound of its error is at most `allowed`; with 0 every sample stands by itself. */
int reach_make(struct reach *reach, const struct receivers *receivers, const struct cells *cells,
               const struct appearance *appearance, double point_mm, bool same_side, double allowed,
               struct nacre_error *error);
void reach_finish(struct reach *reach);

#endif
