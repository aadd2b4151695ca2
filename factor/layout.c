/* Placing a problem on an OpenCL device. */
#include "factor/layout.h"

#include "factor/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int layout_lanes(const struct opencl *opencl)
{
    cl_uint width = 0;
    cl_int status = clGetDeviceInfo(opencl->device, CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT,
                                    sizeof width, &width, NULL);
    if (status != CL_SUCCESS) {
        return 8;
    }
    return width >= 16 ? 16 : width >= 8 ? 8 : 4;
}

float layout_unit(const struct problem *problem)
{
    return (float)sqrt(1.0 / problem->terms);
}

static int padded(int half, int lanes)
{
    return (half + 2 * lanes) / lanes * lanes + lanes;
}

static void set_sizes(struct layout *l, int planes, int rows)
{
    const struct responses *r = l->problem->responses;
    int pad = padded(r->window / 2, r->lanes);
    int stride = 2 * pad + r->blocks * r->lanes;
    l->sizes = (struct layout_sizes){
        .width = r->width,
        .height = r->height,
        .window = r->window,
        .terms = l->problem->terms,
        .planes = planes,
        .blocks = r->blocks,
        .stride = stride,
        .pad = pad,
        .row = (cl_int)r->row,
        .lead = (cl_int)r->lead,
        .label_stride = stride,
    };
    l->factor_floats = (size_t)(r->height + rows) * (size_t)planes * (size_t)stride;
    l->group = (size_t)r->lanes;
}

int layout_make_buffer(const struct layout *l, size_t bytes, void *from, bool shared,
                       cl_mem *buffer, struct nacre_error *error)
{
    cl_mem_flags flags = !from    ? CL_MEM_READ_WRITE
                         : shared ? CL_MEM_READ_ONLY | CL_MEM_USE_HOST_PTR
                                  : CL_MEM_READ_ONLY | CL_MEM_COPY_HOST_PTR;
    cl_int status = CL_SUCCESS;
    char action[96];
    (void)snprintf(action, sizeof action, "cannot place %.1f MiB on the device",
                   (double)bytes * 0x1p-20);
    *buffer = clCreateBuffer(l->opencl->context, flags, bytes, from, &status);
    if (status == CL_SUCCESS && !from) {
        cl_float zero = 0;
        status = clEnqueueFillBuffer(l->opencl->queue, *buffer, &zero, sizeof zero, 0, bytes, 0,
                                     NULL, NULL);
    }
    return opencl_check(l->opencl, status, action, error);
}

int layout_make_factor(const struct layout *l, cl_mem *buffer, struct nacre_error *error)
{
    return layout_make_buffer(l, l->factor_floats * sizeof(float), NULL, false, buffer, error);
}

static int place_kernels(struct layout *l, int channel, struct nacre_error *error)
{
    const struct problem *p = l->problem;
    size_t window = (size_t)p->responses->window, area = window * window;
    size_t padded_area = (window + 1) * window;
    float *values = calloc((size_t)p->clusters * padded_area, sizeof *values);
    if (!values) {
        return nacre_fail_memory(error, "the kernels");
    }
    for (size_t k = 0; k < (size_t)p->clusters; k++) {
        const float *from =
            p->kernels + (k * (size_t)p->responses->channels + (size_t)channel) * area;
        memcpy(values + k * padded_area, from, area * sizeof *from);
    }
    int status = layout_make_buffer(l, (size_t)p->clusters * padded_area * sizeof *values, values,
                                    false, &l->channels[channel].kernels, error);
    free(values);
    return status;
}

/* Cluster numbers, with the zeros around each row that factors have. */
static int place_labels(struct layout *l, struct nacre_error *error)
{
    const struct responses *r = l->problem->responses;
    size_t stride = (size_t)l->sizes.label_stride, count = (size_t)r->height * stride;
    cl_int *labels = calloc(count, sizeof *labels);
    if (!labels) {
        return nacre_fail_memory(error, "the clusters");
    }
    for (size_t y = 0; y < (size_t)r->height; y++) {
        for (size_t x = 0; x < (size_t)r->width; x++) {
            labels[y * stride + (size_t)l->sizes.pad + x] =
                (cl_int)l->problem->ids[y * (size_t)r->width + x];
        }
    }
    int status = layout_make_buffer(l, count * sizeof *labels, labels, false, &l->labels, error);
    free(labels);
    return status;
}

int layout_write_factor(struct layout *l, cl_mem buffer, const float *from,
                        struct nacre_error *error)
{
    const struct layout_sizes *s = &l->sizes;
    memset(l->staging, 0, l->factor_floats * sizeof *l->staging);
    for (int t = 0; t < s->terms; t++) {
        for (int y = 0; y < s->height; y++) {
            memcpy(l->staging + ((size_t)y * (size_t)s->planes + (size_t)t) * (size_t)s->stride +
                       (size_t)s->pad,
                   from + ((size_t)t * (size_t)s->height + (size_t)y) * (size_t)s->width,
                   (size_t)s->width * sizeof *from);
        }
    }
    return opencl_check(l->opencl,
                        clEnqueueWriteBuffer(l->opencl->queue, buffer, CL_TRUE, 0,
                                             l->factor_floats * sizeof *l->staging, l->staging, 0,
                                             NULL, NULL),
                        "cannot write a factor", error);
}

int layout_read_factor(struct layout *l, cl_mem buffer, float *to, struct nacre_error *error)
{
    const struct layout_sizes *s = &l->sizes;
    cl_int status =
        clEnqueueReadBuffer(l->opencl->queue, buffer, CL_TRUE, 0,
                            l->factor_floats * sizeof *l->staging, l->staging, 0, NULL, NULL);
    for (int t = 0; t < s->terms; t++) {
        for (int y = 0; y < s->height; y++) {
            memcpy(to + ((size_t)t * (size_t)s->height + (size_t)y) * (size_t)s->width,
                   l->staging + ((size_t)y * (size_t)s->planes + (size_t)t) * (size_t)s->stride +
                       (size_t)s->pad,
                   (size_t)s->width * sizeof *to);
        }
    }
    return opencl_check(l->opencl, status, "cannot read a factor", error);
}

int layout_start_factor(struct layout *l, int channel, bool of_h, cl_mem buffer,
                        struct nacre_error *error)
{
    const struct layout_sizes *s = &l->sizes;
    size_t count = (size_t)s->terms * (size_t)s->height * (size_t)s->width;
    uint64_t stream = random_bits(l->problem->seed, 2 * (uint64_t)channel + of_h);
    float *values = malloc(count * sizeof *values);
    if (!values) {
        return nacre_fail_memory(error, "a factor");
    }
    for (size_t i = 0; i < count; i++) {
        values[i] = 2 * layout_unit(l->problem) * (float)random_uniform(stream, i);
    }
    int status = layout_write_factor(l, buffer, values, error);
    free(values);
    return status;
}

/* The responses themselves; where all was measured, one number stands for a mask. */
static int place_channel(struct layout *l, int channel, struct nacre_error *error)
{
    const struct responses *r = l->problem->responses;
    void *values = r->half ? (void *)r->halves[channel] : (void *)r->values[channel];
    size_t bytes = r->size * (r->half ? sizeof(uint16_t) : sizeof(float));
    uint16_t *mask = r->mask[channel];
    int status = layout_make_buffer(l, bytes, values, true, &l->channels[channel].responses, error);
    if (status == NACRE_OK) {
        bytes = mask ? r->size / (size_t)r->lanes * sizeof *mask : sizeof(float);
        status = layout_make_buffer(l, bytes, mask, mask, &l->channels[channel].mask, error);
    }
    return status == NACRE_OK ? place_kernels(l, channel, error) : status;
}

int layout_begin(struct layout *l, const struct opencl *opencl, const struct problem *problem,
                 int planes, int rows, struct nacre_error *error)
{
    *l = (struct layout){.opencl = opencl, .problem = problem};
    set_sizes(l, planes, rows);
    l->staging = malloc(l->factor_floats * sizeof *l->staging);
    int status = l->staging ? place_labels(l, error) : nacre_fail_memory(error, "the factors");
    for (int c = 0; c < problem->responses->channels && status == NACRE_OK; c++) {
        status = place_channel(l, c, error);
    }
    return status;
}

void layout_release(cl_mem buffer)
{
    if (buffer) {
        (void)clReleaseMemObject(buffer);
    }
}

void layout_finish(struct layout *l)
{
    for (int c = 0; c < RESPONSES_CHANNELS; c++) {
        layout_release(l->channels[c].responses);
        layout_release(l->channels[c].mask);
        layout_release(l->channels[c].kernels);
    }
    layout_release(l->labels);
    free(l->staging);
    *l = (struct layout){0};
}
