/* Reading and merging the patterns of one kind in parallel, and taking the results in order. */
#ifndef RIG_DEVELOP_VISIT_H
#define RIG_DEVELOP_VISIT_H

#include "base/progress.h"
#include "nacre/error.h"
#include "rig/develop/hdr.h"
#include "rig/session.h"

#include <stdbool.h>
#include <stddef.h>

/* A pattern as merged. All pointers are the visitor's and valid during the call. */
struct merged {
    struct pattern pattern;
    const struct pattern_frames *frames;
    float *radiance; /* [height][width], may be changed */
    float *variance; /* [height][width] */
    size_t saturated;
};

struct visitor {
    void *state;
    size_t result_size; /* floats that each pattern's work produces, 0: none */
    /* Whether a pattern needs no reading and no work, as `take` knows all of it; may be NULL. Called in no order. */
    bool (*knows)(void *state, struct pattern pattern);
    /* Called for several patterns at once, in no order; fills `result`. May be NULL. */
    int (*work)(void *state, const struct merged *merged, float *result, struct nacre_error *error);
    /* Called for one pattern at a time, in the order of their numbers. Of one that is known `merged` has only the pattern. */
    int (*take)(void *state, const struct merged *merged, const float *result,
                struct nacre_error *error);
};

/* How far the whole development has come. */
struct visit_progress {
    struct progress *progress;
    double done, total; /* patterns */
};

/* Visit the patterns of a kind that were measured, the first `limit` of them (0: all). Results and errors do not depend
 * on the number of threads; memory is that of one pattern a thread. Counts the visited and the missing ones. */
int visit_patterns(const struct session *session, enum pattern_kind kind, int limit,
                   const struct noise_model *noise, const struct visitor *visitor,
                   struct visit_progress *progress, int *visited, int *missing,
                   struct nacre_error *error);

#endif
