/* The plain program on a problem of the benchmarks, beside our updates. */
#ifndef TESTS_BENCH_PEER_COMPARE_H
#define TESTS_BENCH_PEER_COMPARE_H

#include "cases.h"
#include "timing.h"

/* The time of one update of the plain program from the factors of `mu`, which goes one update on as well; ends the program
 * where they disagree. One channel. */
struct moment peer_compare(const struct case_problem *made, struct method *mu);

#endif
