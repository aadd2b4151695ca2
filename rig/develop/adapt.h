/* From a pilot to a plan that spends station time only where it is seen: spacing by the footprint of each region, long
 * exposures only for tails that need them, black frames until their mean is known. */
#ifndef RIG_DEVELOP_ADAPT_H
#define RIG_DEVELOP_ADAPT_H

#include "nacre/error.h"
#include "rig/develop/pilot.h"
#include "rig/plan.h"
#include "rig/station.h"

struct adapt_wish {
    double overlap; /* share of a response's energy that may fall among neighbours of its grid */
    double
        noise; /* deviation of a response's entries by noise, off its centre, over their root sum of squares */
    int block; /* side of the regions that are told apart, surface points; 0: all alike */
    double
        seconds; /* of exposing at most; 0: no limit. overlap and noise are widened, alike, until it is kept */
};

struct adapt_result {
    double widened; /* overlap and noise are so many times what was wished; 1: as wished */
    double noise_mean,
        noise_worst; /* foretold, of the pilot's responses, at the exposures of their regions */
    size_t noisy;    /* of them above the bound even with every exposure of the pilot */
    int narrowest, widest; /* spacings */
    int grids;
    double seconds; /* of exposing */
};

/* Change `plan`, the pilot's own, whose window is set: grid_spacing and regions, exposure_turns (the pilot's first one, which
 * white needs, and of the others those that bring the most), black_frames, and a profile where windows overlap. It is laid over
 * the station's sample. Fails where `seconds` cannot be kept. */
int adapt_plan(const struct pilot *pilot, const struct station *station,
               const struct adapt_wish *wish, struct plan *plan, struct adapt_result *result,
               struct nacre_error *error);

#endif
