/* From a pilot measurement to the grid spacing and window of a scan: how far the light of a point reaches. */
#ifndef RIG_DEVELOP_PILOT_H
#define RIG_DEVELOP_PILOT_H

#include "base/progress.h"
#include "nacre/error.h"
#include "nacre/scan.h"

#include <stddef.h>

/* Light of the pilot's responses by chessboard distance from the lit point. Zero-initialised it is empty;
 * pilot_finish frees. */
struct pilot {
    int rings;        /* 0 ... (K - 1) / 2 */
    size_t responses; /* that count */
    size_t capacity;
    double *energy; /* [responses][channels][rings]: mean entry of the ring times its entries */
    int channels;
    double noise; /* deviation of an entry without light */
};

/* What a spacing lets leak: the share of a response's energy that falls outside a window as wide as the spacing, which
 * is the share that neighbours' light has in it. */
struct pilot_leak {
    double mean;  /* over responses and channels */
    double worst; /* the largest of them */
};

int pilot_init(struct pilot *pilot, const struct nacre_scan_info *info, double noise,
               struct nacre_error *error);
void pilot_finish(struct pilot *pilot);

/* Take note of the response[channels][K][K] of (x, y). Rings that lie wholly outside the sample, or were not measured,
 * leave it out. */
int pilot_add(struct pilot *pilot, const struct nacre_scan_info *info, int x, int y,
              const float *response, struct nacre_error *error);

/* Of a window of 2 half + 1 points. Beyond the ring where light is lost in noise, and beyond the pilot's own window, the
 * tail goes on as it falls before. */
struct pilot_leak pilot_leak(const struct pilot *pilot, int half);

/* The smallest half window whose worst leak is within `bound`; fails where the pilot's own does not reach that. */
int pilot_choose(const struct pilot *pilot, double bound, int *half, struct nacre_error *error);

/* Develop the pilot session at `path` and gather its responses. `scratch` is a path for the developed scan, which is
 * removed again. */
int pilot_read(const char *path, const char *scratch, struct progress *progress,
               struct pilot *pilot, struct nacre_error *error);

#endif
