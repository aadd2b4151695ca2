/* What trials of the kernels' register tiles found on a device, remembered in a file of the user's cache. */
#ifndef FACTOR_TUNE_H
#define FACTOR_TUNE_H

#include "base/opencl.h"

#include <stdbool.h>
#include <stddef.h>

/* What a kernel is compiled for, as far as the best tile depends on it. */
struct tune_class {
    const char *method; /* as in struct method_ops */
    int lanes;
    bool clustered, half;
};

/* The share by which a tile must beat the default to be taken instead. */
#define TUNE_MARGIN 0.05

enum { TUNE_NUMBERS = 3, TUNE_TILES = 16 };

/* One tile, its numbers the method's, and the time that a plane of its factors took in the trial. */
struct tune_result {
    int tile[TUNE_NUMBERS]; /* 1 to 64 */
    double seconds;
};

/* The results for a device, its driver and a class: how many were put into results[TUNE_TILES]. 0 where there was no
 * trial, or what is left of it cannot be read. */
size_t tune_recall(const struct opencl *opencl, struct tune_class class,
                   struct tune_result *results);

/* Remember the results of a class in place of earlier ones. */
int tune_remember(const struct opencl *opencl, struct tune_class class,
                  const struct tune_result *results, size_t count, struct nacre_error *error);

/* The file, in memory the caller frees: tiles.tsv in $CACHE_DIRECTORY (as systemd has it), else in the folder nacre of
 * $XDG_CACHE_HOME, else of ~/.cache. NULL where none of these is set, or without memory. */
char *tune_path(void);

#endif
