/* Where the camera sees each surface point: homography and lens from the dots patterns. */
#ifndef RIG_DEVELOP_ALIGN_H
#define RIG_DEVELOP_ALIGN_H

#include "nacre/error.h"
#include "rig/develop/camera_map.h"
#include "rig/develop/dots.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A rectangle of lit projector pixels, right and bottom exclusive. */
struct drawn_dot {
    int left, top, right, bottom;
    bool
        cut; /* touches the edge of the region: may be part of a dot, and is seen against the dark */
};

/* One dots pattern: what was drawn, and what the camera saw of it. */
struct dots_view {
    struct drawn_dot *drawn;
    size_t drawn_count;
    struct dots seen;
};

enum { ALIGN_TILES = 3 };

struct align_report {
    size_t dots;     /* that should be seen */
    size_t matched;  /* that are, and count */
    size_t rejected; /* matched, but too far off to count */
    double rms_px;   /* distance in the camera between dots and where the map puts them */
    double map_px[ALIGN_TILES][ALIGN_TILES]; /* the same by ninths of the surface; NaN: no dot */
    enum lens_model lens;                    /* that the residuals called for */
    double lens_px;   /* the largest shift by the lens's distortion at the region's border */
    double worst_px;  /* the largest of those that count */
    char missed[256]; /* where dots are missing, see missed.h; empty where nearly all were found */
};

/* The dots of a pattern drawn for width x height projector pixels (levels[height][width], 0 dark); heap. */
int align_find_drawn(const uint8_t *levels, int width, int height, struct drawn_dot **drawn,
                     size_t *count, struct nacre_error *error);

/* Find the map from surface (width x height points) to camera.
 *
 * The corners of the lit area (see quad_find) give a first map for each of the eight ways in which the camera may be
 * turned or mirrored; it need only be right to half the distance between dots. Each is improved by matching every
 * drawn dot with the nearest one seen and fitting again. That way is taken under which the dots of all patterns lie
 * nearest; the patterns are shifted against each other, so only the right one fits them all. Where several fit
 * equally well (two shifts a period) the one that keeps the corners best is taken, and among equals the upright one.
 * Then all matches are fitted, those more than 4 robust deviations off are dropped, until none is. Radial distortion
 * about the frame's middle is taken in where it lessens the residuals far beyond chance, and its second term and centre
 * where they do. */
int align_dots(const struct dots_view *views, size_t count, const struct point corners[4],
               int width, int height, struct point middle, struct camera_map *map,
               struct align_report *report, struct nacre_error *error);

void dots_view_finish(struct dots_view *view);

#endif
