/* Multiplicative updates: buffers, arguments and launches of the kernels in update.cl. */
#include "factor/update.h"

#include "factor/layout.h"
#include "factor/tune.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

extern const struct opencl_source update_cl;

/* Added to denominators. Responses are at most 1 and factors around 1, so that a denominator which means anything is
 * far above it, and a numerator over it stays finite. */
#define GUARD 1e-30F

/* As struct rule in update.cl. */
struct rule {
    cl_int scratch;
    cl_float guard, floor, exponent, unit;
};

struct channel_buffers {
    cl_mem inverses, f, h;
};

enum kernel_name { MEASURE, UPDATE_F_MEASURED, UPDATE_F, UPDATE_H, KERNEL_COUNT };

struct update {
    struct method method;
    struct layout layout;
    struct update_tile tile;
    struct rule rule;
    size_t items; /* work-items of one launch */
    cl_program program;
    cl_kernel kernels[KERNEL_COUNT];
    struct channel_buffers channels[RESPONSES_CHANNELS];
    cl_mem scratch, objectives;
    float *partials; /* sums of the objective, [items][window + rows - 1] */
};

static int planes_of(int terms, int group)
{
    return (terms + group - 1) / group * group;
}

/* Registers hold rows x group x 2 sums: 32 registers with 16 lanes, else 16. The first DEFAULTS of each are best where
 * they were measured. */
static const struct update_tile wide[] = {{2, 4, 6}, {2, 4, 5}, {3, 4, 4}, {2, 4, 4},
                                          {2, 7, 6}, {2, 5, 6}, {3, 3, 4}, {1, 8, 8}};
static const struct update_tile narrow[] = {{2, 4, 2}, {2, 4, 3}, {4, 2, 1}, {2, 3, 2},
                                            {2, 6, 2}, {1, 4, 4}, {3, 3, 2}, {2, 8, 2}};
enum { TILES = sizeof wide / sizeof *wide, WIDE_DEFAULTS = 4, NARROW_DEFAULTS = 3 };

size_t update_tiles(int lanes, const struct update_tile **tiles)
{
    *tiles = lanes >= 16 ? wide : narrow;
    return TILES;
}

struct update_tile update_tile_default(int lanes, int terms)
{
    /* That which pads the terms least; of equals the first. */
    const struct update_tile *tiles = lanes >= 16 ? wide : narrow;
    int count = lanes >= 16 ? WIDE_DEFAULTS : NARROW_DEFAULTS, best = 0, best_planes = 0;
    for (int i = 0; i < count; i++) {
        int planes = planes_of(terms, tiles[i].group);
        if (i == 0 || planes < best_planes) {
            best = i;
            best_planes = planes;
        }
    }
    return tiles[best];
}

struct update_tile update_tile_choose(const struct opencl *opencl, const struct problem *problem)
{
    const struct responses *r = problem->responses;
    struct tune_class class = {
        .method = "mu", .lanes = r->lanes, .clustered = problem->clusters > 1, .half = r->half};
    struct tune_result results[TUNE_TILES];
    struct update_tile best = update_tile_default(r->lanes, problem->terms);
    size_t count = tune_recall(opencl, class, results);
    const struct update_tile standard = best;
    double least = INFINITY;
    for (size_t i = 0; i < count; i++) {
        const int *tile = results[i].tile;
        double seconds = results[i].seconds * planes_of(problem->terms, tile[2]);
        bool is_standard =
            tile[0] == standard.rows && tile[1] == standard.steps && tile[2] == standard.group;
        /* Less than what timings differ by is no reason to leave the default. */
        if (seconds * (is_standard ? 1 - TUNE_MARGIN : 1) < least) {
            least = seconds * (is_standard ? 1 - TUNE_MARGIN : 1);
            best = (struct update_tile){tile[0], tile[1], tile[2]};
        }
    }
    return best;
}

static void set_rule(struct update *u, const struct problem *p)
{
    const struct responses *r = p->responses;
    int planes = planes_of(p->terms, u->tile.group);
    size_t sums = (size_t)r->blocks * (size_t)planes * (size_t)u->tile.rows * 2 * (size_t)r->lanes;
    size_t strips = p->clusters > 1 ? (size_t)u->tile.rows * (r->row + 2 * r->lead) : 0;
    u->items = (size_t)((r->height + u->tile.rows - 1) / u->tile.rows);
    u->rule = (struct rule){.scratch = (cl_int)(sums + strips),
                            .guard = GUARD,
                            .floor = UPDATE_FLOOR,
                            .exponent = 1 + (cl_float)p->regularise,
                            .unit = layout_unit(p)};
}

static int build(struct update *u, struct nacre_error *error)
{
    static const char *const names[KERNEL_COUNT] = {"measure", "update_f_measured", "update_f",
                                                    "update_h"};
    const struct responses *r = u->layout.problem->responses;
    char options[256];
    (void)snprintf(options, sizeof options,
                   "-DLANES=%d -DROWS=%d -DSTEPS=%d -DGROUP=%d -DCLUSTERED=%d -DMASKED=%d "
                   "-DNEGATIVE=%d -DHALF=%d",
                   r->lanes, u->tile.rows, u->tile.steps, u->tile.group,
                   u->layout.problem->clusters > 1, r->mask_needed, r->negative, r->half);
    if (opencl_build(u->layout.opencl, &update_cl, options, &u->program, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (int i = 0; i < KERNEL_COUNT; i++) {
        cl_int status = CL_SUCCESS;
        u->kernels[i] = clCreateKernel(u->program, names[i], &status);
        if (opencl_check(u->layout.opencl, status, names[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

/* 1 / kernel for a single cluster, [K + 1][K] with a last row of zeros; clusters divide in the kernel. */
static int place_inverses(struct update *u, int channel, struct nacre_error *error)
{
    const struct problem *p = u->layout.problem;
    size_t window = (size_t)p->responses->window, area = window * window;
    float *inverses = calloc(area + window, sizeof *inverses);
    if (!inverses) {
        return nacre_fail_memory(error, "the kernels");
    }
    for (size_t i = 0; i < area; i++) {
        inverses[i] = 1 / p->kernels[(size_t)channel * area + i];
    }
    int status = layout_make_buffer(&u->layout, (area + window) * sizeof *inverses, inverses, false,
                                    &u->channels[channel].inverses, error);
    free(inverses);
    return status;
}

static int place_channel(struct update *u, int channel, struct nacre_error *error)
{
    struct channel_buffers *b = &u->channels[channel];
    int status = place_inverses(u, channel, error);
    if (status == NACRE_OK) {
        status = layout_make_factor(&u->layout, &b->f, error);
    }
    if (status == NACRE_OK) {
        status = layout_make_factor(&u->layout, &b->h, error);
    }
    if (status == NACRE_OK) {
        status = layout_start_factor(&u->layout, channel, false, b->f, error);
    }
    return status == NACRE_OK ? layout_start_factor(&u->layout, channel, true, b->h, error)
                              : status;
}

static int launch(struct update *u, int channel, enum kernel_name name, struct nacre_error *error)
{
    const struct channel_buffers *b = &u->channels[channel];
    cl_mem own = name == UPDATE_H ? b->h : b->f, other = name == UPDATE_H ? b->f : b->h;
    const struct layout *l = &u->layout;
    enum { BUFFERS = 9 };
    const cl_mem arguments[BUFFERS] = {l->channels[channel].responses,
                                       l->channels[channel].mask,
                                       l->labels,
                                       l->channels[channel].kernels,
                                       b->inverses,
                                       own,
                                       other,
                                       u->scratch,
                                       u->objectives};
    size_t one = 1;
    cl_int status = CL_SUCCESS;
    for (cl_uint i = 0; i < BUFFERS && status == CL_SUCCESS; i++) {
        status = clSetKernelArg(u->kernels[name], i, sizeof(cl_mem), &arguments[i]);
    }
    if (status == CL_SUCCESS) {
        status = clSetKernelArg(u->kernels[name], BUFFERS, sizeof l->sizes, &l->sizes);
    }
    if (status == CL_SUCCESS) {
        status = clSetKernelArg(u->kernels[name], BUFFERS + 1, sizeof u->rule, &u->rule);
    }
    if (status == CL_SUCCESS) {
        status = clEnqueueNDRangeKernel(u->layout.opencl->queue, u->kernels[name], 1, NULL,
                                        &u->items, &one, 0, NULL, NULL);
    }
    return opencl_check(u->layout.opencl, status, "cannot run an update", error);
}

static int collect_objective(struct update *u, double *objective, struct nacre_error *error)
{
    size_t count = u->items * (size_t)(u->layout.sizes.window + u->tile.rows - 1);
    double sum = 0;
    cl_int status = clEnqueueReadBuffer(u->layout.opencl->queue, u->objectives, CL_TRUE, 0,
                                        count * sizeof *u->partials, u->partials, 0, NULL, NULL);
    for (size_t i = 0; i < count; i++) {
        sum += u->partials[i];
    }
    *objective = sum / 2;
    return opencl_check(u->layout.opencl, status, "cannot read the objective", error);
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
    int status = layout_read_factor(&u->layout, u->channels[channel].f, f, error);
    return status == NACRE_OK ? layout_read_factor(&u->layout, u->channels[channel].h, h, error)
                              : status;
}

static int write_factors(struct method *method, int channel, const float *f, const float *h,
                         struct nacre_error *error)
{
    struct update *u = (struct update *)method;
    int status = layout_write_factor(&u->layout, u->channels[channel].f, f, error);
    return status == NACRE_OK ? layout_write_factor(&u->layout, u->channels[channel].h, h, error)
                              : status;
}

static size_t factor_bytes(const struct update *u)
{
    const struct problem *p = u->layout.problem;
    return (size_t)p->terms * (size_t)p->responses->height * (size_t)p->responses->width *
           sizeof(float);
}

/* Nothing but the factors decides the next update. */
static size_t state_size(const struct method *method, int channel)
{
    (void)channel; /* of all alike */
    return 2 * factor_bytes((const struct update *)method);
}

static int save_state(struct method *method, int channel, void *state, struct nacre_error *error)
{
    float *f = state, *h = f + factor_bytes((struct update *)method) / sizeof *f;
    return read_factors(method, channel, f, h, error);
}

static int load_state(struct method *method, int channel, const void *state,
                      struct nacre_error *error)
{
    const float *f = state, *h = f + factor_bytes((struct update *)method) / sizeof *f;
    return write_factors(method, channel, f, h, error);
}

static void explain(const struct method *method, const struct listener *to)
{
    const struct update *u = (const struct update *)method;
    const struct problem *p = u->layout.problem;
    tell(to, "method", "mu: the paper's multiplicative updates, F once and H once an iteration");
    tell(
        to, "tile",
        "%d rows x %d steps x %d terms at a time, %d lanes: what a trial on this device found "
        "(nacre devices --tune), else of the tiles that fit the registers that which pads %d terms "
        "least",
        u->tile.rows, u->tile.steps, u->tile.group, p->responses->lanes, p->terms);
    tell(to, "regularisation",
         p->regularise > 0 ? "updates are raised to the power 1 + %g" : "none (%g)", p->regularise);
    tell(to, "device memory", "%.1f MiB of factors, %.1f MiB of scratch, beside the responses",
         2 * (double)(u->layout.factor_floats * sizeof(float)) * p->responses->channels * 0x1p-20,
         (double)(u->items * (size_t)u->rule.scratch * sizeof(float)) * 0x1p-20);
}

int update_half_step(struct method *method, int channel, bool of_h, struct nacre_error *error)
{
    return launch((struct update *)method, channel, of_h ? UPDATE_H : UPDATE_F, error);
}

int update_wait(struct method *method, struct nacre_error *error)
{
    struct update *u = (struct update *)method;
    return opencl_check(u->layout.opencl, clFinish(u->layout.opencl->queue),
                        "cannot finish an update", error);
}

static void update_free(struct method *method)
{
    struct update *u = (struct update *)method;
    (void)clFinish(
        u->layout.opencl->queue); /* kernels may still read memory that its owner frees next */
    for (int c = 0; c < RESPONSES_CHANNELS; c++) {
        layout_release(u->channels[c].inverses);
        layout_release(u->channels[c].f);
        layout_release(u->channels[c].h);
    }
    layout_release(u->scratch);
    layout_release(u->objectives);
    for (int i = 0; i < KERNEL_COUNT; i++) {
        if (u->kernels[i]) {
            (void)clReleaseKernel(u->kernels[i]);
        }
    }
    if (u->program) {
        (void)clReleaseProgram(u->program);
    }
    layout_finish(&u->layout);
    free(u->partials);
    free(u);
}

static const struct method_ops update_ops = {
    .name = "mu",
    .step = step,
    .measure = measure,
    .read = read_factors,
    .write = write_factors,
    .state_size = state_size,
    .save = save_state,
    .load = load_state,
    .explain = explain,
    .free = update_free,
};

static int prepare(struct update *u, struct nacre_error *error)
{
    size_t objectives = u->items * (size_t)(u->layout.sizes.window + u->tile.rows - 1);
    size_t scratch = u->items * (size_t)u->rule.scratch;
    int status = NACRE_OK;
    u->partials = malloc(objectives * sizeof *u->partials);
    if (!u->partials) {
        return nacre_fail_memory(error, "the objective");
    }
    status = build(u, error);
    if (status == NACRE_OK) {
        status = layout_make_buffer(&u->layout, scratch * sizeof(float), NULL, false, &u->scratch,
                                    error);
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(&u->layout, objectives * sizeof(float), NULL, false,
                                    &u->objectives, error);
    }
    for (int c = 0; c < u->layout.problem->responses->channels && status == NACRE_OK; c++) {
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
    u->tile = tile ? *tile : update_tile_choose(opencl, problem);
    set_rule(u, problem);
    status = layout_begin(&u->layout, opencl, problem, planes_of(problem->terms, u->tile.group),
                          u->tile.rows, error);
    if (status == NACRE_OK) {
        status = prepare(u, error);
    }
    if (status == NACRE_OK) {
        *method = &u->method;
    } else {
        update_free(&u->method);
    }
    return status;
}
