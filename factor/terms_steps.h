/* What the method terms holds, and its steps; for terms*.c alone.
 *
 * terms_room.c makes it and gives it back, terms_equations.c finds kernels, terms_steps.c makes steps, terms_state.c saves
 * and loads, terms.c is the seam. */
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

/* What visits make, as in terms.cl: a step with its normal matrices as they are, or with those of entries near the centre, of
 * all within reach, or of all summed again. */
enum { TERMS_STEP_SHAPED = 1, TERMS_STEP = 3, TERMS_STEP_WITHIN = 7, TERMS_STEP_EXACT = 15 };

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

/* Whether planes are the channel's to answer for: those that all share are the first's. */
static inline bool terms_has_set(const struct terms *m, int channel)
{
    return channel == 0 || terms_data_sets(m->data) > 1;
}

/* Of one side's planes of a set. */
static inline size_t terms_plane_floats(const struct terms *m)
{
    const struct layout_sizes *s = &m->layouts[0].sizes;
    return (size_t)s->terms * (size_t)s->height * (size_t)s->width;
}

/* Numbers of a channel's kernels. */
static inline size_t terms_number_count(const struct terms *m)
{
    return (size_t)m->data->grid.count * (size_t)m->layouts[0].sizes.terms;
}

/* Compile the program and make room for all but the sets, with data and layouts in place. */
int terms_prepare(struct terms *m, struct nacre_error *error);
void terms_release(struct terms *m); /* half-made ones too */

/* Items of as many dimensions as are not 0. */
int terms_run(struct terms *m, enum terms_kernel name, const void *const *values,
              const size_t *sizes, int count, size_t across, size_t down, size_t deep,
              struct nacre_error *error);

/* The best kernels for the planes that wait, by entries up to `most` from the centre: their numbers there. */
int terms_find_kernels(struct terms *m, const struct terms_set *set, int most,
                       struct nacre_error *error);

/* As struct method_ops has them. */
size_t terms_state_size(const struct method *method, int channel);
int terms_save_state(struct method *method, int channel, void *state, struct nacre_error *error);
int terms_load_state(struct method *method, int channel, const void *state,
                     struct nacre_error *error);

/* The objective of what waits, as entries within reach and what is known of the others have it, and the best step from
 * there. */
int terms_look_within(struct terms *m, struct terms_set *set, int step, double *objective,
                      struct nacre_error *error);

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
