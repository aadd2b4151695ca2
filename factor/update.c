/* Multiplicative updates: buffers, arguments and launches of the kernels in update.cl. */
#include "factor/update.h"

#include "factor/random.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const struct opencl_source update_cl;

/* Added to denominators. Responses are at most 1 and factors around 1, so that a denominator which means anything is
 * far above it, and a numerator over it stays finite. */
#define GUARD 1e-30F

/* As struct sizes in update.cl. */
struct sizes {
    cl_int width, height, window, terms, planes;
    cl_int blocks, stride, pad, row, lead, scratch;
    cl_float guard, floor, exponent, unit;
};

struct channel_buffers {
    cl_mem responses, mask, kernels, inverses, f, h;
};

enum kernel_name { MEASURE, UPDATE_F_MEASURED, UPDATE_F, UPDATE_H, KERNEL_COUNT };

struct update {
    struct method method;
    const struct opencl *opencl;
    const struct problem *problem;
    struct update_tile tile;
    struct sizes sizes;
    size_t items;         /* work-items of one launch */
    size_t factor_floats; /* of one padded factor */
    cl_program program;
    cl_kernel kernels[KERNEL_COUNT];
    struct channel_buffers channels[RESPONSES_CHANNELS];
    cl_mem labels, scratch, objectives;
    float *staging;  /* one padded factor */
    float *partials; /* sums of the objective, [items][window + rows - 1] */
};

int update_lanes(const struct opencl *opencl)
{
    cl_uint width = 0;
    cl_int status = clGetDeviceInfo(opencl->device, CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT,
                                    sizeof width, &width, NULL);
    if (status != CL_SUCCESS) {
        return 8;
    }
    return width >= 16 ? 16 : width >= 8 ? 8 : 4;
}

struct update_tile update_tile_choose(int lanes, int terms)
{
    /* Registers hold rows x group x 2 sums: 32 registers with 16 lanes, else 16. Among the groups that fit, that
     * which pads the terms least; of equals the first. */
    static const struct update_tile wide[] = {{2, 4, 6}, {2, 4, 5}, {3, 4, 4}, {2, 4, 4}};
    static const struct update_tile narrow[] = {{2, 4, 2}, {2, 4, 3}, {4, 2, 1}};
    const struct update_tile *tiles = lanes >= 16 ? wide : narrow;
    int count = lanes >= 16 ? 4 : 3, best = 0, best_planes = 0;
    for (int i = 0; i < count; i++) {
        int planes = (terms + tiles[i].group - 1) / tiles[i].group * tiles[i].group;
        if (i == 0 || planes < best_planes) {
            best = i;
            best_planes = planes;
        }
    }
    return tiles[best];
}

static int padded(int half, int lanes)
{
    return (half + 2 * lanes) / lanes * lanes + lanes;
}

static void set_sizes(struct update *u)
{
    const struct problem *p = u->problem;
    const struct responses *r = p->responses;
    int pad = padded(r->window / 2, r->lanes), group = u->tile.group;
    int planes = (p->terms + group - 1) / group * group;
    size_t sums = (size_t)r->blocks * (size_t)planes * (size_t)u->tile.rows * 2 * (size_t)r->lanes;
    size_t strips = p->clusters > 1 ? (size_t)u->tile.rows * (r->row + 2 * r->lead) : 0;
    u->items = (size_t)((r->height + u->tile.rows - 1) / u->tile.rows);
    u->sizes = (struct sizes){
        .width = r->width,
        .height = r->height,
        .window = r->window,
        .terms = p->terms,
        .planes = planes,
        .blocks = r->blocks,
        .stride = 2 * pad + r->blocks * r->lanes,
        .pad = pad,
        .row = (cl_int)r->row,
        .lead = (cl_int)r->lead,
        .scratch = (cl_int)(sums + strips),
        .guard = GUARD,
        .floor = UPDATE_FLOOR,
        .exponent = 1 + (cl_float)p->regularise,
        .unit = (cl_float)sqrt(1.0 / p->terms),
    };
    u->factor_floats =
        (size_t)(r->height + u->tile.rows) * (size_t)planes * (size_t)u->sizes.stride;
}

static int build(struct update *u, struct nacre_error *error)
{
    static const char *const names[KERNEL_COUNT] = {"measure", "update_f_measured", "update_f",
                                                    "update_h"};
    const struct responses *r = u->problem->responses;
    char options[256];
    (void)snprintf(options, sizeof options,
                   "-DLANES=%d -DROWS=%d -DSTEPS=%d -DGROUP=%d -DCLUSTERED=%d -DMASKED=%d "
                   "-DNEGATIVE=%d",
                   r->lanes, u->tile.rows, u->tile.steps, u->tile.group, u->problem->clusters > 1,
                   r->mask_needed, r->negative);
    if (opencl_build(u->opencl, &update_cl, options, &u->program, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (int i = 0; i < KERNEL_COUNT; i++) {
        cl_int status = CL_SUCCESS;
        u->kernels[i] = clCreateKernel(u->program, names[i], &status);
        if (opencl_check(u->opencl, status, names[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

/* A buffer of `bytes`, copied from `from`, or with `shared` made of that memory itself; zeroed without `from`. */
static int make_buffer(const struct update *u, size_t bytes, void *from, bool shared,
                       cl_mem *buffer, struct nacre_error *error)
{
    cl_mem_flags flags = !from    ? CL_MEM_READ_WRITE
                         : shared ? CL_MEM_READ_ONLY | CL_MEM_USE_HOST_PTR
                                  : CL_MEM_READ_ONLY | CL_MEM_COPY_HOST_PTR;
    cl_int status = CL_SUCCESS;
    char action[96];
    (void)snprintf(action, sizeof action, "cannot place %.1f MiB on the device",
                   (double)bytes * 0x1p-20);
    *buffer = clCreateBuffer(u->opencl->context, flags, bytes, from, &status);
    if (status == CL_SUCCESS && !from) {
        cl_float zero = 0;
        status = clEnqueueFillBuffer(u->opencl->queue, *buffer, &zero, sizeof zero, 0, bytes, 0,
                                     NULL, NULL);
    }
    return opencl_check(u->opencl, status, action, error);
}

/* One channel's kernels as the device reads them, [clusters][K + 1][K] with a last row of zeros, and their inverses. */
static int place_kernels(struct update *u, int channel, struct nacre_error *error)
{
    const struct problem *p = u->problem;
    size_t window = (size_t)p->responses->window, area = window * window;
    size_t padded_area = (window + 1) * window, bytes = 0;
    int status = NACRE_FAILED;
    float *values = calloc((size_t)p->clusters * padded_area, sizeof *values);
    float *inverses = calloc((size_t)p->clusters * padded_area, sizeof *inverses);
    if (!values || !inverses) {
        status = nacre_fail_memory(error, "the kernels");
        goto out;
    }
    for (size_t k = 0; k < (size_t)p->clusters; k++) {
        const float *from =
            p->kernels + (k * (size_t)p->responses->channels + (size_t)channel) * area;
        for (size_t i = 0; i < area; i++) {
            values[k * padded_area + i] = from[i];
            inverses[k * padded_area + i] = 1 / from[i];
        }
    }
    bytes = (size_t)p->clusters * padded_area * sizeof *values;
    status = make_buffer(u, bytes, values, false, &u->channels[channel].kernels, error);
    if (status == NACRE_OK) {
        status = make_buffer(u, bytes, inverses, false, &u->channels[channel].inverses, error);
    }
out:
    free(values);
    free(inverses);
    return status;
}

/* Cluster numbers padded to whole blocks. */
static int place_labels(struct update *u, struct nacre_error *error)
{
    const struct responses *r = u->problem->responses;
    size_t stride = (size_t)r->blocks * (size_t)r->lanes;
    size_t count = (size_t)r->height * stride;
    int status = NACRE_FAILED;
    cl_int *labels = calloc(count, sizeof *labels);
    if (!labels) {
        return nacre_fail_memory(error, "the clusters");
    }
    for (size_t y = 0; y < (size_t)r->height; y++) {
        for (size_t x = 0; x < (size_t)r->width; x++) {
            labels[y * stride + x] = (cl_int)u->problem->ids[y * (size_t)r->width + x];
        }
    }
    status = make_buffer(u, count * sizeof *labels, labels, false, &u->labels, error);
    free(labels);
    return status;
}

static int write_factor(struct update *u, cl_mem buffer, const float *from,
                        struct nacre_error *error)
{
    const struct sizes *s = &u->sizes;
    memset(u->staging, 0, u->factor_floats * sizeof *u->staging);
    for (int t = 0; t < s->terms; t++) {
        for (int y = 0; y < s->height; y++) {
            memcpy(u->staging + ((size_t)y * (size_t)s->planes + (size_t)t) * (size_t)s->stride +
                       (size_t)s->pad,
                   from + ((size_t)t * (size_t)s->height + (size_t)y) * (size_t)s->width,
                   (size_t)s->width * sizeof *from);
        }
    }
    return opencl_check(u->opencl,
                        clEnqueueWriteBuffer(u->opencl->queue, buffer, CL_TRUE, 0,
                                             u->factor_floats * sizeof *u->staging, u->staging, 0,
                                             NULL, NULL),
                        "cannot write a factor", error);
}

static int read_factor(struct update *u, cl_mem buffer, float *to, struct nacre_error *error)
{
    const struct sizes *s = &u->sizes;
    cl_int status =
        clEnqueueReadBuffer(u->opencl->queue, buffer, CL_TRUE, 0,
                            u->factor_floats * sizeof *u->staging, u->staging, 0, NULL, NULL);
    for (int t = 0; t < s->terms; t++) {
        for (int y = 0; y < s->height; y++) {
            memcpy(to + ((size_t)t * (size_t)s->height + (size_t)y) * (size_t)s->width,
                   u->staging + ((size_t)y * (size_t)s->planes + (size_t)t) * (size_t)s->stride +
                       (size_t)s->pad,
                   (size_t)s->width * sizeof *to);
        }
    }
    return opencl_check(u->opencl, status, "cannot read a factor", error);
}

/* Random factors whose product is 1 on average: kernels are mean responses already. */
static int start_factor(struct update *u, int channel, bool of_h, struct nacre_error *error)
{
    const struct sizes *s = &u->sizes;
    size_t count = (size_t)s->terms * (size_t)s->height * (size_t)s->width;
    uint64_t stream = random_bits(u->problem->seed, 2 * (uint64_t)channel + of_h);
    cl_mem buffer = of_h ? u->channels[channel].h : u->channels[channel].f;
    int status = NACRE_FAILED;
    float *values = malloc(count * sizeof *values);
    if (!values) {
        return nacre_fail_memory(error, "a factor");
    }
    for (size_t i = 0; i < count; i++) {
        values[i] = 2 * s->unit * (float)random_uniform(stream, i);
    }
    status = write_factor(u, buffer, values, error);
    free(values);
    return status;
}

static int place_channel(struct update *u, int channel, struct nacre_error *error)
{
    const struct responses *r = u->problem->responses;
    struct channel_buffers *b = &u->channels[channel];
    size_t mask_bytes = r->size / (size_t)r->lanes * sizeof(uint16_t);
    int status =
        make_buffer(u, r->size * sizeof(float), r->values[channel], true, &b->responses, error);
    if (status == NACRE_OK) {
        status = make_buffer(u, mask_bytes, r->mask[channel], true, &b->mask, error);
    }
    if (status == NACRE_OK) {
        status = place_kernels(u, channel, error);
    }
    if (status == NACRE_OK) {
        status = make_buffer(u, u->factor_floats * sizeof(float), NULL, false, &b->f, error);
    }
    if (status == NACRE_OK) {
        status = make_buffer(u, u->factor_floats * sizeof(float), NULL, false, &b->h, error);
    }
    if (status == NACRE_OK) {
        status = start_factor(u, channel, false, error);
    }
    if (status == NACRE_OK) {
        status = start_factor(u, channel, true, error);
    }
    return status;
}

static int launch(struct update *u, int channel, enum kernel_name name, struct nacre_error *error)
{
    const struct channel_buffers *b = &u->channels[channel];
    cl_mem own = name == UPDATE_H ? b->h : b->f, other = name == UPDATE_H ? b->f : b->h;
    enum { BUFFERS = 9 };
    const cl_mem arguments[BUFFERS] = {b->responses, b->mask, u->labels,  b->kernels,   b->inverses,
                                       own,          other,   u->scratch, u->objectives};
    size_t one = 1;
    cl_int status = CL_SUCCESS;
    for (cl_uint i = 0; i < BUFFERS && status == CL_SUCCESS; i++) {
        status = clSetKernelArg(u->kernels[name], i, sizeof(cl_mem), &arguments[i]);
    }
    if (status == CL_SUCCESS) {
        status = clSetKernelArg(u->kernels[name], BUFFERS, sizeof u->sizes, &u->sizes);
    }
    if (status == CL_SUCCESS) {
        status = clEnqueueNDRangeKernel(u->opencl->queue, u->kernels[name], 1, NULL, &u->items,
                                        &one, 0, NULL, NULL);
    }
    return opencl_check(u->opencl, status, "cannot run an update", error);
}

static int collect_objective(struct update *u, double *objective, struct nacre_error *error)
{
    size_t count = u->items * (size_t)(u->sizes.window + u->tile.rows - 1);
    double sum = 0;
    cl_int status = clEnqueueReadBuffer(u->opencl->queue, u->objectives, CL_TRUE, 0,
                                        count * sizeof *u->partials, u->partials, 0, NULL, NULL);
    for (size_t i = 0; i < count; i++) {
        sum += u->partials[i];
    }
    *objective = sum / 2;
    return opencl_check(u->opencl, status, "cannot read the objective", error);
}

static int step(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct update *u = (struct update *)method;
    int status = launch(u, channel, objective ? UPDATE_F_MEASURED : UPDATE_F, error);
    if (status == NACRE_OK && objective) {
        status = collect_objective(u, objective, error);
    }
    return status == NACRE_OK ? launch(u, channel, UPDATE_H, error) : status;
}

static int measure(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct update *u = (struct update *)method;
    int status = launch(u, channel, MEASURE, error);
    return status == NACRE_OK ? collect_objective(u, objective, error) : status;
}

static int read_factors(struct method *method, int channel, float *f, float *h,
                        struct nacre_error *error)
{
    struct update *u = (struct update *)method;
    int status = read_factor(u, u->channels[channel].f, f, error);
    return status == NACRE_OK ? read_factor(u, u->channels[channel].h, h, error) : status;
}

static int write_factors(struct method *method, int channel, const float *f, const float *h,
                         struct nacre_error *error)
{
    struct update *u = (struct update *)method;
    int status = write_factor(u, u->channels[channel].f, f, error);
    return status == NACRE_OK ? write_factor(u, u->channels[channel].h, h, error) : status;
}

int update_half_step(struct method *method, int channel, bool of_h, struct nacre_error *error)
{
    return launch((struct update *)method, channel, of_h ? UPDATE_H : UPDATE_F, error);
}

int update_wait(struct method *method, struct nacre_error *error)
{
    struct update *u = (struct update *)method;
    return opencl_check(u->opencl, clFinish(u->opencl->queue), "cannot finish an update", error);
}

static void release(cl_mem buffer)
{
    if (buffer) {
        (void)clReleaseMemObject(buffer);
    }
}

static void update_free(struct method *method)
{
    struct update *u = (struct update *)method;
    (void)clFinish(u->opencl->queue); /* kernels may still read memory that its owner frees next */
    for (int c = 0; c < RESPONSES_CHANNELS; c++) {
        release(u->channels[c].responses);
        release(u->channels[c].mask);
        release(u->channels[c].kernels);
        release(u->channels[c].inverses);
        release(u->channels[c].f);
        release(u->channels[c].h);
    }
    release(u->labels);
    release(u->scratch);
    release(u->objectives);
    for (int i = 0; i < KERNEL_COUNT; i++) {
        if (u->kernels[i]) {
            (void)clReleaseKernel(u->kernels[i]);
        }
    }
    if (u->program) {
        (void)clReleaseProgram(u->program);
    }
    free(u->staging);
    free(u->partials);
    free(u);
}

static const struct method_ops update_ops = {
    .name = "mu",
    .step = step,
    .measure = measure,
    .read = read_factors,
    .write = write_factors,
    .free = update_free,
};

static int prepare(struct update *u, struct nacre_error *error)
{
    size_t objectives = u->items * (size_t)(u->sizes.window + u->tile.rows - 1);
    int status = NACRE_OK;
    u->staging = malloc(u->factor_floats * sizeof *u->staging);
    u->partials = malloc(objectives * sizeof *u->partials);
    if (!u->staging || !u->partials) {
        return nacre_fail_memory(error, "the factors");
    }
    status = build(u, error);
    if (status == NACRE_OK) {
        status = place_labels(u, error);
    }
    if (status == NACRE_OK) {
        status = make_buffer(u, u->items * (size_t)u->sizes.scratch * sizeof(float), NULL, false,
                             &u->scratch, error);
    }
    if (status == NACRE_OK) {
        status = make_buffer(u, objectives * sizeof(float), NULL, false, &u->objectives, error);
    }
    for (int c = 0; c < u->problem->responses->channels && status == NACRE_OK; c++) {
        status = place_channel(u, c, error);
    }
    return status;
}

int update_new(const struct opencl *opencl, const struct problem *problem,
               const struct update_tile *tile, struct method **method, struct nacre_error *error)
{
    int status = NACRE_FAILED;
    struct update *u = calloc(1, sizeof *u);
    *method = NULL;
    if (!u) {
        return nacre_fail_memory(error, "the updates");
    }
    u->method.ops = &update_ops;
    u->opencl = opencl;
    u->problem = problem;
    u->tile = tile ? *tile : update_tile_choose(problem->responses->lanes, problem->terms);
    set_sizes(u);
    status = prepare(u, error);
    if (status == NACRE_OK) {
        *method = &u->method;
    } else {
        update_free(&u->method);
    }
    return status;
}
