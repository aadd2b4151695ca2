/* How long after its refresh a pattern is on the glass, and how far the camera's stamps are from its triggers: measured with
 * a pattern that alternates between black and white. */
#ifndef RIG_LATENCY_H
#define RIG_LATENCY_H

#include "base/progress.h"
#include "nacre/error.h"
#include "rig/devices.h"

#include <stddef.h>

/* Of a list of times, in milliseconds. */
struct latency_figure {
    size_t count;
    double median_ms;
    double spread_ms; /* half of the values lie within so much */
    double least_ms, most_ms;
};

struct latency_report {
    double exposure_ms;
    double contrast;  /* mean raw value of white less that of black, share of full scale */
    double saturated; /* share of pixels under white */
    struct latency_figure light; /* from the time that `show` tells to the change of light */
    struct latency_figure
        camera;  /* from the trigger to the beginning of the exposure, as stamped */
    size_t lost; /* frames that did not come */
};

/* Show `flips` patterns, black and white by turns, and expose each for whole turns of the wheel around the time at which the
 * light changes: how much of the change a frame has seen tells when it was. The projector must be one that returns from
 * `show` before its pattern is on the glass: opened with a latency of 0. Fails where the camera does not see the
 * projector. */
int latency_measure(const struct devices *devices, int flips, struct progress *progress,
                    struct latency_report *report, struct nacre_error *error);

/* The figure of `count` values, which are sorted. */
struct latency_figure latency_figure(double *values, size_t count);

#endif
