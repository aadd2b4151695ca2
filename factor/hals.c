/* Steps of block coordinate descent: what is extrapolated, kept and taken back. The arithmetic is in hals.cl. */
#include "factor/hals.h"

#include "factor/layout.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const struct opencl_source hals_cl;

/* Extrapolation as Ang and Gillis 2019 set it: the share of the last change that is added starts at FIRST, grows by
 * GROWTH up to a limit that itself grows by LIMIT_GROWTH, and is divided by SHRINK after a step not taken. */
#define FIRST        0.5F
#define GROWTH       1.05F
#define LIMIT_GROWTH 1.01F
#define SHRINK       1.5F

enum { SWEEPS = 5, NEAR = 3, FAR_STRIDE = 4 };

enum kernel_name { DESCEND_F, DESCEND_H, MEASURE, EXTRAPOLATE, KERNEL_COUNT };

/* The register tile of the kernels; see hals.cl. */
struct tile {
    int rows, group, tile;
};

/* A quadrature over the window: which columns, and the weights of columns and rows. */
struct level {
    cl_mem columns, column_weights, row_weights;
    cl_int count;
};

/* The state of one channel. The current model is last_f with model_h. */
struct channel {
    cl_mem last_f, ahead_f, new_f;        /* F: before extrapolation, after it, being made */
    cl_mem last_h, model_h, new_h, try_h; /* H: the same, and the one that may become the model */
    cl_mem from_f, from_h;                /* where the next step starts: some of the above */
    float share, share_limit;             /* of the extrapolation */
    double objective;                     /* of the model, on `level` */
    int level;                            /* 0: a few entries; 1: all */
    int pilot_steps;
    int refused;  /* steps not taken since the last that was */
    int exact;    /* quadrature overshoots here: exact normal equations */
    int measured; /* `objective` is known */
};

struct hals {
    struct method method;
    struct layout layout;
    struct hals_options options;
    struct tile tile;
    size_t items[2]; /* of a launch: blocks, groups of rows */
    cl_program program;
    cl_kernel kernels[KERNEL_COUNT];
    struct level levels[2];
    struct channel channels[RESPONSES_CHANNELS];
    cl_mem sums;
    float *partials; /* sums of the objective, a pair a work-item */
};

struct hals_options hals_options_default(void)
{
    return (struct hals_options){.quadrature = 1, .pilot = 24, .patience = 0.02};
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
    static const char *const names[KERNEL_COUNT] = {"descend_f", "descend_h", "measure_level",
                                                    "extrapolate"};
    const struct problem *p = m->layout.problem;
    char options[256];
    (void)snprintf(options, sizeof options,
                   "-DLANES=%d -DTERMS=%d -DWINDOW=%d -DROWS=%d -DGROUP=%d -DTILE=%d -DSWEEPS=%d "
                   "-DCLUSTERED=%d -DMASKED=%d -DHALF=%d",
                   p->responses->lanes, p->terms, round_up(p->responses->window, 64), m->tile.rows,
                   m->tile.group, m->tile.tile, SWEEPS, p->clusters > 1, p->responses->mask_needed,
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

/* Weights of a window's rows, which are those of its columns too. Few: the NEAR entries on each side of the middle count
 * for themselves, of the others every FAR_STRIDE-th counts for its neighbours, the outermost ones for what is left. */
static void weigh(int window, int few, float *weights)
{
    int half = window / 2;
    for (int e = 0; e < window; e++) {
        weights[e] = few ? 0.0F : 1.0F;
    }
    for (int d = 0; d <= half && few; d++) {
        int first = NEAR + 1 + (d - NEAR - 1) / FAR_STRIDE * FAR_STRIDE; /* of the neighbours */
        int end = first + FAR_STRIDE <= half + 1 ? first + FAR_STRIDE : half + 1;
        int middle = first + (end - first) / 2;
        int entry = d <= NEAR ? d : middle;
        weights[half + entry] += 1;
        weights[half - entry] += entry > 0 ? 1 : 0;
    }
}

static int place_level(struct hals *m, int few, struct level *level, struct nacre_error *error)
{
    int window = m->layout.sizes.window, status = NACRE_FAILED;
    size_t count = (size_t)window;
    float *weights = calloc(count, sizeof *weights);
    float *column_weights = calloc(count, sizeof *column_weights);
    cl_int *columns = calloc(count, sizeof *columns);
    if (!weights || !column_weights || !columns) {
        status = nacre_fail_memory(error, "the quadrature");
        goto out;
    }
    weigh(window, few, weights);
    for (int e = 0; e < window; e++) {
        if (weights[e] > 0) {
            columns[level->count] = e;
            column_weights[level->count++] = weights[e];
        }
    }
    status = layout_make_buffer(&m->layout, count * sizeof *columns, columns, false,
                                &level->columns, error);
    if (status == NACRE_OK) {
        status = layout_make_buffer(&m->layout, count * sizeof *weights, column_weights, false,
                                    &level->column_weights, error);
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(&m->layout, count * sizeof *weights, weights, false,
                                    &level->row_weights, error);
    }
out:
    free(weights);
    free(column_weights);
    free(columns);
    return status;
}

static int place_channel(struct hals *m, int channel, struct nacre_error *error)
{
    struct channel *c = &m->channels[channel];
    cl_mem *factors[] = {&c->last_f,  &c->ahead_f, &c->new_f, &c->last_h,
                         &c->model_h, &c->new_h,   &c->try_h};
    int status = NACRE_OK;
    for (size_t i = 0; i < sizeof factors / sizeof *factors && status == NACRE_OK; i++) {
        status = layout_make_factor(&m->layout, factors[i], error);
    }
    return status;
}

/* From now on step from the model. */
static int restart(struct hals *m, struct channel *c, struct nacre_error *error)
{
    const size_t bytes = m->layout.factor_floats * sizeof(float);
    c->from_f = c->last_f;
    c->from_h = c->model_h;
    return opencl_check(m->layout.opencl,
                        clEnqueueCopyBuffer(m->layout.opencl->queue, c->model_h, c->last_h, 0, 0,
                                            bytes, 0, NULL, NULL),
                        "cannot copy a factor", error);
}

/* Set the arguments of a kernel that visits entries, and run it. */
static int visit(struct hals *m, int channel, enum kernel_name name, cl_mem own, cl_mem other,
                 cl_mem next, struct nacre_error *error)
{
    const struct layout *l = &m->layout;
    const struct channel *c = &m->channels[channel];
    const struct level *entries = &m->levels[c->level];
    const struct level *few =
        &m->levels[c->level == 1 && (c->exact || !m->options.quadrature) ? 1 : 0];
    enum { BUFFERS = 13 };
    const cl_mem buffers[BUFFERS] = {l->channels[channel].responses,
                                     l->channels[channel].mask,
                                     l->labels,
                                     l->channels[channel].kernels,
                                     own,
                                     other,
                                     next,
                                     entries->columns,
                                     entries->column_weights,
                                     entries->row_weights,
                                     few->columns,
                                     few->column_weights,
                                     few->row_weights};
    cl_kernel kernel = m->kernels[name];
    const size_t one[] = {1, 1};
    cl_uint i = 0;
    cl_int status = CL_SUCCESS;
    for (; i < BUFFERS && status == CL_SUCCESS; i++) {
        status = clSetKernelArg(kernel, i, sizeof(cl_mem), &buffers[i]);
    }
    if (status == CL_SUCCESS) {
        status = clSetKernelArg(kernel, i++, sizeof entries->count, &entries->count);
    }
    if (status == CL_SUCCESS) {
        status = clSetKernelArg(kernel, i++, sizeof few->count, &few->count);
    }
    if (status == CL_SUCCESS) {
        status = clSetKernelArg(kernel, i, sizeof l->sizes, &l->sizes);
    }
    if (status == CL_SUCCESS) {
        status =
            clEnqueueNDRangeKernel(l->opencl->queue, kernel, 2, NULL, m->items, one, 0, NULL, NULL);
    }
    return opencl_check(l->opencl, status, "cannot run a step", error);
}

static int extrapolate(struct hals *m, cl_mem now, cl_mem before, cl_mem next, float share,
                       struct nacre_error *error)
{
    cl_kernel kernel = m->kernels[EXTRAPOLATE];
    const cl_mem buffers[] = {now, before, next};
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

/* The objective of f and h on the channel's level. */
static int measure_pair(struct hals *m, int channel, cl_mem f, cl_mem h, double *objective,
                        struct nacre_error *error)
{
    size_t count = 2 * m->items[0] * m->items[1];
    double sum = 0;
    int status = visit(m, channel, MEASURE, f, h, m->sums, error);
    if (status == NACRE_OK) {
        status = opencl_check(m->layout.opencl,
                              clEnqueueReadBuffer(m->layout.opencl->queue, m->sums, CL_TRUE, 0,
                                                  count * sizeof *m->partials, m->partials, 0, NULL,
                                                  NULL),
                              "cannot read the objective", error);
    }
    for (size_t i = 0; i < count; i++) {
        sum += m->partials[i];
    }
    *objective = sum / 2;
    return status;
}

static void swap(cl_mem *a, cl_mem *b)
{
    cl_mem kept = *a;
    *a = *b;
    *b = kept;
}

/* Take new_f with try_h as the model, and look ahead from it. */
static int accept(struct hals *m, struct channel *c, double objective, struct nacre_error *error)
{
    int status = extrapolate(m, c->new_f, c->last_f, c->ahead_f, c->share, error);
    swap(&c->last_f, &c->new_f);
    swap(&c->last_h, &c->new_h);
    swap(&c->model_h, &c->try_h);
    c->from_f = c->ahead_f;
    c->from_h = c->model_h;
    c->objective = objective;
    c->refused = 0;
    c->share = fminf(c->share_limit, GROWTH * c->share);
    c->share_limit = fminf(1, LIMIT_GROWTH * c->share_limit);
    return status;
}

/* Leave the model as it is; the next step starts from it with a shorter look ahead, then with none, then with exact
 * normal equations. */
static int refuse(struct hals *m, struct channel *c, struct nacre_error *error)
{
    c->share_limit = c->share;
    c->share = ++c->refused < 2 ? c->share / SHRINK : 0;
    if (c->refused > 2) {
        c->exact = 1;
    }
    return restart(m, c, error);
}

/* One step on the channel's level; afterwards `objective` is not above what it was. */
static int descend(struct hals *m, int channel, struct nacre_error *error)
{
    struct channel *c = &m->channels[channel];
    double objective = 0;
    float share = c->share;
    int status = visit(m, channel, DESCEND_H, c->from_h, c->from_f, c->new_h, error);
    if (status == NACRE_OK) {
        status = extrapolate(m, c->new_h, c->last_h, c->try_h, share, error);
    }
    if (status == NACRE_OK) {
        status = visit(m, channel, DESCEND_F, c->from_f, c->try_h, c->new_f, error);
    }
    if (status == NACRE_OK) {
        status = measure_pair(m, channel, c->new_f, c->try_h, &objective, error);
    }
    if (status != NACRE_OK) {
        return status;
    }
    if (objective <= c->objective) {
        status = accept(m, c, objective, error);
        c->share = c->share > 0 ? c->share : FIRST / 2;
        return status;
    }
    return refuse(m, c, error);
}

static int begin_level(struct hals *m, int channel, int level, struct nacre_error *error)
{
    struct channel *c = &m->channels[channel];
    c->level = level;
    c->refused = 0;
    c->measured = 1;
    return measure_pair(m, channel, c->last_f, c->model_h, &c->objective, error);
}

/* Steps on a few entries, until they bring little or are many. */
static int pilot(struct hals *m, int channel, struct nacre_error *error)
{
    struct channel *c = &m->channels[channel];
    int status = NACRE_OK;
    if (m->options.pilot > 0 && m->levels[0].count < m->levels[1].count) {
        int little = 0;
        status = begin_level(m, channel, 0, error);
        for (int i = 0; i < m->options.pilot && little < 2 && status == NACRE_OK; i++) {
            double before = c->objective;
            status = descend(m, channel, error);
            if (c->refused == 0) {
                little = c->objective > (1 - m->options.patience) * before ? little + 1 : 0;
            }
        }
    }
    return status == NACRE_OK ? begin_level(m, channel, 1, error) : status;
}

static int step(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    struct channel *c = &m->channels[channel];
    int status = c->measured ? NACRE_OK : pilot(m, channel, error);
    if (objective) {
        *objective = c->objective;
    }
    return status == NACRE_OK ? descend(m, channel, error) : status;
}

static int measure(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    struct channel *c = &m->channels[channel];
    if (c->measured) {
        *objective = c->objective;
        return NACRE_OK;
    }
    return measure_pair(m, channel, c->last_f, c->model_h, objective, error);
}

static int read_factors(struct method *method, int channel, float *f, float *h,
                        struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    struct channel *c = &m->channels[channel];
    int status = layout_read_factor(&m->layout, c->last_f, f, error);
    return status == NACRE_OK ? layout_read_factor(&m->layout, c->model_h, h, error) : status;
}

static int begin_channel(struct hals *m, struct channel *c, struct nacre_error *error)
{
    c->share = FIRST;
    c->share_limit = 1;
    c->level = 1;
    c->measured = 0;
    c->exact = 0;
    return restart(m, c, error);
}

static int write_factors(struct method *method, int channel, const float *f, const float *h,
                         struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    struct channel *c = &m->channels[channel];
    int status = layout_write_factor(&m->layout, c->last_f, f, error);
    if (status == NACRE_OK) {
        status = layout_write_factor(&m->layout, c->model_h, h, error);
    }
    return status == NACRE_OK ? begin_channel(m, c, error) : status;
}

/* Saving and loading: the part of a channel's state that is no factor, then F before and after extrapolation, H before
 * and after it. Buffers being made carry nothing over. */
struct saved {
    double objective;
    float share, share_limit;
    int32_t level, pilot_steps, refused, exact, measured, ahead;
};

enum { SAVED_FACTORS = 4 };

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

static int save_state(struct method *method, int channel, void *state, struct nacre_error *error)
{
    struct hals *m = (struct hals *)method;
    const struct channel *c = &m->channels[channel];
    const cl_mem factors[SAVED_FACTORS] = {c->last_f, c->ahead_f, c->last_h, c->model_h};
    const struct saved saved = {.objective = c->objective,
                                .share = c->share,
                                .share_limit = c->share_limit,
                                .level = c->level,
                                .pilot_steps = c->pilot_steps,
                                .refused = c->refused,
                                .exact = c->exact,
                                .measured = c->measured,
                                .ahead = c->from_f == c->ahead_f};
    float *to = (float *)((char *)state + sizeof saved);
    int status = NACRE_OK;
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
    const cl_mem factors[SAVED_FACTORS] = {c->last_f, c->ahead_f, c->last_h, c->model_h};
    const float *from = (const float *)((const char *)state + sizeof(struct saved));
    struct saved saved;
    int status = NACRE_OK;
    memcpy(&saved, state, sizeof saved);
    if (saved.level < 0 || saved.level > 1 || !isfinite(saved.share) ||
        !isfinite(saved.share_limit) || !isfinite(saved.objective)) {
        return nacre_fail(error, "the saved state of channel %d is none of hals", channel);
    }
    for (int i = 0; i < SAVED_FACTORS && status == NACRE_OK; i++) {
        status =
            layout_write_factor(&m->layout, factors[i], from + (size_t)i * saved_floats(m), error);
    }
    c->objective = saved.objective;
    c->share = saved.share;
    c->share_limit = saved.share_limit;
    c->level = saved.level;
    c->pilot_steps = saved.pilot_steps;
    c->refused = saved.refused;
    c->exact = saved.exact;
    c->measured = saved.measured;
    c->from_f = saved.ahead ? c->ahead_f : c->last_f;
    c->from_h = c->model_h;
    return status;
}

static void explain(const struct method *method, const struct listener *to)
{
    const struct hals *m = (const struct hals *)method;
    const struct problem *p = m->layout.problem;
    tell(to, "method", "hals: block coordinate descent, %d sweeps, extrapolated with restart",
         SWEEPS);
    if (m->options.quadrature && m->levels[0].count < m->levels[1].count) {
        tell(to, "normal equations",
             "by quadrature: %d of %d columns and rows of the window stand for all; exact where "
             "that overshoots",
             m->levels[0].count, m->levels[1].count);
    } else {
        tell(to, "normal equations", "exact, from all %d columns and rows of the window",
             m->levels[1].count);
    }
    if (m->options.pilot > 0 && m->levels[0].count < m->levels[1].count) {
        tell(to, "pilot", "at most %d steps on those few entries, until one brings less than %g %%",
             m->options.pilot, 100 * m->options.patience);
    } else {
        tell(to, "pilot", "none: the window is small");
    }
    tell(to, "tile", "%d rows x %d terms at a time, %d lanes", m->tile.rows, m->tile.group,
         p->responses->lanes);
    tell(to, "device memory", "%.1f MiB of factors, beside the responses",
         7 * (double)(m->layout.factor_floats * sizeof(float)) * p->responses->channels * 0x1p-20);
}

static void hals_free(struct method *method)
{
    struct hals *m = (struct hals *)method;
    (void)clFinish(
        m->layout.opencl->queue); /* kernels may still read memory that its owner frees next */
    for (int i = 0; i < RESPONSES_CHANNELS; i++) {
        struct channel *c = &m->channels[i];
        layout_release(c->last_f);
        layout_release(c->ahead_f);
        layout_release(c->new_f);
        layout_release(c->last_h);
        layout_release(c->model_h);
        layout_release(c->new_h);
        layout_release(c->try_h);
    }
    for (int i = 0; i < 2; i++) {
        layout_release(m->levels[i].columns);
        layout_release(m->levels[i].column_weights);
        layout_release(m->levels[i].row_weights);
    }
    layout_release(m->sums);
    for (int i = 0; i < KERNEL_COUNT; i++) {
        if (m->kernels[i]) {
            (void)clReleaseKernel(m->kernels[i]);
        }
    }
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

static int prepare(struct hals *m, struct nacre_error *error)
{
    size_t sums = 2 * m->items[0] * m->items[1];
    m->partials = malloc(sums * sizeof *m->partials);
    int status = m->partials ? build(m, error) : nacre_fail_memory(error, "the objective");
    if (status == NACRE_OK) {
        status = layout_make_buffer(&m->layout, sums * sizeof(float), NULL, false, &m->sums, error);
    }
    for (int i = 0; i < 2 && status == NACRE_OK; i++) {
        status = place_level(m, i == 0, &m->levels[i], error);
    }
    for (int i = 0; i < m->layout.problem->responses->channels && status == NACRE_OK; i++) {
        struct channel *c = &m->channels[i];
        status = place_channel(m, i, error);
        if (status == NACRE_OK) {
            status = layout_start_factor(&m->layout, i, false, c->last_f, error);
        }
        if (status == NACRE_OK) {
            status = layout_start_factor(&m->layout, i, true, c->model_h, error);
        }
        if (status == NACRE_OK) {
            status = begin_channel(m, c, error);
        }
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
    m->items[0] = (size_t)r->blocks;
    m->items[1] = (size_t)((r->height + m->tile.rows - 1) / m->tile.rows);
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
