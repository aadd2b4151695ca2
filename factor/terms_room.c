/* What the method terms holds on the device and the host: made, and given back. */
#include "factor/terms_steps.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const struct opencl_source terms_cl;

static int build(struct terms *m, struct nacre_error *error)
{
    static const char *const names[TERMS_KERNEL_COUNT] = {
        "visit", "descend", "extrapolate", "multiply", "correlate", "sides", "lack"};
    const struct layout *l = &m->layouts[0];
    const struct responses *r = m->problems[0].responses;
    char options[192];
    (void)snprintf(options, sizeof options,
                   "-DLANES=%d -DTERMS=%d -DMASKED=%d -DHALF=%d -DDOWN=%d -DACROSS=%d -DCOLUMNS=%d "
                   "-DWINDOW=%d",
                   r->lanes, l->sizes.terms, r->mask_needed, r->half, TERMS_DOWN, TERMS_ACROSS,
                   TERMS_COLUMNS, l->sizes.window);
    if (opencl_build(l->opencl, &terms_cl, options, &m->program, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (int i = 0; i < TERMS_KERNEL_COUNT; i++) {
        cl_int status = CL_SUCCESS;
        m->kernels[i] = clCreateKernel(m->program, names[i], &status);
        if (opencl_check(l->opencl, status, names[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

/* The squared weights of points as a plane with zeros around. */
static int place_weights(struct terms *m, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    const struct layout_sizes *s = &l->sizes;
    size_t stride = (size_t)s->stride, count = (size_t)s->height * stride;
    float *plane = calloc(count, sizeof *plane);
    if (!plane) {
        return nacre_fail_memory(error, "the weights");
    }
    for (size_t y = 0; y < (size_t)s->height; y++) {
        memcpy(plane + y * stride + (size_t)s->pad, m->data->weights + y * (size_t)s->width,
               (size_t)s->width * sizeof *plane);
    }
    int status = layout_make_buffer(l, count * sizeof *plane, plane, false, &m->weights, error);
    if (status == NACRE_OK) {
        status = layout_make_buffer(l, count * sizeof *plane, NULL, false, &m->nothing, error);
    }
    free(plane);
    return status;
}

static int prepare_channel(struct terms *m, int channel, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    size_t area = (size_t)m->data->grid.window * (size_t)m->data->grid.window;
    size_t items = (size_t)l->sizes.blocks * (size_t)l->sizes.height;
    int status = layout_make_buffer(l, 2 * items * sizeof(float), NULL, false,
                                    &m->channels[channel].sums, error);
    m->channels[channel].good = calloc(terms_number_count(m), sizeof(float));
    m->channels[channel].next = calloc(terms_number_count(m), sizeof(float));
    if (!m->channels[channel].good || !m->channels[channel].next) {
        return nacre_fail_memory(error, "the kernels");
    }
    for (int side = 0; side < m->sides && status == NACRE_OK; side++) {
        for (size_t i = 0; i < area; i++) {
            m->window[i] = m->data->scales[channel][side == 0 ? i : area - 1 - i];
        }
        status = layout_make_buffer(l, area * sizeof(float), m->window, false,
                                    &m->channels[channel].scales[side], error);
        if (status == NACRE_OK) {
            status = layout_make_buffer(l, area * (size_t)l->sizes.terms * sizeof(float), NULL,
                                        false, &m->channels[channel].kernels[side], error);
        }
    }
    return status;
}

/* Room for the kernels' equations, on the device and on the host. */
static int prepare_equations(struct terms *m, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    size_t terms = (size_t)l->sizes.terms, pairs = terms * (terms + 1) / 2;
    size_t area = (size_t)m->data->grid.window * (size_t)m->data->grid.window;
    size_t held = pairs < TERMS_PRODUCTS ? pairs : TERMS_PRODUCTS;
    size_t stride = (size_t)l->sizes.stride, height = (size_t)l->sizes.height;
    size_t guarded = height + 2 * (size_t)(l->sizes.window / 2 + TERMS_DOWN);
    bool masked = m->data->copies[0].mask_needed;
    const struct {
        cl_mem *buffer;
        size_t floats;
    } wanted[] = {{&m->equations.weighted, held * guarded * stride},
                  {&m->equations.plain, held * height * stride},
                  {&m->equations.correlations, pairs * area},
                  {&m->equations.sides, terms * area},
                  {&m->equations.lacks, masked ? pairs * area : 1},
                  {&m->equations.measured, masked ? area : 1}};
    int status = NACRE_OK;
    m->equation_size = pairs + terms;
    m->correlations = malloc(pairs * area * sizeof *m->correlations);
    m->right = malloc(terms * area * sizeof *m->right);
    m->lacks = masked ? malloc(pairs * area * sizeof *m->lacks) : NULL;
    m->measured = masked ? malloc(area * sizeof *m->measured) : NULL;
    m->sums = malloc((area * m->equation_size + 1) * sizeof *m->sums);
    if (!m->correlations || !m->right || !m->sums || (masked && (!m->lacks || !m->measured))) {
        return nacre_fail_memory(error, "the method");
    }
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted && status == NACRE_OK; i++) {
        status = layout_make_buffer(l, wanted[i].floats * sizeof(float), NULL, false,
                                    wanted[i].buffer, error);
    }
    return status;
}

int terms_prepare(struct terms *m, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    size_t terms = (size_t)l->sizes.terms, padded = (terms + 1) / 2 * 2;
    size_t items = (size_t)l->sizes.blocks * (size_t)l->sizes.height;
    size_t lanes = (size_t)m->data->copies[0].lanes;
    size_t area = (size_t)m->data->grid.window * (size_t)m->data->grid.window;
    m->partials = malloc((2 * items + 1) * sizeof *m->partials);
    m->staged = malloc((area * terms + 1) * sizeof *m->staged); /* never of nothing */
    m->window = malloc(area * sizeof *m->window);
    if (!m->partials || !m->staged || !m->window) {
        return nacre_fail_memory(error, "the method");
    }
    int status = build(m, error);
    if (status == NACRE_OK) {
        status = place_weights(m, error);
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(l, 2 * items * padded * lanes * sizeof(float), NULL, false,
                                    &m->gradient, error);
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(l, 2 * items * sizeof(float), NULL, false, &m->beyond, error);
    }
    m->curvature_floats = items * TERMS_SQUARES * padded * padded * lanes;
    if (status == NACRE_OK) {
        status = prepare_equations(m, error);
    }
    for (int c = 0; c < m->data->responses->channels && status == NACRE_OK; c++) {
        status = prepare_channel(m, c, error);
    }
    return status;
}

void terms_release(struct terms *m)
{
    if (m->layouts[0].opencl) {
        (void)clFinish(m->layouts[0].opencl->queue); /* kernels may still read what is freed next */
    }
    for (int c = 0; c < RESPONSES_CHANNELS; c++) {
        for (int side = 0; side < 2; side++) {
            const struct terms_track *t = &m->sets[c].tracks[side];
            layout_release(t->good);
            layout_release(t->next);
            layout_release(t->last);
            layout_release(t->fresh);
            layout_release(t->kept);
            layout_release(m->channels[c].kernels[side]);
            layout_release(m->channels[c].scales[side]);
        }
        layout_release(m->sets[c].curvature);
        layout_release(m->channels[c].sums);
        free(m->channels[c].good);
        free(m->channels[c].next);
    }
    layout_release(m->weights);
    layout_release(m->nothing);
    layout_release(m->gradient);
    layout_release(m->beyond);
    layout_release(m->equations.weighted);
    layout_release(m->equations.plain);
    layout_release(m->equations.correlations);
    layout_release(m->equations.sides);
    layout_release(m->equations.lacks);
    layout_release(m->equations.measured);
    for (int i = 0; i < TERMS_KERNEL_COUNT; i++) {
        if (m->kernels[i]) {
            (void)clReleaseKernel(m->kernels[i]);
        }
    }
    if (m->program) {
        (void)clReleaseProgram(m->program);
    }
    layout_finish(&m->layouts[0]);
    layout_finish(&m->layouts[1]);
    free(m->partials);
    free(m->correlations);
    free(m->right);
    free(m->lacks);
    free(m->measured);
    free(m->sums);
    free(m->staged);
    free(m->window);
    free(m);
}
