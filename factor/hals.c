/* Steps of block coordinate descent: what is extrapolated, kept and taken back. The arithmetic is in hals.cl. */
#include "factor/hals.h"

#include "factor/curvature.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const struct opencl_source hals_cl;

/* Extrapolation as Ang and Gillis 2019 set it: the share of the last change that is added starts at FIRST, grows by
 * GROWTH up to a limit that itself grows by LIMIT_GROWTH, and is divided by SHRINK after a step not taken. */
#define PLAIN        3 /* steps at the start that are not extrapolated */
#define FIRST        0.5F
#define GROWTH       1.05F
#define LIMIT_GROWTH 1.01F
#define SHRINK       1.5F

/* Passes over the terms; entries so near to the centre count one by one in the normal matrices. */
enum { SWEEPS = 10, NEAR = 3 };

/* Cells may take this share of a channel's responses as floats. */
#define FAR_SHARE 0.5

enum kernel_name { DESCEND_F, DESCEND_H, MEASURE, EXTRAPOLATE, KERNEL_COUNT };

/* The register tile of the kernels; see hals.cl. */
struct tile {
    int rows, group, tile;
};

/* One factor of one channel. */
struct track {
    cl_mem good;  /* of the model: the last that was found not to raise the objective */
    cl_mem next;  /* extrapolated from it: where the next step starts, if that proves good */
    cl_mem last;  /* the last best step, before extrapolation */
    cl_mem fresh; /* the best step being made */
};

/* The state of one channel. */
struct channel {
    struct track f, h;
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
    struct tile tile;
    cl_program program;
    cl_kernel kernels[KERNEL_COUNT];
    size_t items; /* work-items of a launch */
    struct channel channels[RESPONSES_CHANNELS];
    cl_mem scratch, sums;
    size_t sum_count;
    float *partials; /* sums of the objective, a pair a work-item */
};

struct hals_options hals_options_default(void)
{
    return (struct hals_options){.far = 1};
}

static struct tile choose_tile(int lanes, int terms)
{
    /* Sums held in registers: rows x group in phase 2, tile^2 in phase 3; 32 registers with 16 lanes, else 16. */
    static const int wide[] = {10, 8, 6}, narrow[] = {6, 5, 4};
    const int *groups = lanes >= 16 ? wide : narrow;
    struct tile best = {.rows = terms <= HALS_TERMS / 4 ? 2 : 1, .tile = lanes >= 16 ? 4 : 3};
    int best_planes = 0;
    for (int i = 0; i < 3; i++) {
        int planes = (terms + groups[i] - 1) / groups[i] * groups[i];
        if (i == 0 || planes < best_planes) {
            best.group = groups[i];
            best_planes = planes;
        }
    }
    return best;
}

static int round_up(int value, int unit)
{
    return (value + unit - 1) / unit * unit;
}

static int build(struct hals *m, struct nacre_error *error)
{
    static const char *const names[KERNEL_COUNT] = {"descend_f", "descend_h", "measure_objective",
                                                    "extrapolate"};
    const struct problem *p = m->layout.problem;
    char options[256];
    (void)snprintf(options, sizeof options,
                   "-DLANES=%d -DTERMS=%d -DWINDOW=%d -DROWS=%d -DGROUP=%d -DTILE=%d "
                   "-DCLUSTERED=%d -DMASKED=%d -DHALF=%d",
                   p->responses->lanes, p->terms, round_up(p->responses->window, 64), m->tile.rows,
                   m->tile.group, m->tile.tile, p->clusters > 1, p->responses->mask_needed,
                   p->responses->half);
    if (opencl_build(m->layout.opencl, &hals_cl, options, &m->program, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (int i = 0; i < KERNEL_COUNT; i++) {
        cl_int status = CL_SUCCESS;
        m->kernels[i] = clCreateKernel(m->program, names[i], &status);
        if (opencl_check(m->layout.opencl, status, names[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

static int place_track(struct hals *m, struct track *track, struct nacre_error *error)
{
    cl_mem *factors[] = {&track->good, &track->next, &track->last, &track->fresh};
    int status = NACRE_OK;
    for (size_t i = 0; i < sizeof factors / sizeof *factors && status == NACRE_OK; i++) {
        status = layout_make_factor(&m->layout, factors[i], error);
    }
    return status;
}

static void release_track(const struct track *track)
{
    layout_release(track->good);
    layout_release(track->next);
    layout_release(track->last);
    layout_release(track->fresh);
}

static int copy_factor(struct hals *m, cl_mem from, cl_mem to, struct nacre_error *error)
{
    const size_t bytes = m->layout.factor_floats * sizeof(float);
    return opencl_check(
        m->layout.opencl,
        clEnqueueCopyBuffer(m->layout.opencl->queue, from, to, 0, 0, bytes, 0, NULL, NULL),
        "cannot copy a factor", error);
}

/* Whether normal matrices are summed entry by entry: for a channel now, or (NULL) from the start. */
static bool is_exact(const struct hals *m, const struct channel *c)
{
    return (c && c->exact) || !m->options.far || NEAR >= m->layout.sizes.window / 2;
}

/* Set the arguments of a kernel that visits entries, and run it. */
static int visit(struct hals *m, int channel, enum kernel_name name, cl_mem own, cl_mem other,
                 cl_mem next, struct nacre_error *error)
{
    const struct layout *l = &m->layout;
    const struct channel *c = &m->channels[channel];
    const cl_int half = l->sizes.window / 2, sweeps = SWEEPS;
    const bool exact = is_exact(m, c);
    const cl_int near = exact ? half : NEAR;
    const cl_mem buffers[] = {l->channels[channel].responses,
                              l->channels[channel].mask,
                              l->labels,
                              l->channels[channel].kernels,
                              own,
                              other,
                              next,
                              m->curvature.far,
                              m->curvature.channels[channel].masses,
                              m->scratch,
                              m->sums};
    const cl_int numbers[] = {near, sweeps};
    const size_t one = 1;
    cl_kernel kernel = m->kernels[name];
    cl_uint argument = 0;
    cl_int status = CL_SUCCESS;
    if (name != MEASURE && !exact &&
        curvature_gather(&m->curvature, channel, other, name == DESCEND_H, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (size_t i = 0; i < sizeof buffers / sizeof *buffers && status == CL_SUCCESS; i++) {
        status = clSetKernelArg(kernel, argument++, sizeof(cl_mem), &buffers[i]);
    }
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers && status == CL_SUCCESS; i++) {
        status = clSetKernelArg(kernel, argument++, sizeof(cl_int), &numbers[i]);
    }
    if (status == CL_SUCCESS) {
        status = clSetKernelArg(kernel, argument++, sizeof m->curvature.cells, &m->curvature.cells);
    }
    if (status == CL_SUCCESS) {
        status = clSetKernelArg(kernel, argument, sizeof l->sizes, &l->sizes);
    }
    if (status == CL_SUCCESS) {
        status = clEnqueueNDRangeKernel(l->opencl->queue, kernel, 1, NULL, &m->items, &one, 0, NULL,
                                        NULL);
    }
    return opencl_check(l->opencl, status, "cannot run a step", error);
}

static int extrapolate(struct hals *m, const struct track *track, float share,
                       struct nacre_error *error)
{
    cl_kernel kernel = m->kernels[EXTRAPOLATE];
    const cl_mem buffers[] = {track->fresh, track->last, track->next};
    cl_int status = CL_SUCCESS;
    for (cl_uint i = 0; i < 3 && status == CL_SUCCESS; i++) {
        status = clSetKernelArg(kernel, i, sizeof(cl_mem), &buffers[i]);
    }
    if (status == CL_SUCCESS) {
        status = clSetKernelArg(kernel, 3, sizeof share, &share);
    }
    if (status == CL_SUCCESS) {
        status = clEnqueueNDRangeKernel(m->layout.opencl->queue, kernel, 1, NULL,
                                        &m->layout.factor_floats, NULL, 0, NULL, NULL);
    }
    return opencl_check(m->layout.opencl, status, "cannot extrapolate", error);
}

/* The objective that the last launch summed. */
static int collect(struct hals *m, double *objective, struct nacre_error *error)
{
    size_t count = 2 * m->items;
    double sum = 0;
    cl_int status = clEnqueueReadBuffer(m->layout.opencl->queue, m->sums, CL_TRUE, 0,
                                        count * sizeof *m->partials, m->partials, 0, NULL, NULL);
    for (size_t i = 0; i < count && status == CL_SUCCESS; i++) {
        sum += m->partials[i];
    }
    *objective = sum / 2;
    return opencl_check(m->layout.opencl, status, "cannot read the objective", error);
}

static void swap(cl_mem *a, cl_mem *b)
{
    cl_mem kept = *a;
    *a = *b;
    *b = kept;
}

/* From the model, with H's best step made: carry H on along its last change, then the same with F. The result waits in
 * `next` of both. */
static int finish_step(struct hals *m, int channel, float share, struct nacre_error *error)
{
    struct channel *c = &m->channels[channel];
    int status = extrapolate(m, &c->h, share, error);
    if (status == NACRE_OK) {
        status = visit(m, channel, DESCEND_F, c->f.good, c->h.next, c->f.fresh, error);
    }
    if (status == NACRE_OK) {
        status = extrapolate(m, &c->f, share, error);
    }
    swap(&c->f.last, &c->f.fresh);
    swap(&c->h.last, &c->h.fresh);
    return status;
}

/* Take `next`, from where H's best step is made already, as the model. */
static void accept(struct channel *c, double objective)
{
    swap(&c->f.good, &c->f.next);
    swap(&c->h.good, &c->h.next);
    c->objective = objective;
    if (c->accepted == PLAIN) {
        c->share = FIRST;
    } else if (c->refused == 0) {
        c->share = fminf(c->share_limit, GROWTH * c->share);
        c->share_limit = fminf(1, LIMIT_GROWTH * c->share_limit);
    }
    c->accepted++;
    c->refused = 0;
}

/* The step that waits in `next` raises the objective: make it again from the model without extrapolation; if that was
 * done, with exact normal matrices; if that was done, the model is as good as float arithmetic makes it. */
static int refuse(struct hals *m, int channel, struct nacre_error *error)
{
    struct channel *c = &m->channels[channel];
    int status = NACRE_OK;
    /* A step that was not extrapolated would be the same again. */
    c->refused = c->refused == 0 && c->share == 0 ? 2 : c->refused + 1;
    c->settled = c->refused > 2;
    if (c->settled) {
        return NACRE_OK;
    }
    if (c->refused == 1) {
        c->share_limit = c->share;
        c->share /= SHRINK;
    } else {
        if (!c->exact && c->accepted > PLAIN) { /* it was shortened for what the matrices did */
            c->share = FIRST;
            c->share_limit = 1;
        }
        c->exact = 1;
        status = visit(m, channel, DESCEND_H, c->h.good, c->f.good, c->h.last, error);
    }
    swap(&c->h.fresh, &c->h.last); /* the best step of H from the model */
    return status == NACRE_OK ? finish_step(m, channel, 0, error) : status;
}

/* Make sure that what waits in `next` does not raise the objective, and take it as the model; then make the step from
 * there, which waits in turn. */
static int advance(struct hals *m, int channel, struct nacre_error *error)
{
    struct channel *c = &m->channels[channel];
    double objective = 0;
    int status = NACRE_OK;
    c->viewed = 0;
    while (status == NACRE_OK && !c->settled) {
        status = visit(m, channel, DESCEND_H, c->h.next, c->f.next, c->h.fresh, error);
        if (status == NACRE_OK) {
            status = collect(m, &objective, error);
        }
        if (status == NACRE_OK && objective <= c->objective) {
            accept(c, objective);
            return finish_step(m, channel, c->share, error);
        }
        if (status == NACRE_OK) {
            status = refuse(m, channel, error);
        }
    }
    return status;
}

static int step(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    struct channel *c = &m->channels[channel];
    int status = advance(m, channel, error);
    if (objective) {
        *objective = c->objective;
    }
    return status;
}

/* Find out which is better, the model or what waits. */
static int view(struct hals *m, int channel, struct nacre_error *error)
{
    struct channel *c = &m->channels[channel];
    int status = NACRE_OK;
    if (!c->viewed && !c->settled) {
        status = visit(m, channel, MEASURE, c->h.next, c->f.next, c->h.fresh, error);
        if (status == NACRE_OK) {
            status = collect(m, &c->next_objective, error);
        }
        c->viewed = status == NACRE_OK;
    }
    return status;
}

static bool is_next_better(const struct channel *c)
{
    return c->viewed && c->next_objective <= c->objective;
}

static int measure(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    const struct channel *c = &m->channels[channel];
    int status = view(m, channel, error);
    *objective = is_next_better(c) ? c->next_objective : c->objective;
    return status;
}

static int read_factors(struct method *method, int channel, float *f, float *h,
                        struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    const struct channel *c = &m->channels[channel];
    int status = view(m, channel, error);
    bool next = is_next_better(c);
    if (status == NACRE_OK) {
        status = layout_read_factor(&m->layout, next ? c->f.next : c->f.good, f, error);
    }
    return status == NACRE_OK
               ? layout_read_factor(&m->layout, next ? c->h.next : c->h.good, h, error)
               : status;
}

/* Set F to zero where nothing was measured: no entry moves it, and it must not weigh in the normal matrices. */
static int clear_unmeasured(struct hals *m, cl_mem f, struct nacre_error *error)
{
    const struct responses *r = m->layout.problem->responses;
    size_t points = (size_t)r->width * (size_t)r->height;
    size_t count = (size_t)m->layout.sizes.terms * points;
    int status = NACRE_OK;
    if (r->measured_count == points) {
        return NACRE_OK;
    }
    float *values = malloc(count * sizeof *values);
    if (!values) {
        return nacre_fail_memory(error, "a factor");
    }
    status = layout_read_factor(&m->layout, f, values, error);
    for (size_t i = 0; i < count; i++) {
        values[i] = r->measured[i % points] ? values[i] : 0;
    }
    if (status == NACRE_OK) {
        status = layout_write_factor(&m->layout, f, values, error);
    }
    free(values);
    return status;
}

/* Start from the factors in `next`. */
static int begin_channel(struct hals *m, struct channel *c, struct nacre_error *error)
{
    c->share = 0;
    c->share_limit = 1;
    c->objective = INFINITY;
    c->accepted = c->refused = c->exact = c->settled = c->viewed = 0;
    int status = clear_unmeasured(m, c->f.next, error);
    if (status == NACRE_OK) {
        status = copy_factor(m, c->f.next, c->f.last, error);
    }
    return status == NACRE_OK ? copy_factor(m, c->h.next, c->h.last, error) : status;
}

static int write_factors(struct method *method, int channel, const float *f, const float *h,
                         struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    struct channel *c = &m->channels[channel];
    int status = layout_write_factor(&m->layout, c->f.next, f, error);
    if (status == NACRE_OK) {
        status = layout_write_factor(&m->layout, c->h.next, h, error);
    }
    return status == NACRE_OK ? begin_channel(m, c, error) : status;
}

/* Saving and loading: the part of a channel's state that is no factor, then the model, what waits and the last best step
 * of F and of H. Buffers being made carry nothing over. */
struct saved {
    double objective;
    float share, share_limit;
    int32_t accepted, refused, exact, settled;
};

enum { SAVED_FACTORS = 6 };

static size_t saved_floats(const struct hals *m) /* of one factor */
{
    const struct problem *p = m->layout.problem;
    return (size_t)p->terms * (size_t)p->responses->height * (size_t)p->responses->width;
}

static size_t state_size(const struct method *method)
{
    const struct hals *m = (const struct hals *)method;
    return sizeof(struct saved) + SAVED_FACTORS * saved_floats(m) * sizeof(float);
}

static void list_factors(const struct channel *c, cl_mem factors[SAVED_FACTORS])
{
    const struct track *tracks[] = {&c->f, &c->h};
    for (int i = 0; i < 2; i++) {
        *factors++ = tracks[i]->good;
        *factors++ = tracks[i]->next;
        *factors++ = tracks[i]->last;
    }
}

static int save_state(struct method *method, int channel, void *state, struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    const struct channel *c = &m->channels[channel];
    const struct saved saved = {.objective = c->objective,
                                .share = c->share,
                                .share_limit = c->share_limit,
                                .accepted = c->accepted,
                                .refused = c->refused,
                                .exact = c->exact,
                                .settled = c->settled};
    cl_mem factors[SAVED_FACTORS];
    float *to = (float *)((char *)state + sizeof saved);
    int status = NACRE_OK;
    list_factors(c, factors);
    memcpy(state, &saved, sizeof saved);
    for (int i = 0; i < SAVED_FACTORS && status == NACRE_OK; i++) {
        status =
            layout_read_factor(&m->layout, factors[i], to + (size_t)i * saved_floats(m), error);
    }
    return status;
}

static int load_state(struct method *method, int channel, const void *state,
                      struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    struct channel *c = &m->channels[channel];
    const float *from = (const float *)((const char *)state + sizeof(struct saved));
    cl_mem factors[SAVED_FACTORS];
    struct saved saved;
    int status = NACRE_OK;
    memcpy(&saved, state, sizeof saved);
    if (saved.accepted < 0 || saved.refused < 0 || !isfinite(saved.share) ||
        !isfinite(saved.share_limit) || isnan(saved.objective)) {
        return nacre_fail(error, "the saved state of channel %d is none of hals", channel);
    }
    list_factors(c, factors);
    for (int i = 0; i < SAVED_FACTORS && status == NACRE_OK; i++) {
        status =
            layout_write_factor(&m->layout, factors[i], from + (size_t)i * saved_floats(m), error);
    }
    c->objective = saved.objective;
    c->share = saved.share;
    c->share_limit = saved.share_limit;
    c->accepted = saved.accepted;
    c->refused = saved.refused;
    c->exact = saved.exact;
    c->settled = saved.settled;
    c->viewed = 0;
    return status;
}

static void explain(const struct method *method, const struct listener *to)
{
    const struct hals *m = (const struct hals *)method;
    const struct responses *r = m->layout.problem->responses;
    tell(to, "method", "hals: block coordinate descent, %d sweeps, extrapolated with restart",
         SWEEPS);
    if (is_exact(m, NULL)) {
        tell(to, "normal matrices", "exact, from all %d columns and rows of the window", r->window);
    } else {
        tell(to, "normal matrices",
             "exact within %d of the centre, beyond it summed over cells of %d x %d points; exact "
             "where that overshoots",
             NEAR, CURVATURE_CELL, CURVATURE_CELL);
    }
    tell(to, "tile", "%d rows x %d terms at a time, %d lanes", m->tile.rows, m->tile.group,
         r->lanes);
    tell(to, "device memory", "%.1f MiB of factors, beside the responses",
         8 * (double)(m->layout.factor_floats * sizeof(float)) * r->channels * 0x1p-20);
}

static void hals_free(struct method *method)
{
    struct hals *m = (struct hals *)method;
    (void)clFinish(
        m->layout.opencl->queue); /* kernels may still read memory that its owner frees next */
    for (int i = 0; i < RESPONSES_CHANNELS; i++) {
        release_track(&m->channels[i].f);
        release_track(&m->channels[i].h);
    }
    layout_release(m->scratch);
    layout_release(m->sums);
    for (int i = 0; i < KERNEL_COUNT; i++) {
        if (m->kernels[i]) {
            (void)clReleaseKernel(m->kernels[i]);
        }
    }
    curvature_finish(&m->curvature);
    if (m->program) {
        (void)clReleaseProgram(m->program);
    }
    layout_finish(&m->layout);
    free(m->partials);
    free(m);
}

static const struct method_ops hals_ops = {
    .name = "hals",
    .step = step,
    .measure = measure,
    .read = read_factors,
    .write = write_factors,
    .state_size = state_size,
    .save = save_state,
    .load = load_state,
    .explain = explain,
    .free = hals_free,
};

/* What the work-items hold; see struct parts in hals.cl. */
static int make_scratch(struct hals *m, struct nacre_error *error)
{
    const struct responses *r = m->layout.problem->responses;
    size_t planes = (size_t)round_up(m->layout.sizes.terms, m->tile.group);
    size_t rows = (size_t)m->tile.rows;
    size_t gradient = (size_t)r->blocks * planes * rows * (size_t)r->lanes;
    size_t strips = m->layout.problem->clusters > 1 ? rows * (r->row + 2 * r->lead) : 0;
    return layout_make_buffer(&m->layout, m->items * (gradient + strips) * sizeof(float), NULL,
                              false, &m->scratch, error);
}

static int prepare_sums(struct hals *m, struct nacre_error *error)
{
    size_t count = 2 * m->items;
    m->partials = malloc(count * sizeof *m->partials);
    return m->partials
               ? layout_make_buffer(&m->layout, count * sizeof(float), NULL, false, &m->sums, error)
               : nacre_fail_memory(error, "the objective");
}

static int start_channel(struct hals *m, int channel, struct nacre_error *error)
{
    struct channel *c = &m->channels[channel];
    int status = place_track(m, &c->f, error);
    if (status == NACRE_OK) {
        status = place_track(m, &c->h, error);
    }
    if (status == NACRE_OK) {
        status = layout_start_factor(&m->layout, channel, false, c->f.next, error);
    }
    if (status == NACRE_OK) {
        status = layout_start_factor(&m->layout, channel, true, c->h.next, error);
    }
    return status == NACRE_OK ? begin_channel(m, c, error) : status;
}

static int prepare(struct hals *m, struct nacre_error *error)
{
    int tiles = round_up(m->layout.sizes.terms, m->tile.tile) / m->tile.tile;
    int pairs = tiles * (tiles + 1) / 2 * m->tile.tile * m->tile.tile;
    int status = build(m, error);
    if (status == NACRE_OK) {
        status = make_scratch(m, error);
    }
    if (status == NACRE_OK) {
        status = prepare_sums(m, error);
    }
    m->options.far &= curvature_bytes(m->layout.problem, NEAR, pairs) <=
                      FAR_SHARE * (double)m->layout.problem->responses->size * sizeof(float);
    if (status == NACRE_OK && m->options.far) {
        status = curvature_begin(&m->curvature, &m->layout, m->program, NEAR, m->tile.tile, pairs,
                                 error);
    }
    for (int i = 0; i < m->layout.problem->responses->channels && status == NACRE_OK; i++) {
        status = start_channel(m, i, error);
    }
    return status;
}

int hals_new(const struct opencl *opencl, const struct problem *problem,
             const struct hals_options *options, struct method **method, struct nacre_error *error)
{
    struct hals *m = NULL;
    *method = NULL;
    if (problem->terms > HALS_TERMS) {
        return nacre_fail(error,
                          "%d terms are too many for hals, which takes %d at most; use "
                          "--method mu",
                          problem->terms, HALS_TERMS);
    }
    m = calloc(1, sizeof *m);
    if (!m) {
        return nacre_fail_memory(error, "the method");
    }
    const struct responses *r = problem->responses;
    m->method.ops = &hals_ops;
    m->options = options ? *options : hals_options_default();
    m->tile = choose_tile(r->lanes, problem->terms);
    m->items = (size_t)((r->height + m->tile.rows - 1) / m->tile.rows);
    int planes = round_up(problem->terms, m->tile.group);
    int tiled = round_up(problem->terms, m->tile.tile);
    int status = layout_begin(&m->layout, opencl, problem, planes > tiled ? planes : tiled,
                              m->tile.rows, error);
    if (status == NACRE_OK) {
        status = prepare(m, error);
    }
    if (status == NACRE_OK) {
        *method = &m->method;
    } else {
        hals_free(&m->method);
    }
    return status;
}
