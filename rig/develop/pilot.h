/* From a pilot measurement to the grid spacing and window of a scan: how far the light of a point reaches. */
#ifndef RIG_DEVELOP_PILOT_H
#define RIG_DEVELOP_PILOT_H

#include "base/progress.h"
#include "nacre/error.h"
#include "nacre/scan.h"

#include <stddef.h>

/* Where one response was measured, and what it weighs. */
struct pilot_place {
    int x, y;
    /* Sums over the channels of its entries' squares, without noise: off the centre, and of the centre. */
    double power, centre;
};

/* Light of the pilot's responses by chessboard distance from the lit point. Zero-initialised it is empty;
 * pilot_finish frees. */
struct pilot {
    int rings;        /* 0 ... (K - 1) / 2 */
    size_t responses; /* that count */
    size_t capacity;
    double *energy; /* [responses][channels][rings]: mean entry of the ring times its entries */
    struct pilot_place *places; /* [responses] */
    double *fall;               /* [channels][radii]: sums of entries by their distance, rounded */
    size_t *fall_count;         /* the same: entries */
    int radii;
    int channels;
    double noise;            /* deviation of an entry without light */
    double channel_noise[3]; /* the same by channel */
    double black;            /* raw units a second where nothing is lit, which has noise too */
    double white[3]; /* by channel, raw units a second of what reflects all light; 0: unknown */
};

/* A channel's tail: the last ring that is surely light, and how it goes on. */
struct pilot_tail {
    int last;
    double rate; /* of the fall from ring to ring */
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

/* The tail of a channel, and with it what response `index` leaks in that channel out of a window of 2 half + 1 points. */
struct pilot_tail pilot_tail(const struct pilot *pilot, int channel);
double pilot_response_leak(const struct pilot *pilot, struct pilot_tail tail, size_t index,
                           int channel, int half);

/* Sum of a response's entries in a ring of a channel. */
double pilot_energy(const struct pilot *pilot, size_t index, int channel, int ring);

/* How light falls with the distance: profile[channels][radii], the mean entry at 0, 1, 2 ... points, on the heap. Where light is
 * lost in noise it goes on as it fell before. */
int pilot_profile(const struct pilot *pilot, double **profile, size_t *count,
                  struct nacre_error *error);

/* The smallest half window whose worst leak is within `bound`; fails where the pilot's own does not reach that. */
int pilot_choose(const struct pilot *pilot, double bound, int *half, struct nacre_error *error);

/* Develop the pilot session at `path` and gather its responses. `scratch` is a path for the developed scan, which is
 * removed again. */
int pilot_read(const char *path, const char *scratch, struct progress *progress,
               struct pilot *pilot, struct nacre_error *error);

#endif
