/* Trying the register tiles of the kernels on a device. */
#ifndef FACTOR_TUNE_TRIAL_H
#define FACTOR_TUNE_TRIAL_H

#include "factor/tune.h"
#include "factor/update.h"

#include "base/progress.h"

#include <stdio.h>

/* Time `count` tiles of the updates, such as update_tiles has, on a small problem, for responses as floats and as half
 * floats, with one kernel and with several, and remember the results. Each tile is a program to compile, which takes
 * seconds. Told, a line a class, is what is used by now for 12 terms, and what it gains over the default. */
int tune_trial(const struct opencl *opencl, const struct update_tile *tiles, size_t count,
               struct progress *progress, FILE *told, struct nacre_error *error);

#endif
