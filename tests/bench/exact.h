/* One of the paper's updates in double precision, point by point: what the kernels must agree with at full size. */
#ifndef TESTS_BENCH_EXACT_H
#define TESTS_BENCH_EXACT_H

#include "cases.h"

#include <stdbool.h>

/* Update F (or H) of the first channel by the rules of section 5.3, W^2 = 1 / g. windows: of case_windows. f and h:
 * [height][width][terms]. For problems without negative or missing entries. */
void exact_update(const struct case_problem *made, const float *windows, bool of_h, double *f,
                  double *h);

#endif
