/* The noise that a pilot's responses would have at other exposures. */
#ifndef RIG_DEVELOP_FORETOLD_H
#define RIG_DEVELOP_FORETOLD_H

#include "rig/develop/pilot.h"
#include "rig/plan.h"
#include "rig/station.h"

enum { FORETOLD_MAXIMUM = 8 }; /* exposures */

/* What foretells: the pilot's light in its rings, the sensor's read noise, quantisation and shot noise as merging weighs them
 * (hdr.h), and how a pixel's variance became an entry's, which the pilot's black frames told. */
struct foretold {
    const struct pilot *pilot;
    const struct station *station;
    int window; /* of the responses */
    double gain
        [3]; /* by channel: variance of an entry of a white that shows 1, over a pixel's variance */
};

/* Deviation of a response's entries over the root of the sum of their squares: of all, and off the centre. */
struct noise {
    double whole, tails;
};

/* `plan` is the pilot's. Pilot and station outlive this. */
void foretold_init(struct foretold *foretold, const struct pilot *pilot,
                   const struct station *station, const struct plan *plan);

/* Of the pilot's response `index` with the first 1, 2 ... of `count` exposures of so many turns, ascending: noise[count]. */
void foretold_noise(const struct foretold *foretold, size_t index, const double *turns,
                    size_t count, struct noise *noise);

/* The sum of the variances of a dark response's entries. */
double foretold_dark(const struct foretold *foretold, const double *turns, size_t count);

#endif
