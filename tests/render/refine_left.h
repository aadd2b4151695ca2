/* How much of the time that was asked for a run may leave. */
#ifndef TESTS_RENDER_REFINE_LEFT_H
#define TESTS_RENDER_REFINE_LEFT_H

#include "render/refine.h"

/* The most that may be left: a step of less than a fifth of all samples, or of less than the first, is not made; it is
 * taken to cost what its share of the last did and a fifth more, the picture 15 % more than foreseen. */
double refine_left_at_most(const struct refine_report *told, double closing_s);

#endif
