/* What hals holds, and its steps; for hals.c and hals_steps.c alone. */
#ifndef FACTOR_HALS_STEPS_H
#define FACTOR_HALS_STEPS_H

#include "factor/curvature.h"
#include "factor/hals.h"

/* Passes over the terms; entries so near to the centre count one by one in the normal matrices. */
enum { HALS_SWEEPS = 10, HALS_NEAR = 3 };

enum hals_kernel {
    HALS_DESCEND_F,
    HALS_DESCEND_H,
    HALS_MEASURE,
    HALS_EXTRAPOLATE,
    HALS_KERNEL_COUNT
};

/* The register tile of the kernels; see hals.cl. */
struct hals_tile {
    int rows, group, tile;
};

/* One factor of one channel. */
struct hals_track {
    cl_mem good;  /* of the model: the last that was found not to raise the objective */
    cl_mem next;  /* extrapolated from it: where the next step starts, if that proves good */
    cl_mem last;  /* the last best step, before extrapolation */
    cl_mem fresh; /* the best step being made */
};

/* The state of one channel. */
struct hals_channel {
    struct hals_track f, h;
    float share, share_limit; /* of the extrapolation */
    double objective;         /* of the model; infinite: not known */
    int accepted;             /* steps taken */
    int refused;              /* steps not taken since the last that was */
    int exact;                /* approximate normal matrices overshoot here */
    int settled;              /* no step lowers the objective any more */
    double next_objective;    /* where viewed: of what waits in `next` */
    int viewed;
};

struct hals {
    struct method method;
    struct layout layout;
    struct curvature curvature;
    struct hals_options options;
    struct hals_tile tile;
    cl_program program;
    cl_kernel kernels[HALS_KERNEL_COUNT];
    size_t items; /* work-items of a launch */
    struct hals_channel channels[RESPONSES_CHANNELS];
    cl_mem scratch, sums;
    size_t sum_count;
    float *partials; /* sums of the objective, a pair a work-item */
};

/* Whether normal matrices are summed entry by entry: for a channel now, or (NULL) from the start. */
bool hals_is_exact(const struct hals *m, const struct hals_channel *c);

/* Make sure that what waits in `next` does not raise the objective, and take it as the model; then make the step from
 * there, which waits in turn. */
int hals_advance(struct hals *m, int channel, struct nacre_error *error);

/* Find out which is better, the model or what waits. */
int hals_view(struct hals *m, int channel, struct nacre_error *error);
bool hals_is_next_better(const struct hals_channel *c); /* once viewed */

#endif
