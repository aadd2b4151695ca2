/* Which points nothing beats. */
#ifndef STUDY_TRADEOFF_FRONT_H
#define STUDY_TRADEOFF_FRONT_H

#include "study/tradeoff.h"

/* What an error is paid with. */
enum tradeoff_cost { TRADEOFF_SECONDS, TRADEOFF_BYTES };

/* A point that costs more than another is on a front only if its error is lower by this share of it. */
#define TRADEOFF_GAIN 0.01

double tradeoff_cost_of(const struct tradeoff_point *point, enum tradeoff_cost cost);

/* Set `quickest` and `smallest` of all points. Of equal points the first is on the front. */
void tradeoff_mark_fronts(struct tradeoff *tradeoff);

/* The least error of points of other runs than `run` that cost no more; INFINITY where there is none. */
double tradeoff_rival(const struct tradeoff *tradeoff, int run, enum tradeoff_cost cost,
                      double limit);

/* Indices of the points on one front, cheapest first; returns how many. */
int tradeoff_front(const struct tradeoff *tradeoff, enum tradeoff_cost cost,
                   int indices[TRADEOFF_POINTS]);

#endif
