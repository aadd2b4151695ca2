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
    /* Deviation of a response's entries by noise, over the root of their sum of squares: of all, as `nacre error` counts, and off
     * the centre. */
    double noise, tails;
    int block; /* side of the regions that are told apart, surface points; 0: all alike */
    double
        seconds; /* of exposing at most; 0: no limit. All bounds are widened, alike, until it is kept */
};

/* Foretold of the pilot's responses. */
struct adapt_noise {
    double mean, worst;
};

struct adapt_result {
    double widened;                  /* bounds are so many times what was wished; 1: as wished */
    struct adapt_noise noise, tails; /* at the exposures of their regions */
    size_t noisy;                    /* responses above a bound even whatever the exposures */
    int narrowest, widest;           /* spacings */
    int grids;
    double seconds; /* of exposing */
};

/* Change `plan`, the pilot's own, whose window is set: grid_spacing and regions, exposure_turns (up to four whole turns
 * from the pilot's first one, which white needs and is always there, to its longest), black_frames, and a profile where
 * windows overlap. It is laid over the station's sample. Fails where `seconds` cannot be kept. */
int adapt_plan(const struct pilot *pilot, const struct station *station,
               const struct adapt_wish *wish, struct plan *plan, struct adapt_result *result,
               struct nacre_error *error);

#endif
