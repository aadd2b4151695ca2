/* Which factorization to study next, decided by nothing but what was found before. */
#ifndef STUDY_TRADEOFF_PLAN_H
#define STUDY_TRADEOFF_PLAN_H

#include "study/tradeoff.h"

/* The next setting that is expected to take no more than `seconds`; false when nothing promising is left. First a few
 * cheap ones, one for each model, method and weight; then neighbours of runs on a front, those first that promise most
 * for their seconds. Settings that no front holds have no neighbours tried. *predicted: seconds that it may take; 0:
 * not known. */
bool tradeoff_next(const struct tradeoff *tradeoff, double seconds, struct tradeoff_setting *next,
                   double *predicted);

/* Whether a run is not worth going on with after the look that made the last point: twice the gain since the run's look
 * before would leave it behind what others have reached in its bytes and in the seconds it has taken. */
bool tradeoff_is_dominated(const struct tradeoff *tradeoff, int run);

/* The iterations at which to look: 3, 6, 12, 24, 48 ... */
bool tradeoff_looks_at(int iterations);

/* Iterations of a run at most, and those whose factors others start from. */
enum { TRADEOFF_ITERATIONS = 400, TRADEOFF_KEPT = 12 };

#endif
