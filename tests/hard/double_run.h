/* Both methods in double precision, step by step as their headers describe them. */
#ifndef TESTS_HARD_DOUBLE_RUN_H
#define TESTS_HARD_DOUBLE_RUN_H

#include "reference.h"

#include <stddef.h>

/* So many updates, F before H. */
void double_run_mu(struct reference *reference, int steps);

/* So many steps of block coordinate descent with exact normal matrices, extrapolated with restart. Returns how many were
 * refused. reference->f and ->h become the best that was reached. */
int double_run_hals(struct reference *reference, int steps);

#endif
