/* The pitch of a station's surface points by a target of known size: a lattice of dots that lay where the sample lies.
 *
 * The target's session is one like any other, of a plan with grid_spacing 1: its only grid lights every point, and its
 * calibration frames say where the camera sees them. The dots' centres, found in camera pixels, go through the map from
 * camera to surface points; a second homography, from the lattice to these, then holds points per mm. */
#ifndef RIG_DEVELOP_TARGET_H
#define RIG_DEVELOP_TARGET_H

#include "base/progress.h"
#include "nacre/error.h"

#include <stddef.h>

struct target_report {
    size_t dots;          /* of the lattice, that were used; 0: there was no target */
    double pitch_mm;      /* of a point: the root of its area, mean over the region */
    double across, down;  /* the same along rows and columns of points */
    double uneven;        /* largest over smallest in the region, less 1 */
    double doubt;         /* relative standard error of the pitch */
    double rms_points;    /* distance of dots from the lattice */
    double station_pitch; /* what the target session's station file says */
};

/* Measure the pitch from the session at `path`, whose target has dots `spacing_mm` apart, dark on light or light on dark. */
int target_measure(const char *path, double spacing_mm, struct progress *progress,
                   struct target_report *report, struct nacre_error *error);

#endif
