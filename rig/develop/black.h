/* The black level: what camera and projector show where nothing is lit, and taking it off (paper section 4.2). */
#ifndef RIG_DEVELOP_BLACK_H
#define RIG_DEVELOP_BLACK_H

#include "nacre/error.h"
#include "rig/develop/moments.h"

#include <stddef.h>

enum black_mode {
    BLACK_SUBTRACT, /* subtract the mean, keep what falls below zero: unbiased */
    BLACK_CLIP, /* the paper's: zero below the confidence limit, the mean subtracted from the rest */
};

/* Words for the modes in the order of the enum, NULL-terminated. */
extern const char *const black_mode_names[];

struct black_level {
    size_t pixels;
    float *mean;  /* raw units a second; NaN: never measured */
    float *limit; /* values below it are taken for black; -infinity with BLACK_SUBTRACT */
};

/* The standard normal deviate below which `confidence` (0 to 1, exclusive) of the values fall. */
double normal_quantile(double confidence);

/* From the statistics of the black frames and the mean of the variances that the merge foretold for them
 * (`predicted`; see hdr_merge). The limit is mean + quantile(confidence) * sigma. Few frames know their sigma badly, so
 * the foretold variance counts as much as eight more frames would. */
int black_level_init(struct black_level *black, const struct moments *frames,
                     const struct moments *predicted, enum black_mode mode, double confidence,
                     struct nacre_error *error);
void black_level_finish(struct black_level *black);

/* Take the black level off radiance[pixels] in place. NaN stays NaN. */
void black_level_subtract(const struct black_level *black, float *radiance);

#endif
