/* What the method terms holds, and its steps; for terms.c and terms_steps.c alone. */
#ifndef FACTOR_TERMS_STEPS_H
#define FACTOR_TERMS_STEPS_H

#include "factor/layout.h"
#include "factor/terms.h"
#include "factor/terms_data.h"

enum terms_kernel {
    TERMS_VISIT,
    TERMS_DESCEND,
    TERMS_EXTRAPOLATE,
    TERMS_MULTIPLY,
    TERMS_CORRELATE,
    TERMS_SIDES,
    TERMS_LACK,
    TERMS_KERNEL_COUNT
};

enum { TERMS_SWEEPS = 10, TERMS_SQUARES = 3 /* of a point, in the curvature */ };

/* As in terms.cl; and pairs of terms whose products are held at a time. */
enum { TERMS_DOWN = 3, TERMS_ACROSS = 4, TERMS_COLUMNS = 4, TERMS_PRODUCTS = 18 };

/* Planes of one set: F, or H where it is another. */
struct terms_track {
    cl_mem good;  /* of the model: the last that was found not to raise the objective */
    cl_mem next;  /* extrapolated from it: where the next step starts, if that proves good */
    cl_mem last;  /* the last best step, before extrapolation */
    cl_mem fresh; /* the best step being made */
    cl_mem kept;  /* the last that lowered the objective as steps on entries within reach see it */
};

/* Planes and the channels they belong to. */
struct terms_set {
    int first, count; /* channels */
    struct terms_track tracks[2];
    cl_mem curvature;         /* as in terms.cl; parts of it are carried over from step to step */
    float share, share_limit; /* of the extrapolation */
    float damping;
    double objective;      /* of the model; infinite: not known */
    int burst;             /* how many steps on entries within reach alone are next */
    int accepted;          /* steps taken */
    int refused;           /* steps not taken since the last that was */
    int settled;           /* no step lowers the objective any more */
    int placed;            /* kernels were found for what is in `next` */
    double next_objective; /* where viewed: of what waits in `next` */
    int viewed;
};

struct terms {
    struct method method;
    const struct terms_data *data;
    struct problem problems[2]; /* the copies of the responses as layouts want them */
    struct layout layouts[2];
    cl_program program;
    cl_kernel kernels[TERMS_KERNEL_COUNT];
    int sides; /* 1, or 2 where H is another than F */
    struct terms_set sets[RESPONSES_CHANNELS];
    struct {
        cl_mem kernels[2], scales[2]; /* [K][K][terms] and [K][K], for the step of F and of H */
        cl_mem sums;
        float *good, *next; /* [terms][numbers of a kernel] */
    } channels[RESPONSES_CHANNELS];
    cl_mem weights, nothing; /* [height][stride] */
    cl_mem gradient;
    cl_mem beyond; /* what entries beyond reach have of the objective, as carried on: sums */
    struct {       /* of the kernels' equations, as in terms.cl */
        cl_mem weighted, plain, correlations, sides, lacks, measured;
    } equations;
    size_t curvature_floats;             /* of one set */
    float *partials;                     /* sums of the objective */
    float *correlations, *right, *lacks; /* equations on the host */
    cl_int *measured;
    float *sums;          /* of a channel: [K][K][pairs + terms] */
    float *staged;        /* kernels on their way to the device */
    float *window;        /* [K][K] */
    size_t equation_size; /* floats of an entry's equations */
};

/* Make sure that what waits in `next` does not raise the objective, and take it as the model; then make the step from
 * there, which waits in turn. */
int terms_advance(struct terms *m, struct terms_set *set, struct nacre_error *error);

/* Find out which is better, the model or what waits. */
int terms_view(struct terms *m, struct terms_set *set, struct nacre_error *error);
bool terms_is_next_better(const struct terms_set *set); /* once viewed */

int terms_copy_planes(struct terms *m, cl_mem from, cl_mem to, struct nacre_error *error);

/* Bring the numbers of a channel's kernels to the device. */
int terms_place_kernels(struct terms *m, int channel, const float *numbers,
                        struct nacre_error *error);

#endif
