/* plan.yaml: which patterns a scan shows, how often and how long each is exposed, and drawing them.
 */
#ifndef RIG_PLAN_H
#define RIG_PLAN_H

#include "base/settings.h"
#include "nacre/error.h"
#include "rig/plan_grids.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum pattern_kind {
    PATTERN_BLACK, /* nothing lit, bare sample: the projector's black level (paper section 4.2) */
    PATTERN_WHITE, /* all lit, white layer on: camera vignetting and projector fall-off */
    PATTERN_DOTS,  /* spaced dots on the white layer, shifted from pattern to pattern: geometry */
    PATTERN_GRID,  /* single surface points on a regular grid, bare sample: the responses
                      (section 4.3) */
    PATTERN_KINDS
};

/* Names in the order of the enum: "black", "white", "dots", "grid". */
extern const char *const pattern_kind_names[];

enum grid_order { GRID_ORDER_RANDOM, GRID_ORDER_SEQUENTIAL };

/* A rectangle of the sample whose points are measured in their own way. */
struct plan_region {
    int x, y, width, height; /* surface points */
    int spacing;             /* surface points to the next lit point */
    double longest_turns;    /* the plan's exposures up to this one are enough; 0: all */
    int line;
};

struct plan {
    int seed;          /* of the random order */
    int order;         /* enum grid_order */
    int black_frames;  /* HDR frames of the black pattern */
    int white_frames;  /* HDR frames of the white pattern */
    int dot_spacing;   /* projector pixels between dots */
    int dot_shift;     /* projector pixels from one dots pattern to the next, in x and in y */
    int dot_size;      /* side of a square dot, projector pixels */
    int grid_spacing;  /* surface points between lit points; spacing^2 patterns */
    int grid_patterns; /* grids that are measured, a random choice of them; 0: all */
    int window; /* K of the responses to be extracted, odd; at most the spacing without a profile */
    double *exposure_turns; /* exposures in turns of the colour wheel, ascending; heap */
    size_t exposure_count;
    struct plan_region *regions; /* of several that hold a point the last counts; heap */
    size_t region_count;
    double *
        profile; /* [channels][radii]: how a response falls with the distance, 0, 1, 2 ... surface points, from
                        lit points; heap */
    size_t profile_count;                                     /* 0: unknown */
    struct plan_grids *grids;                                 /* laid over a sample by plan_lay */
    int dots_line, window_line, exposures_line, profile_line; /* in the file, for messages */
};

extern const struct settings_schema plan_schema;

/* One pattern to show. */
struct pattern {
    enum pattern_kind kind;
    int number; /* within its kind, from 0 */
};

/* Read and check a plan file; plan_finish frees. */
int plan_read(const char *path, struct plan *plan, struct nacre_error *error);
/* The same from text, named `name` in messages. */
int plan_parse(const char *name, const char *text, size_t size, struct plan *plan,
               struct nacre_error *error);
void plan_finish(struct plan *plan);

/* Lay the grids over a sample of width x height points and `channels` colours, which everything below needs of a plan
 * with regions. `name` is the plan's in messages. */
int plan_lay(struct plan *plan, const char *name, int width, int height, int channels,
             struct nacre_error *error);

/* Whether a kind of pattern is shown with the white layer on the sample. */
bool pattern_kind_wants_white_layer(enum pattern_kind kind);

/* How many patterns of a kind the plan has: grid_spacing^2 grids without regions, ceil(dot_spacing / dot_shift)^2
 * dots, ... */
int plan_pattern_count(const struct plan *plan, enum pattern_kind kind);

/* How many of them are shown: of the grids those that grid_patterns asks for. */
int plan_shown_count(const struct plan *plan, enum pattern_kind kind);

/* The order of showing: patterns[sum of shown counts] on the heap. White and dots first (with the white
 * layer on), then black and all grids (bare sample), the grids shuffled by the seed unless the plan
 * wants them by number; the same for the same plan everywhere. */
int plan_order(const struct plan *plan, struct pattern **patterns, size_t *count,
               struct nacre_error *error);

/* How many of the plan's exposures a pattern gets: the first so many, all but for a grid of regions that need fewer. */
size_t plan_pattern_exposures(const struct plan *plan, struct pattern pattern);

/* The offset of the first lit point (x, y) of grid or dots pattern `number` of a plan without regions; lit are x + i spacing,
 * y + j spacing. */
void plan_pattern_offset(const struct plan *plan, struct pattern pattern, int *x, int *y);

/* Draw a pattern for width x height projector pixels: levels[height][width], 0 or 255. Dots that
 * the border would cut are left out: their centres would lie. */
void plan_draw(const struct plan *plan, struct pattern pattern, int width, int height,
               uint8_t *levels);

#endif
