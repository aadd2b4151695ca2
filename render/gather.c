/* The gather on an OpenCL device: sorting, lists of what is in reach, buffers and launches. */
#include "render/gather.h"

#include "render/cells.h"
#include "render/receivers.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const struct opencl_source gather_cl;

enum {
    RECEIVERS_A_LAUNCH = 4096, /* between two looks at the clock and the user */
    GROUP_CELLS = 4,           /* side of the cubes whose receivers share a list, in cells */
};

/* Where samples are no longer taken by quarters of a surface point but by whole ones. */
static const double middle_over_near = 2.5;

/* In the order of the kernel's arguments, after `first`. */
enum buffer {
    BUFFER_RECEIVERS,
    BUFFER_H,
    BUFFER_GROUPS,
    BUFFER_LIST_STARTS,
    BUFFER_LISTS,
    BUFFER_BLOCKS,
    BUFFER_BLOCK_CELLS,
    BUFFER_CELLS,
    BUFFER_CELL_SAMPLES,
    BUFFER_SAMPLES,
    BUFFER_SPOTS,
    BUFFER_QUARTERS,
    BUFFER_QUARTER_SPOTS,
    BUFFER_WHOLES,
    BUFFER_WHOLE_SPOTS,
    BUFFER_FACTORS,
    BUFFER_KERNELS,
    BUFFER_IDS,
    BUFFER_WEIGHTS,
    BUFFER_OUT,
    BUFFER_COUNT,
};

struct run {
    const struct gather *gather;
    const struct opencl *opencl;
    struct receivers receivers;
    struct cells cells;
    uint32_t *order;  /* receivers by group */
    uint32_t *groups; /* of the receivers in that order */
    size_t group_count;
    uint32_t *list_starts, *lists;
    size_t list_count, list_capacity;
    cl_program program;
    cl_kernel kernel;
    cl_mem buffers[BUFFER_COUNT];
};

struct sortable {
    uint64_t key;
    uint32_t index;
};

static int compare_sortable(const void *a, const void *b)
{
    const struct sortable *one = a, *two = b;
    if (one->key != two->key) {
        return one->key < two->key ? -1 : 1;
    }
    return one->index < two->index ? -1 : one->index > two->index;
}

/* Order the receivers by the cubes they are in and number the cubes. */
static int group_receivers(struct run *run, struct nacre_error *error)
{
    size_t count = run->receivers.count;
    double side = GROUP_CELLS * run->gather->mapping->point_mm;
    struct sortable *list = calloc(count + 1, sizeof *list);
    float origin[3] = {HUGE_VALF, HUGE_VALF, HUGE_VALF};
    run->order = calloc(count + 1, sizeof *run->order);
    run->groups = calloc(count + 1, sizeof *run->groups);
    if (!list || !run->order || !run->groups) {
        free(list);
        return nacre_fail_memory(error, "sorting the mesh's vertices");
    }
    for (size_t i = 0; i < count; i++) {
        for (int k = 0; k < 3; k++) {
            origin[k] = fminf(origin[k], run->receivers.list[i].position[k]);
        }
    }
    for (size_t i = 0; i < count; i++) {
        list[i].key = cells_key(run->receivers.list[i].position, origin, side);
        list[i].index = (uint32_t)i;
    }
    qsort(list, count, sizeof *list, compare_sortable);
    for (size_t i = 0; i < count; i++) {
        run->group_count += i == 0 || list[i].key != list[i - 1].key;
        run->order[i] = list[i].index;
        run->groups[i] = (uint32_t)run->group_count - 1;
    }
    free(list);
    return NACRE_OK;
}

static double gap(double low1, double high1, double low2, double high2)
{
    return fmax(fmax(low1 - high2, low2 - high1), 0);
}

/* Append the blocks within reach of a box. */
static int list_blocks(struct run *run, const float low[3], const float high[3], double reach,
                       struct nacre_error *error)
{
    for (size_t b = 0; b < run->cells.block_count; b++) {
        const struct block *block = &run->cells.blocks[b];
        double square = 0;
        for (int k = 0; k < 3; k++) {
            double away = gap(low[k], high[k], block->low[k], block->high[k]);
            square += away * away;
        }
        if (square >= reach * reach) {
            continue;
        }
        if (run->list_count == run->list_capacity) {
            size_t capacity = run->list_capacity ? 2 * run->list_capacity : 4096;
            uint32_t *lists = realloc(run->lists, capacity * sizeof *lists);
            if (!lists || capacity > UINT32_MAX) {
                run->lists = lists ? lists : run->lists;
                return nacre_fail_memory(error, "the lists of light samples in reach");
            }
            run->lists = lists;
            run->list_capacity = capacity;
        }
        run->lists[run->list_count++] = (uint32_t)b;
    }
    return NACRE_OK;
}

static int make_lists(struct run *run, struct nacre_error *error)
{
    const struct receiver *receivers = run->receivers.list;
    double reach = (run->gather->appearance->window / 2 + 1) * sqrt(2) * /* NOLINT: K is odd */
                   run->gather->mapping->point_mm;
    run->list_starts = calloc(run->group_count + 1, sizeof *run->list_starts);
    if (!run->list_starts) {
        return nacre_fail_memory(error, "the lists of light samples in reach");
    }
    for (size_t i = 0; i < run->receivers.count;) {
        uint32_t group = run->groups[i];
        float low[3], high[3];
        memcpy(low, receivers[run->order[i]].position, sizeof low);
        memcpy(high, low, sizeof high);
        for (; i < run->receivers.count && run->groups[i] == group; i++) {
            for (int k = 0; k < 3; k++) {
                low[k] = fminf(low[k], receivers[run->order[i]].position[k]);
                high[k] = fmaxf(high[k], receivers[run->order[i]].position[k]);
            }
        }
        if (list_blocks(run, low, high, reach, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
        run->list_starts[group + 1] = (uint32_t)run->list_count;
    }
    return NACRE_OK;
}

static int build(struct run *run, struct nacre_error *error)
{
    const struct appearance *appearance = run->gather->appearance;
    const struct mapping *mapping = run->gather->mapping;
    double near = fmin(run->gather->near_points * mapping->point_mm, 1e30);
    double middle = fmin(middle_over_near * near, 1e30);
    char options[512];
    cl_int status;
    (void)snprintf(
        options, sizeof options,
        "-cl-mad-enable -DTERMS4=%d -DPLANES=%d -DWINDOW=%d -DMIXED=%d -DCLUSTERS=%d "
        "-DPER_TERM=%d -DWIDTH=%d -DHEIGHT=%d -DMIRROR=%d -DSAME_SIDE=%d -DPOINT_MM=%.9ef "
        "-DNEAR_MM=%.9ef -DMIDDLE_MM=%.9ef",
        appearance->terms / 4, appearance->factor_channels, appearance->window, appearance->mixed,
        appearance->layout == NACRE_KERNEL_PAIR ? appearance->clusters : 0,
        appearance->layout == NACRE_KERNEL_PER_TERM, appearance->width, appearance->height,
        mapping->mirror, run->gather->same_side, mapping->point_mm, near, middle);
    if (opencl_build(run->opencl, &gather_cl, options, &run->program, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    run->kernel = clCreateKernel(run->program, "gather", &status);
    return opencl_check(run->opencl, status, "cannot make the kernel gather", error);
}

static int upload(struct run *run, enum buffer buffer, const void *bytes, size_t size,
                  struct nacre_error *error)
{
    cl_int status;
    /* Some implementations refuse buffers of no size. */
    run->buffers[buffer] = clCreateBuffer(run->opencl->context, CL_MEM_READ_WRITE,
                                          size > 0 ? size : 16, NULL, &status);
    if (status == CL_SUCCESS && size > 0 && bytes) {
        status = clEnqueueWriteBuffer(run->opencl->queue, run->buffers[buffer], CL_TRUE, 0, size,
                                      bytes, 0, NULL, NULL);
    }
    if (status == CL_SUCCESS) {
        status =
            clSetKernelArg(run->kernel, (cl_uint)buffer + 1, sizeof(cl_mem), &run->buffers[buffer]);
    }
    return opencl_check(run->opencl, status, "cannot copy the light samples", error);
}

static int upload_receivers(struct run *run, struct nacre_error *error)
{
    const struct appearance *appearance = run->gather->appearance;
    size_t count = run->receivers.count;
    size_t h_size = (size_t)appearance->factor_channels * (size_t)appearance->terms;
    struct receiver *list = calloc(count + 1, sizeof *list);
    float *h = calloc(count * h_size + 1, sizeof *h);
    int status = NACRE_FAILED;
    if (!list || !h) {
        (void)nacre_fail_memory(error, "sorting the mesh's vertices");
        goto out;
    }
    for (size_t i = 0; i < count; i++) {
        list[i] = run->receivers.list[run->order[i]];
        memcpy(h + i * h_size, run->receivers.h + run->order[i] * h_size, h_size * sizeof *h);
    }
    if (upload(run, BUFFER_RECEIVERS, list, count * sizeof *list, error) == NACRE_OK &&
        upload(run, BUFFER_H, h, count * h_size * sizeof *h, error) == NACRE_OK &&
        upload(run, BUFFER_GROUPS, run->groups, count * sizeof *run->groups, error) == NACRE_OK &&
        upload(run, BUFFER_LIST_STARTS, run->list_starts,
               (run->group_count + 1) * sizeof *run->list_starts, error) == NACRE_OK &&
        upload(run, BUFFER_LISTS, run->lists, run->list_count * sizeof *run->lists, error) ==
            NACRE_OK) {
        status = upload(run, BUFFER_OUT, NULL, count * 4 * sizeof(float), error);
    }
out:
    free(list);
    free(h);
    return status;
}

static int upload_cells(struct run *run, struct nacre_error *error)
{
    const struct cells *cells = &run->cells;
    size_t most = cells->block_count > cells->cell_count ? cells->block_count : cells->cell_count;
    float(*reals)[4] = calloc(2 * most + 1, sizeof *reals);
    uint32_t *integers = calloc(4 * most + 1, sizeof *integers);
    int status = NACRE_FAILED;
    if (!reals || !integers) {
        (void)nacre_fail_memory(error, "the light samples' cells");
        goto out;
    }
    for (size_t i = 0; i < cells->block_count; i++) {
        memcpy(reals[2 * i], cells->blocks[i].low, sizeof cells->blocks[i].low);
        memcpy(reals[2 * i + 1], cells->blocks[i].high, sizeof cells->blocks[i].high);
        integers[2 * i] = cells->blocks[i].cell_begin;
        integers[2 * i + 1] = cells->blocks[i].cell_end;
    }
    if (upload(run, BUFFER_BLOCKS, reals, 2 * cells->block_count * sizeof *reals, error) !=
            NACRE_OK ||
        upload(run, BUFFER_BLOCK_CELLS, integers, 2 * cells->block_count * sizeof *integers,
               error) != NACRE_OK) {
        goto out;
    }
    for (size_t i = 0; i < cells->cell_count; i++) {
        const struct cell *cell = &cells->cells[i];
        memcpy(reals[i], cell->centre, sizeof cell->centre);
        reals[i][3] = cell->radius_mm;
        integers[4 * i] = cell->sample_begin;
        integers[4 * i + 1] = cell->sample_end;
        integers[4 * i + 2] = cell->quarter_begin;
        integers[4 * i + 3] = cell->quarter_end;
    }
    if (upload(run, BUFFER_CELLS, reals, cells->cell_count * sizeof *reals, error) == NACRE_OK) {
        status = upload(run, BUFFER_CELL_SAMPLES, integers,
                        4 * cells->cell_count * sizeof *integers, error);
    }
out:
    free(reals);
    free(integers);
    return status;
}

static int upload_samples(struct run *run, const struct light_sample *samples, size_t count,
                          enum buffer reals_buffer, enum buffer spots_buffer,
                          struct nacre_error *error)
{
    float(*reals)[12] = calloc(count + 1, sizeof *reals);
    uint32_t(*spots)[2] = calloc(count + 1, sizeof *spots);
    int status = NACRE_FAILED;
    if (!reals || !spots) {
        (void)nacre_fail_memory(error, "the light samples");
        goto out;
    }
    for (size_t i = 0; i < count; i++) {
        memcpy(reals[i], samples[i].position, sizeof samples[i].position);
        reals[i][3] = samples[i].x;
        memcpy(reals[i] + 4, samples[i].flux, sizeof samples[i].flux);
        reals[i][7] = samples[i].y;
        memcpy(reals[i] + 8, samples[i].normal, sizeof samples[i].normal);
        spots[i][0] = samples[i].texel;
        spots[i][1] = (uint32_t)samples[i].chart;
    }
    if (upload(run, reals_buffer, reals, count * sizeof *reals, error) == NACRE_OK) {
        status = upload(run, spots_buffer, spots, count * sizeof *spots, error);
    }
out:
    free(reals);
    free(spots);
    return status;
}

static int upload_material(struct run *run, struct nacre_error *error)
{
    const struct appearance *a = run->gather->appearance;
    size_t texels = (size_t)a->width * (size_t)a->height, side = (size_t)a->window + 2;
    size_t factors = texels * (size_t)a->factor_channels * (size_t)a->terms;
    size_t mixed = texels * (size_t)a->mixed;
    size_t kernels = (size_t)(a->layout == NACRE_KERNEL_PER_TERM ? a->terms : a->kernel_count);
    if (upload(run, BUFFER_FACTORS, a->f, factors * sizeof *a->f, error) == NACRE_OK &&
        upload(run, BUFFER_KERNELS, a->kernels, kernels * side * side * 4 * sizeof *a->kernels,
               error) == NACRE_OK &&
        upload(run, BUFFER_IDS, a->ids, mixed * sizeof *a->ids, error) == NACRE_OK) {
        return upload(run, BUFFER_WEIGHTS, a->weights, mixed * sizeof *a->weights, error);
    }
    return NACRE_FAILED;
}

static int launch(struct run *run, struct progress *progress, struct nacre_error *error)
{
    size_t count = run->receivers.count;
    for (size_t first = 0; first < count; first += RECEIVERS_A_LAUNCH) {
        size_t size = count - first < RECEIVERS_A_LAUNCH ? count - first : RECEIVERS_A_LAUNCH;
        cl_uint offset = (cl_uint)first;
        int stopped = progress_step(progress, (double)first, (double)count, NULL, error);
        if (stopped != NACRE_OK) {
            return stopped;
        }
        cl_int status = clSetKernelArg(run->kernel, 0, sizeof offset, &offset);
        if (status == CL_SUCCESS) {
            status = clEnqueueNDRangeKernel(run->opencl->queue, run->kernel, 1, NULL, &size, NULL,
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

static int download(struct run *run, float (*radiosity)[3], struct nacre_error *error)
{
    size_t count = run->receivers.count;
    float(*sums)[4] = calloc(count + 1, sizeof *sums);
    if (!sums) {
        return nacre_fail_memory(error, "the gathered light");
    }
    cl_int status = clEnqueueReadBuffer(run->opencl->queue, run->buffers[BUFFER_OUT], CL_TRUE, 0,
                                        count * sizeof *sums, sums, 0, NULL, NULL);
    for (size_t i = 0; status == CL_SUCCESS && i < count; i++) {
        for (int c = 0; c < 3; c++) {
            radiosity[run->receivers.vertices[run->order[i]]][c] += sums[i][c];
        }
    }
    free(sums);
    return opencl_check(run->opencl, status, "cannot read the gathered light", error);
}

static void run_finish(struct run *run)
{
    for (int i = 0; i < BUFFER_COUNT; i++) {
        if (run->buffers[i]) {
            (void)clReleaseMemObject(run->buffers[i]);
        }
    }
    if (run->kernel) {
        (void)clReleaseKernel(run->kernel);
    }
    if (run->program) {
        (void)clReleaseProgram(run->program);
    }
    receivers_finish(&run->receivers);
    cells_finish(&run->cells);
    free(run->order);
    free(run->groups);
    free(run->list_starts);
    free(run->lists);
}

static int prepare(struct run *run, struct nacre_error *error)
{
    const struct gather *gather = run->gather;
    if (receivers_make(&run->receivers, gather->mesh, gather->mapping, gather->appearance, error) !=
            NACRE_OK ||
        cells_make(&run->cells, gather->samples, gather->mapping->point_mm, error) != NACRE_OK ||
        group_receivers(run, error) != NACRE_OK || make_lists(run, error) != NACRE_OK ||
        build(run, error) != NACRE_OK || upload_receivers(run, error) != NACRE_OK ||
        upload_cells(run, error) != NACRE_OK || upload_material(run, error) != NACRE_OK ||
        upload_samples(run, run->cells.samples, run->cells.sample_count, BUFFER_SAMPLES,
                       BUFFER_SPOTS, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (upload_samples(run, run->cells.quarters, run->cells.quarter_count, BUFFER_QUARTERS,
                       BUFFER_QUARTER_SPOTS, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    return upload_samples(run, run->cells.wholes, run->cells.cell_count, BUFFER_WHOLES,
                          BUFFER_WHOLE_SPOTS, error);
}

int gather_run(const struct gather *gather, const struct opencl *opencl, struct progress *progress,
               float (*radiosity)[3], struct gather_counts *counts, struct nacre_error *error)
{
    struct run run = {.gather = gather, .opencl = opencl};
    int status = prepare(&run, error);
    *counts = (struct gather_counts){run.receivers.count, run.cells.sample_count,
                                     run.cells.quarter_count, run.list_count};
    if (status == NACRE_OK && run.cells.sample_count > 0) {
        status = launch(&run, progress, error);
        if (status == NACRE_OK) {
            status = download(&run, radiosity, error);
        }
    }
    run_finish(&run);
    return status;
}
