/* Steps of the method terms: what is extrapolated, kept and taken back. The arithmetic is in terms.cl. */
#include "factor/terms_steps.h"

#include "factor/terms_kernels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Extrapolation as in hals_steps.c. */
#define PLAIN        3
#define FIRST        0.5F
#define GROWTH       1.05F
#define LIMIT_GROWTH 1.01F
#define SHRINK       1.5F

/* Where a point's values change, so do those it meets: both ends' changes together are at most twice what one makes. */
#define BOTH_WAYS 2.0F

/* Normal matrices of entries far from the centre are summed again in every so many steps. */
enum { EXACT_STEPS = 6, DISTANT_EVERY = 12 };

/* Steps on entries within reach between two on all: at first, and at most. Normal matrices are summed again in every so
 * many of the first, and of the second. */
enum {
    FIRST_BURST = 2,
    MOST_BURST = 12,
    BURST_GROWTH = 2,
    WITHIN_EVERY = 6,
    NEAR_EVERY = 3,
    ALL_EVERY = 2
};

static bool has_bursts(const struct terms *m)
{
    return m->sides == 1 && m->data->reach < m->data->grid.window / 2;
}

static int is_exact(const struct terms *m, const struct terms_set *set)
{
    int every = set->burst > 0 ? ALL_EVERY : DISTANT_EVERY;
    return m->sides == 2 || set->accepted < EXACT_STEPS || set->accepted % every == 0;
}

/* A step so much shorter that still raises the objective: the model is as good as float arithmetic makes it. */
#define MOST_DAMPING 1000.0F

static float least_damping(const struct terms *m)
{
    return m->sides == 1 ? BOTH_WAYS : 1;
}

/* One channel's part of a visit. side: 1 for the step of H. */
static int visit_channel(struct terms *m, const struct terms_set *set, int channel, int side,
                         cl_mem own, cl_mem other, int step, int most, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[side];
    const cl_int reach = m->data->reach;
    const cl_int more = channel > set->first;
    cl_mem near = side == 1 ? m->nothing : m->weights;
    cl_mem far = m->sides == 2 && side == 0 ? m->nothing : m->weights;
    const void *values[] = {&l->channels[channel].responses,
                            &l->channels[channel].mask,
                            &m->channels[channel].kernels[side],
                            &m->channels[channel].scales[side],
                            &own,
                            &other,
                            &near,
                            &far,
                            &m->gradient,
                            &set->curvature,
                            &m->channels[channel].sums,
                            &more,
                            &step,
                            &most,
                            &reach,
                            &l->sizes};
    size_t sizes[16];
    for (int i = 0; i < 15; i++) {
        sizes[i] = i < 11 ? sizeof(cl_mem) : sizeof(cl_int);
    }
    sizes[15] = sizeof l->sizes;
    return terms_run(m, TERMS_VISIT, values, sizes, 16, (size_t)l->sizes.blocks,
                     (size_t)l->sizes.height, 0, error);
}

/* Entries up to `most` from the centre. */
static int visit(struct terms *m, const struct terms_set *set, int side, cl_mem own, cl_mem other,
                 int step, int most, struct nacre_error *error)
{
    int status = NACRE_OK;
    for (int i = 0; i < set->count && status == NACRE_OK; i++) {
        status = visit_channel(m, set, set->first + i, side, own, other, step, most, error);
    }
    return status;
}

static int add_sums(struct terms *m, cl_mem from, double *sum, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    size_t count = 2 * (size_t)l->sizes.blocks * (size_t)l->sizes.height;
    cl_int status = clEnqueueReadBuffer(l->opencl->queue, from, CL_TRUE, 0,
                                        count * sizeof *m->partials, m->partials, 0, NULL, NULL);
    for (size_t i = 0; i < count && status == CL_SUCCESS; i++) {
        *sum += (double)m->partials[i];
    }
    return opencl_check(l->opencl, status, "cannot read the objective", error);
}

/* The objective that the last visit of F's side summed: each pair was met twice where it is one number. */
static int collect(struct terms *m, const struct terms_set *set, double *objective,
                   struct nacre_error *error)
{
    double sum = 0;
    int status = NACRE_OK;
    for (int c = set->first; c < set->first + set->count && status == NACRE_OK; c++) {
        status = add_sums(m, m->channels[c].sums, &sum, error);
    }
    *objective = sum / (m->sides == 1 ? 4 : 2);
    return status;
}

/* The best step from `own`, of which the gradient within reach is known, and that beyond of `anchor`. */
static int descend(struct terms *m, const struct terms_set *set, struct terms_track *track,
                   cl_mem own, cl_mem anchor, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    const cl_int sweeps = TERMS_SWEEPS;
    const void *values[] = {&own,       &anchor,       &m->gradient, &set->curvature, &track->fresh,
                            &m->beyond, &set->damping, &sweeps,      &l->sizes};
    const size_t sizes[] = {sizeof(cl_mem), sizeof(cl_mem), sizeof(cl_mem),
                            sizeof(cl_mem), sizeof(cl_mem), sizeof(cl_mem),
                            sizeof(float),  sizeof sweeps,  sizeof l->sizes};
    return terms_run(m, TERMS_DESCEND, values, sizes, 9, (size_t)l->sizes.blocks,
                     (size_t)l->sizes.height, 0, error);
}

int terms_copy_planes(struct terms *m, cl_mem from, cl_mem to, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    return opencl_check(l->opencl,
                        clEnqueueCopyBuffer(l->opencl->queue, from, to, 0, 0,
                                            l->factor_floats * sizeof(float), 0, NULL, NULL),
                        "cannot copy planes", error);
}

static int extrapolate(struct terms *m, struct terms_track *track, float share,
                       struct nacre_error *error)
{
    const void *values[] = {&track->fresh, &track->last, &track->next, &share};
    const size_t sizes[] = {sizeof(cl_mem), sizeof(cl_mem), sizeof(cl_mem), sizeof share};
    int status =
        terms_run(m, TERMS_EXTRAPOLATE, values, sizes, 4, m->layouts[0].factor_floats, 0, 0, error);
    cl_mem kept = track->last;
    track->last = track->fresh;
    track->fresh = kept;
    return status;
}

/* By all entries. */
static int find_all_kernels(struct terms *m, struct terms_set *set, struct nacre_error *error)
{
    int status = terms_find_kernels(m, set, m->data->grid.window / 2, error);
    set->placed = status == NACRE_OK;
    return status;
}

static size_t number_bytes(const struct terms *m)
{
    return (size_t)m->data->grid.count * (size_t)m->layouts[0].sizes.terms * sizeof(float);
}

static void lengthen(struct terms_set *set)
{
    set->share = fminf(set->share_limit, GROWTH * set->share);
    set->share_limit = fminf(1, LIMIT_GROWTH * set->share_limit);
}

static void shorten(struct terms_set *set)
{
    set->share_limit = set->share;
    set->share /= SHRINK;
}

static void swap(cl_mem *a, cl_mem *b)
{
    cl_mem kept = *a;
    *a = *b;
    *b = kept;
}

int terms_look_within(struct terms *m, struct terms_set *set, int step, double *objective,
                      struct nacre_error *error)
{
    struct terms_track *f = &set->tracks[0];
    double beyond = 0;
    int status = terms_find_kernels(m, set, m->data->reach, error);
    if (status == NACRE_OK) {
        status = visit(m, set, 0, f->next, f->next, step, m->data->reach, error);
    }
    if (status == NACRE_OK) {
        status = descend(m, set, f, f->next, f->good, error);
    }
    if (status == NACRE_OK) {
        status = collect(m, set, objective, error);
    }
    if (status == NACRE_OK) {
        status = add_sums(m, m->beyond, &beyond, error);
    }
    *objective += beyond;
    return status;
}

/* Go on from what waits by steps on entries within reach; of the others the gradient at the model is carried on by their
 * curvature, and kernels keep what they are there. Ends where not even a step without extrapolation is better. */
static int burst(struct terms *m, struct terms_set *set, struct nacre_error *error)
{
    struct terms_track *f = &set->tracks[0];
    double least = INFINITY, objective = 0;
    int status = NACRE_OK, refused = 0;
    for (int i = 0; i < set->burst && refused < 2 && status == NACRE_OK; i++) {
        status = terms_look_within(m, set,
                                   i % WITHIN_EVERY == WITHIN_EVERY - 1 ? TERMS_STEP_WITHIN
                                   : i % NEAR_EVERY == 0                ? TERMS_STEP
                                                                        : TERMS_STEP_SHAPED,
                                   &objective, error);
        if (status == NACRE_OK && objective <= least) {
            least = objective;
            refused = 0;
            swap(&f->kept, &f->next);
            if (i > 0) {
                lengthen(set);
            }
            status = extrapolate(m, f, set->share, error);
        } else if (status == NACRE_OK && refused++ == 0) {
            shorten(set);
            swap(&f->next,
                 &f->last); /* the best step from what is kept; what it was carried on to is not */
            status = terms_copy_planes(m, f->next, f->last, error);
        } else if (status == NACRE_OK) {
            swap(&f->next, &f->kept);
        }
    }
    return status;
}

/* From the model, whose gradient is known: the best step, carried on, waits in `next`, and its kernels. */
static int make_step(struct terms *m, struct terms_set *set, float share, int steps,
                     struct nacre_error *error)
{
    struct terms_track *f = &set->tracks[0], *h = &set->tracks[1];
    const int all = m->data->grid.window / 2;
    int status = descend(m, set, f, f->good, f->good, error);
    if (status == NACRE_OK) {
        status = extrapolate(m, f, share, error);
    }
    if (status == NACRE_OK && m->sides == 2) {
        status = visit(m, set, 1, h->good, f->next, TERMS_STEP_EXACT, all, error);
    }
    if (status == NACRE_OK && m->sides == 2) {
        status = descend(m, set, h, h->good, h->good, error);
    }
    if (status == NACRE_OK && m->sides == 2) {
        status = extrapolate(m, h, share, error);
    }
    for (int c = set->first; c < set->first + set->count; c++) {
        memcpy(m->channels[c].next, m->channels[c].good, number_bytes(m));
    }
    if (status == NACRE_OK && steps > 0) {
        status = burst(m, set, error);
    }
    return status == NACRE_OK ? find_all_kernels(m, set, error) : status;
}

static void accept(struct terms *m, struct terms_set *set, double objective)
{
    for (int side = 0; side < m->sides; side++) {
        swap(&set->tracks[side].good, &set->tracks[side].next);
    }
    for (int c = set->first; c < set->first + set->count; c++) {
        float *kept = m->channels[c].good;
        m->channels[c].good = m->channels[c].next;
        m->channels[c].next = kept;
    }
    set->objective = objective;
    if (set->accepted == PLAIN) {
        set->share = FIRST;
        set->burst = has_bursts(m) ? FIRST_BURST : 0;
    } else if (set->refused == 0) {
        lengthen(set);
        set->burst = set->burst > 0 ? (int)fmin(MOST_BURST, set->burst + BURST_GROWTH) : 0;
    }
    set->damping = fmaxf(least_damping(m), 0.9F * set->damping);
    set->accepted++;
    set->refused = 0;
}

/* The step that waits raises the objective: make it again from the model without extrapolation, then shorter. */
static int refuse(struct terms *m, struct terms_set *set, struct nacre_error *error)
{
    cl_mem own = set->tracks[0].good, other = set->tracks[m->sides - 1].good;
    int status = NACRE_OK;
    set->refused++;
    if (set->refused == 1 && set->share > 0) {
        shorten(set);
        set->burst = set->burst > 1 ? set->burst / 2 : set->burst;
    } else {
        set->damping *= 2;
    }
    set->settled = set->damping > MOST_DAMPING;
    for (int c = set->first; c < set->first + set->count && status == NACRE_OK; c++) {
        status = terms_place_kernels(m, c, m->channels[c].good, error);
    }
    if (status == NACRE_OK && !set->settled) {
        status = visit(m, set, 0, own, other, TERMS_STEP_EXACT, m->data->grid.window / 2, error);
    }
    return status == NACRE_OK && !set->settled ? make_step(m, set, 0, 0, error) : status;
}

int terms_advance(struct terms *m, struct terms_set *set, struct nacre_error *error)
{
    double objective = 0;
    int status = NACRE_OK;
    set->viewed = 0;
    if (!set->placed) {
        status = find_all_kernels(m, set, error);
    }
    while (status == NACRE_OK && !set->settled) {
        status = visit(m, set, 0, set->tracks[0].next, set->tracks[m->sides - 1].next,
                       is_exact(m, set) ? TERMS_STEP_EXACT : TERMS_STEP, m->data->grid.window / 2,
                       error);
        if (status == NACRE_OK) {
            status = collect(m, set, &objective, error);
        }
        if (status == NACRE_OK && objective <= set->objective) {
            accept(m, set, objective);
            return make_step(m, set, set->share, set->burst, error);
        }
        if (status == NACRE_OK) {
            status = refuse(m, set, error);
        }
    }
    return status;
}

int terms_view(struct terms *m, struct terms_set *set, struct nacre_error *error)
{
    int status = NACRE_OK;
    if (!set->placed) {
        status = find_all_kernels(m, set, error);
    }
    if (status == NACRE_OK && !set->viewed && !set->settled) {
        status = visit(m, set, 0, set->tracks[0].next, set->tracks[m->sides - 1].next, 0,
                       m->data->grid.window / 2, error);
        if (status == NACRE_OK) {
            status = collect(m, set, &set->next_objective, error);
        }
        set->viewed = status == NACRE_OK;
    }
    return status;
}

bool terms_is_next_better(const struct terms_set *set)
{
    return set->viewed && set->next_objective <= set->objective;
}
