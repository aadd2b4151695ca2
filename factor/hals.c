/* The method hals behind its seam: its kernels and buffers, reading, writing, saving and loading its state. */
#include "factor/hals.h"

#include "factor/hals_steps.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const struct opencl_source hals_cl;

/* Cells may take this share of a channel's responses as floats. */
#define FAR_SHARE 0.5

struct hals_options hals_options_default(void)
{
    return (struct hals_options){.far = 1};
}

static struct hals_tile choose_tile(int lanes, int terms)
{
    /* Sums held in registers: rows x group in phase 2, tile^2 in phase 3; 32 registers with 16 lanes, else 16. */
    static const int wide[] = {10, 8, 6}, narrow[] = {6, 5, 4};
    const int *groups = lanes >= 16 ? wide : narrow;
    struct hals_tile best = {.rows = terms <= HALS_TERMS / 4 ? 2 : 1, .tile = lanes >= 16 ? 4 : 3};
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
    static const char *const names[HALS_KERNEL_COUNT] = {"descend_f", "descend_h",
                                                         "measure_objective", "extrapolate"};
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
    for (int i = 0; i < HALS_KERNEL_COUNT; i++) {
        cl_int status = CL_SUCCESS;
        m->kernels[i] = clCreateKernel(m->program, names[i], &status);
        if (opencl_check(m->layout.opencl, status, names[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

static int place_track(struct hals *m, struct hals_track *track, struct nacre_error *error)
{
    cl_mem *factors[] = {&track->good, &track->next, &track->last, &track->fresh};
    int status = NACRE_OK;
    for (size_t i = 0; i < sizeof factors / sizeof *factors && status == NACRE_OK; i++) {
        status = layout_make_factor(&m->layout, factors[i], error);
    }
    return status;
}

static void release_track(const struct hals_track *track)
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

static int step(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    struct hals_channel *c = &m->channels[channel];
    int status = hals_advance(m, channel, error);
    if (objective) {
        *objective = c->objective;
    }
    return status;
}

static int measure(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    const struct hals_channel *c = &m->channels[channel];
    int status = hals_view(m, channel, error);
    *objective = hals_is_next_better(c) ? c->next_objective : c->objective;
    return status;
}

static int read_factors(struct method *method, int channel, float *f, float *h,
                        struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    const struct hals_channel *c = &m->channels[channel];
    int status = hals_view(m, channel, error);
    bool next = hals_is_next_better(c);
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
static int begin_channel(struct hals *m, struct hals_channel *c, struct nacre_error *error)
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
    struct hals_channel *c = &m->channels[channel];
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

static size_t state_size(const struct method *method, int channel)
{
    (void)channel; /* of all alike */
    const struct hals *m = (const struct hals *)method;
    return sizeof(struct saved) + SAVED_FACTORS * saved_floats(m) * sizeof(float);
}

static void list_factors(const struct hals_channel *c, cl_mem factors[SAVED_FACTORS])
{
    const struct hals_track *tracks[] = {&c->f, &c->h};
    for (int i = 0; i < 2; i++) {
        *factors++ = tracks[i]->good;
        *factors++ = tracks[i]->next;
        *factors++ = tracks[i]->last;
    }
}

static int save_state(struct method *method, int channel, void *state, struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    const struct hals_channel *c = &m->channels[channel];
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
    struct hals_channel *c = &m->channels[channel];
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
         HALS_SWEEPS);
    if (hals_is_exact(m, NULL)) {
        tell(to, "normal matrices", "exact, from all %d columns and rows of the window", r->window);
    } else {
        tell(to, "normal matrices",
             "exact within %d of the centre, beyond it summed over cells of %d x %d points; exact "
             "where that overshoots",
             HALS_NEAR, CURVATURE_CELL, CURVATURE_CELL);
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
    for (int i = 0; i < HALS_KERNEL_COUNT; i++) {
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
    struct hals_channel *c = &m->channels[channel];
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
    m->options.far &= curvature_bytes(m->layout.problem, HALS_NEAR, pairs) <=
                      FAR_SHARE * (double)m->layout.problem->responses->size * sizeof(float);
    if (status == NACRE_OK && m->options.far) {
        status = curvature_begin(&m->curvature, &m->layout, m->program, HALS_NEAR, m->tile.tile,
                                 pairs, error);
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
