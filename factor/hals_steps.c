/* Steps of block coordinate descent: what is extrapolated, kept and taken back. The arithmetic is in hals.cl. */
#include "factor/hals_steps.h"

#include <math.h>

/* Extrapolation as Ang and Gillis 2019 set it: the share of the last change that is added starts at FIRST, grows by
 * GROWTH up to a limit that itself grows by LIMIT_GROWTH, and is divided by SHRINK after a step not taken. */
#define PLAIN        3 /* steps at the start that are not extrapolated */
#define FIRST        0.5F
#define GROWTH       1.05F
#define LIMIT_GROWTH 1.01F
#define SHRINK       1.5F

bool hals_is_exact(const struct hals *m, const struct hals_channel *c)
{
    return (c && c->exact) || !m->options.far || HALS_NEAR >= m->layout.sizes.window / 2;
}

/* Set the arguments of a kernel that visits entries, and run it. */
static int visit(struct hals *m, int channel, enum hals_kernel name, cl_mem own, cl_mem other,
                 cl_mem next, struct nacre_error *error)
{
    const struct layout *l = &m->layout;
    const struct hals_channel *c = &m->channels[channel];
    const cl_int half = l->sizes.window / 2, sweeps = HALS_SWEEPS;
    const bool exact = hals_is_exact(m, c);
    const cl_int near = exact ? half : HALS_NEAR;
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
    if (name != HALS_MEASURE && !exact &&
        curvature_gather(&m->curvature, channel, other, name == HALS_DESCEND_H, error) !=
            NACRE_OK) {
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

static int extrapolate(struct hals *m, const struct hals_track *track, float share,
                       struct nacre_error *error)
{
    cl_kernel kernel = m->kernels[HALS_EXTRAPOLATE];
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
                                        &m->layout.factor_floats, &m->layout.group, 0, NULL, NULL);
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
    struct hals_channel *c = &m->channels[channel];
    int status = extrapolate(m, &c->h, share, error);
    if (status == NACRE_OK) {
        status = visit(m, channel, HALS_DESCEND_F, c->f.good, c->h.next, c->f.fresh, error);
    }
    if (status == NACRE_OK) {
        status = extrapolate(m, &c->f, share, error);
    }
    swap(&c->f.last, &c->f.fresh);
    swap(&c->h.last, &c->h.fresh);
    return status;
}

/* Take `next`, from where H's best step is made already, as the model. */
static void accept(struct hals_channel *c, double objective)
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
    struct hals_channel *c = &m->channels[channel];
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
        status = visit(m, channel, HALS_DESCEND_H, c->h.good, c->f.good, c->h.last, error);
    }
    swap(&c->h.fresh, &c->h.last); /* the best step of H from the model */
    return status == NACRE_OK ? finish_step(m, channel, 0, error) : status;
}

int hals_advance(struct hals *m, int channel, struct nacre_error *error)
{
    struct hals_channel *c = &m->channels[channel];
    double objective = 0;
    int status = NACRE_OK;
    c->viewed = 0;
    while (status == NACRE_OK && !c->settled) {
        status = visit(m, channel, HALS_DESCEND_H, c->h.next, c->f.next, c->h.fresh, error);
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

int hals_view(struct hals *m, int channel, struct nacre_error *error)
{
    struct hals_channel *c = &m->channels[channel];
    int status = NACRE_OK;
    if (!c->viewed && !c->settled) {
        status = visit(m, channel, HALS_MEASURE, c->h.next, c->f.next, c->h.fresh, error);
        if (status == NACRE_OK) {
            status = collect(m, &c->next_objective, error);
        }
        c->viewed = status == NACRE_OK;
    }
    return status;
}

bool hals_is_next_better(const struct hals_channel *c)
{
    return c->viewed && c->next_objective <= c->objective;
}
