/* The gather on an OpenCL device: buffers and launches. */
#include "render/gather.h"

#include "base/clock.h"
#include "render/cells.h"
#include "render/reach.h"
#include "render/receivers.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const struct opencl_source gather_cl;

enum {
    BUNDLES_A_LAUNCH = 256, /* between two looks at the user */
    LANES = REACH_LANES,
    FIELDS = 16,
    ALIGNMENT = 64,
};

/* In the order of the kernel's arguments, after `first`. */
enum buffer {
    BUFFER_BUNDLES,
    BUFFER_H,
    BUFFER_POINT_STARTS,
    BUFFER_POINT_LIST,
    BUFFER_SQUARE_STARTS,
    BUFFER_SQUARE_LIST,
    BUFFER_POINTS,
    BUFFER_SQUARES,
    BUFFER_MOMENTS,
    BUFFER_FACTORS,
    BUFFER_KERNELS,
    BUFFER_BASIS,
    BUFFER_IDS,
    BUFFER_WEIGHTS,
    BUFFER_OUT,
    BUFFER_COUNT,
};

/* As gather.cl reads them. */
struct device_bundle {
    float fields[FIELDS][LANES];
    int32_t chart[LANES], column[LANES];
};

struct device_point {
    float position[3], x, y, flux[3], normal[3];
    int32_t chart;
    uint32_t texel, unused[3];
};

struct run {
    const struct gather *gather;
    const struct opencl *opencl;
    struct receivers receivers;
    struct cells cells;
    struct reach reach;
    void *owned[BUFFER_COUNT]; /* what the device reads where it can read the host's memory */
    cl_program program;
    cl_kernel kernel;
    cl_mem buffers[BUFFER_COUNT];
};

static int build(struct run *run, struct nacre_error *error)
{
    const struct appearance *appearance = run->gather->appearance;
    const struct mapping *mapping = run->gather->mapping;
    char options[512];
    cl_int status;
    (void)snprintf(options, sizeof options,
                   "-w -DTERMS4=%d -DWINDOW=%d -DMIXED=%d -DCLUSTERS=%d -DPER_TERM=%d -DVECTORS=%d "
                   "-DWIDTH=%d -DHEIGHT=%d -DMIRROR=%d -DSAME_SIDE=%d -DPOINT_MM=%.9ef",
                   appearance->terms / 4, appearance->window, appearance->mixed,
                   appearance->layout == NACRE_KERNEL_PAIR ? appearance->clusters : 0,
                   appearance->layout == NACRE_KERNEL_PER_TERM, appearance->basis.vectors,
                   appearance->width, appearance->height, mapping->mirror, run->gather->same_side,
                   mapping->point_mm);
    if (opencl_build(run->opencl, &gather_cl, options, &run->program, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    run->kernel = clCreateKernel(run->program, "gather", &status);
    return opencl_check(run->opencl, status, "cannot make the kernel gather", error);
}

/* A buffer over the host's memory, which must stay until the run is finished; or of the size alone. */
static int share(struct run *run, enum buffer buffer, const void *bytes, size_t size,
                 struct nacre_error *error)
{
    cl_int status;
    cl_mem_flags flags =
        bytes && size > 0 ? CL_MEM_READ_ONLY | CL_MEM_USE_HOST_PTR : CL_MEM_READ_WRITE;
    /* Some implementations refuse buffers of no size. */
    run->buffers[buffer] =
        clCreateBuffer(run->opencl->context, flags, size > 0 ? size : ALIGNMENT,
                       bytes && size > 0 ? (void *)(uintptr_t)bytes : NULL, &status);
    if (status == CL_SUCCESS) {
        status =
            clSetKernelArg(run->kernel, (cl_uint)buffer + 1, sizeof(cl_mem), &run->buffers[buffer]);
    }
    return opencl_check(run->opencl, status, "cannot copy the light samples", error);
}

/* Memory for a buffer; float16s must be aligned. */
static void *own(struct run *run, enum buffer buffer, size_t size, struct nacre_error *error)
{
    run->owned[buffer] = aligned_alloc(ALIGNMENT, (size / ALIGNMENT + 1) * ALIGNMENT);
    if (!run->owned[buffer]) {
        (void)nacre_fail_memory(error, "the light samples");
    }
    return run->owned[buffer];
}

/* from[planes][terms] to to[terms][4], planes being 1 or 3 */
static void by_terms(const float *from, size_t planes, size_t terms, float *to)
{
    for (size_t t = 0; t < terms; t++) {
        for (size_t c = 0; c < 3; c++) {
            to[t * 4 + c] = from[(planes == 1 ? 0 : c) * terms + t];
        }
        to[t * 4 + 3] = 0;
    }
}

static void fill_bundle(const struct run *run, const struct reach_bundle *bundle,
                        struct device_bundle *out, float *h)
{
    size_t terms = (size_t)run->gather->appearance->terms;
    size_t planes = (size_t)run->gather->appearance->factor_channels;
    for (size_t j = 0; j < LANES; j++) {
        /* Filled up with its own last receiver. */
        size_t place = bundle->begin + j < bundle->end ? bundle->begin + j : bundle->end - 1;
        uint32_t i = run->reach.order[place];
        const struct receiver *r = &run->receivers.list[i];
        for (size_t k = 0; k < 3; k++) {
            out->fields[k][j] = r->position[k];
            out->fields[3 + k][j] = r->along_x[k];
            out->fields[6 + k][j] = r->along_y[k];
            out->fields[9 + k][j] = r->normal[k];
        }
        out->fields[12][j] = r->along_x[3];
        out->fields[13][j] = r->along_y[3];
        out->fields[14][j] = (float)r->flip_x;
        out->fields[15][j] = (float)r->flip_y;
        out->chart[j] = r->chart;
        out->column[j] = r->column;
        by_terms(run->receivers.h + i * terms * planes, planes, terms, h + j * terms * 4);
    }
}

static int share_receivers(struct run *run, struct nacre_error *error)
{
    const struct reach *reach = &run->reach;
    size_t count = reach->bundle_count, h_size = LANES * (size_t)run->gather->appearance->terms * 4;
    struct device_bundle *list = own(run, BUFFER_BUNDLES, count * sizeof *list, error);
    float *h = own(run, BUFFER_H, count * h_size * sizeof *h, error);
    if (!list || !h) {
        return NACRE_FAILED;
    }
#pragma omp parallel for
    for (size_t i = 0; i < count; i++) {
        fill_bundle(run, &reach->bundles[i], &list[i], h + i * h_size);
    }
    size_t points = reach->point_starts[count], squares = reach->square_starts[count];
    size_t starts = (count + 1) * sizeof *reach->point_starts;
    if (share(run, BUFFER_BUNDLES, list, count * sizeof *list, error) == NACRE_OK &&
        share(run, BUFFER_H, h, count * h_size * sizeof *h, error) == NACRE_OK &&
        share(run, BUFFER_POINT_STARTS, reach->point_starts, starts, error) == NACRE_OK &&
        share(run, BUFFER_POINT_LIST, reach->points, points * sizeof *reach->points, error) ==
            NACRE_OK &&
        share(run, BUFFER_SQUARE_STARTS, reach->square_starts, starts, error) == NACRE_OK &&
        share(run, BUFFER_SQUARE_LIST, reach->squares, squares * sizeof *reach->squares, error) ==
            NACRE_OK) {
        return share(run, BUFFER_OUT, NULL, count * LANES * 4 * sizeof(float), error);
    }
    return NACRE_FAILED;
}

static int share_cells(struct run *run, struct nacre_error *error)
{
    const struct cells *cells = &run->cells;
    struct device_point *points =
        own(run, BUFFER_POINTS, cells->point_count * sizeof *points, error);
    float(*squares)[4] = own(run, BUFFER_SQUARES, cells->moment_count * sizeof *squares, error);
    if (!points || !squares) {
        return NACRE_FAILED;
    }
    for (size_t i = 0; i < cells->point_count; i++) {
        const struct light_sample *from = &cells->points[i];
        points[i] = (struct device_point){
            .x = from->x, .y = from->y, .chart = from->chart, .texel = from->texel};
        memcpy(points[i].position, from->position, sizeof from->position);
        memcpy(points[i].flux, from->flux, sizeof from->flux);
        memcpy(points[i].normal, from->normal, sizeof from->normal);
    }
    for (size_t i = 0; i < cells->node_count; i++) {
        const struct cell_node *node = &cells->nodes[i];
        if (node->level > 0) {
            memcpy(squares[node->source], node->position, sizeof node->position);
            squares[node->source][3] = 0;
        }
    }
    size_t moments = cells->moment_count * cells->moment_size * sizeof *cells->moments;
    if (share(run, BUFFER_POINTS, points, cells->point_count * sizeof *points, error) == NACRE_OK &&
        share(run, BUFFER_SQUARES, squares, cells->moment_count * sizeof *squares, error) ==
            NACRE_OK) {
        return share(run, BUFFER_MOMENTS, cells->moments, moments, error);
    }
    return NACRE_FAILED;
}

static int share_material(struct run *run, struct nacre_error *error)
{
    const struct appearance *a = run->gather->appearance;
    size_t texels = (size_t)a->width * (size_t)a->height, side = (size_t)a->window + 2;
    size_t terms = (size_t)a->terms, planes = (size_t)a->factor_channels;
    size_t mixed = texels * (size_t)a->mixed;
    size_t kernels = (size_t)(a->layout == NACRE_KERNEL_PER_TERM ? a->terms : a->kernel_count);
    size_t basis = (size_t)a->basis.columns * side * side * 16 * (size_t)a->basis.vectors;
    float *factors = own(run, BUFFER_FACTORS, texels * terms * 4 * sizeof *factors, error);
    if (!factors) {
        return NACRE_FAILED;
    }
#pragma omp parallel for
    for (size_t i = 0; i < texels; i++) {
        by_terms(a->f + i * terms * planes, planes, terms, factors + i * terms * 4);
    }
    if (share(run, BUFFER_FACTORS, factors, texels * terms * 4 * sizeof *factors, error) ==
            NACRE_OK &&
        share(run, BUFFER_KERNELS, a->kernels, kernels * side * side * 4 * sizeof *a->kernels,
              error) == NACRE_OK &&
        share(run, BUFFER_BASIS, a->basis.table, basis * sizeof *a->basis.table, error) ==
            NACRE_OK &&
        share(run, BUFFER_IDS, a->ids, mixed * sizeof *a->ids, error) == NACRE_OK) {
        return share(run, BUFFER_WEIGHTS, a->weights, mixed * sizeof *a->weights, error);
    }
    return NACRE_FAILED;
}

static int launch(struct run *run, struct progress *progress, struct nacre_error *error)
{
    size_t count = run->reach.bundle_count, one = 1;
    for (size_t first = 0; first < count; first += BUNDLES_A_LAUNCH) {
        size_t size = count - first < BUNDLES_A_LAUNCH ? count - first : BUNDLES_A_LAUNCH;
        cl_uint offset = (cl_uint)first;
        int stopped = progress_step(progress, (double)first, (double)count, NULL, error);
        if (stopped != NACRE_OK) {
            return stopped;
        }
        cl_int status = clSetKernelArg(run->kernel, 0, sizeof offset, &offset);
        if (status == CL_SUCCESS) {
            status = clEnqueueNDRangeKernel(run->opencl->queue, run->kernel, 1, NULL, &size, &one,
                                            0, NULL, NULL);
        }
        if (status == CL_SUCCESS) {
            status = clFinish(run->opencl->queue);
        }
        if (opencl_check(run->opencl, status, "cannot gather light", error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

/* Add up what the receivers of each vertex have, and the bounds. */
static int download(struct run *run, float (*radiosity)[3], struct gather_counts *counts,
                    struct nacre_error *error)
{
    const struct reach *reach = &run->reach;
    double point = run->gather->mapping->point_mm, square = 0, bound_square = 0;
    float(*sums)[4] = calloc(reach->bundle_count * LANES + 1, sizeof *sums);
    if (!sums) {
        return nacre_fail_memory(error, "the gathered light");
    }
    cl_int status =
        clEnqueueReadBuffer(run->opencl->queue, run->buffers[BUFFER_OUT], CL_TRUE, 0,
                            reach->bundle_count * LANES * sizeof *sums, sums, 0, NULL, NULL);
    for (size_t b = 0; status == CL_SUCCESS && b < reach->bundle_count; b++) {
        double bound = reach->bounds[b] / (point * point);
        size_t lanes = reach->bundles[b].end - reach->bundles[b].begin;
        for (size_t j = 0; j < lanes; j++) {
            uint32_t vertex = run->receivers.vertices[reach->order[reach->bundles[b].begin + j]];
            const float *sum = sums[b * LANES + j];
            for (int c = 0; c < 3; c++) {
                radiosity[vertex][c] += sum[c];
            }
            if (run->gather->bounds) {
                run->gather->bounds[vertex] += (float)bound;
            }
            float most = fmaxf(sum[0], fmaxf(sum[1], sum[2]));
            square += (double)most * most;
            bound_square += bound * bound;
        }
        counts->points += lanes * (reach->point_starts[b + 1] - reach->point_starts[b]);
        counts->squares += lanes * (reach->square_starts[b + 1] - reach->square_starts[b]);
    }
    counts->bound = square > 0 ? sqrt(bound_square / square) : 0;
    free(sums);
    return opencl_check(run->opencl, status, "cannot read the gathered light", error);
}

static void run_finish(struct run *run)
{
    for (int i = 0; i < BUFFER_COUNT; i++) {
        if (run->buffers[i]) {
            (void)clReleaseMemObject(run->buffers[i]);
        }
        free(run->owned[i]);
    }
    if (run->kernel) {
        (void)clReleaseKernel(run->kernel);
    }
    if (run->program) {
        (void)clReleaseProgram(run->program);
    }
    receivers_finish(&run->receivers);
    cells_finish(&run->cells);
    reach_finish(&run->reach);
}

static int prepare(struct run *run, struct nacre_error *error)
{
    const struct gather *gather = run->gather;
    double point = gather->mapping->point_mm, area = mesh_area_mm2(gather->mesh);
    if (receivers_make(&run->receivers, gather->mesh, gather->mapping, gather->appearance, error) !=
            NACRE_OK ||
        (gather->appearance->gathers &&
         cells_make(&run->cells, gather->samples, gather->appearance, point, error) != NACRE_OK)) {
        return NACRE_FAILED;
    }
    double mean = area > 0 ? run->cells.brightness / area : 0; /* of pi L */
    if (run->receivers.count == 0 || run->cells.sample_count == 0 || !gather->appearance->gathers) {
        return NACRE_OK;
    }
    return reach_make(&run->reach, &run->receivers, &run->cells, gather->appearance, point,
                      gather->same_side, gather->tolerance * mean * point * point, error);
}

static int gather_light(struct run *run, struct progress *progress, float (*radiosity)[3],
                        struct gather_counts *counts, struct nacre_error *error)
{
    if (run->reach.bundle_count == 0) {
        return NACRE_OK;
    }
    if (build(run, error) != NACRE_OK || share_receivers(run, error) != NACRE_OK ||
        share_cells(run, error) != NACRE_OK || share_material(run, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    int status = launch(run, progress, error);
    return status == NACRE_OK ? download(run, radiosity, counts, error) : status;
}

static double seconds_since(int64_t start_ns)
{
    struct clock clock = clock_monotonic();
    return (double)(clock_now_ns(&clock) - start_ns) * 1e-9;
}

int gather_run(const struct gather *gather, const struct opencl *opencl, struct progress *progress,
               float (*radiosity)[3], struct gather_counts *counts, struct nacre_error *error)
{
    struct run run = {.gather = gather, .opencl = opencl};
    struct clock clock = clock_monotonic();
    int64_t start = clock_now_ns(&clock);
    int status = prepare(&run, error);
    *counts =
        (struct gather_counts){.receivers = run.receivers.count, .samples = run.cells.sample_count};
    counts->prepare_seconds = seconds_since(start);
    start = clock_now_ns(&clock);
    if (status == NACRE_OK) {
        status = gather_light(&run, progress, radiosity, counts, error);
    }
    counts->launch_seconds = seconds_since(start);
    run_finish(&run);
    return status;
}
