/* The gather on an OpenCL device: buffers and launches. */
#include "render/gather.h"

#include "base/clock.h"
#include "render/levels.h"
#include "render/posts.h"
#include "render/reach.h"
#include "render/sources.h"

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
    PIECES_MAXIMUM = 80,
};

/* As gather.cl reads them. */
struct device_bundle {
    float fields[FIELDS][LANES];
    int32_t chart[LANES], column[LANES], index[LANES];
    float low[4], high[4];
    float unused[8];
};

struct device_ring {
    float inner_square, outer_square; /* mm^2 */
    int32_t side, level;
    float rise_from, rise_steepness, fall_from, fall_steepness;
};

/* A lattice of posts, or the vertices. */
struct stage {
    const struct receiver *receivers;
    size_t count;
    struct reach_bundles bundles;
    struct posts posts; /* of the next coarser lattice, where there is one */
};

/* Device memory, and host memory that it may stand on. */
struct piece {
    cl_mem memory;
    void *owned;
};

struct run {
    const struct gather *gather;
    const struct opencl *opencl;
    struct receivers receivers;
    struct levels levels;
    struct sources sources;
    struct stage stages[LEVELS_MAXIMUM + 1]; /* vertices, then posts from fine to coarse */
    cl_mem sums[LEVELS_MAXIMUM + 1];         /* of the posts of each stage */
    cl_program program;
    cl_kernel gather_kernel, squares_kernel;
    struct piece pieces[PIECES_MAXIMUM];
    size_t piece_count;
    struct reach reaches[LEVELS_MAXIMUM + 2]; /* samples, points, squares */
    double looked_at;                         /* bundles launched */
};

/* A kernel's arguments as they are set one after the other. */
struct arguments {
    struct run *run;
    cl_kernel kernel;
    cl_uint count;
    int status;
    struct nacre_error *error;
};

static int build(struct run *run, struct nacre_error *error)
{
    const struct appearance *appearance = run->gather->appearance;
    const struct mapping *mapping = run->gather->mapping;
    char options[512];
    cl_int status;
    (void)snprintf(options, sizeof options,
                   "-w -DTERMS4=%d -DWINDOW=%d -DMIXED=%d -DCLUSTERS=%d -DPER_TERM=%d -DPARTS=%d "
                   "-DWIDTH=%d -DHEIGHT=%d -DMIRROR=%d -DSAME_SIDE=%d -DPOINT_MM=%.9ef",
                   appearance->terms / 4, appearance->window, appearance->mixed,
                   appearance->layout == NACRE_KERNEL_PAIR ? appearance->clusters : 0,
                   appearance->layout == NACRE_KERNEL_PER_TERM, appearance->basis.parts,
                   appearance->width, appearance->height, mapping->mirror, run->gather->same_side,
                   mapping->point_mm);
    if (opencl_build(run->opencl, &gather_cl, options, &run->program, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    run->gather_kernel = clCreateKernel(run->program, "gather", &status);
    if (status == CL_SUCCESS) {
        run->squares_kernel = clCreateKernel(run->program, "gather_squares", &status);
    }
    return opencl_check(run->opencl, status, "cannot make the kernel gather", error);
}

/* Memory of the device over the host's, which must stay until the run is finished; or of the size alone. `owned`, which
 * may be NULL, is freed then. */
static cl_mem share(struct run *run, const void *bytes, size_t size, void *owned,
                    struct nacre_error *error)
{
    cl_int status = CL_OUT_OF_RESOURCES;
    bool stands = bytes && size > 0;
    cl_mem_flags flags = stands ? CL_MEM_READ_ONLY | CL_MEM_USE_HOST_PTR : CL_MEM_READ_WRITE;
    struct piece *piece = NULL;
    if (run->piece_count < PIECES_MAXIMUM) {
        piece = &run->pieces[run->piece_count++];
        *piece = (struct piece){.owned = owned};
        /* Some implementations refuse buffers of no size. */
        piece->memory = clCreateBuffer(run->opencl->context, flags, size > 0 ? size : ALIGNMENT,
                                       stands ? (void *)(uintptr_t)bytes : NULL, &status);
    } else {
        free(owned);
    }
    (void)opencl_check(run->opencl, status, "cannot copy the light samples", error);
    return status == CL_SUCCESS ? piece->memory : NULL;
}

static void set(struct arguments *arguments, const void *value, size_t size)
{
    if (arguments->status == NACRE_OK) {
        cl_int status = clSetKernelArg(arguments->kernel, arguments->count, size, value);
        arguments->status =
            opencl_check(arguments->run->opencl, status, "cannot gather light", arguments->error);
    }
    arguments->count++;
}

static void set_memory(struct arguments *arguments, cl_mem memory)
{
    if (!memory && arguments->status == NACRE_OK) {
        arguments->status = NACRE_FAILED; /* share has said why */
    }
    set(arguments, &memory, sizeof memory);
}

static void set_shared(struct arguments *arguments, const void *bytes, size_t size)
{
    set_memory(arguments, share(arguments->run, bytes, size, NULL, arguments->error));
}

static void set_number(struct arguments *arguments, size_t number)
{
    cl_uint value = (cl_uint)number;
    set(arguments, &value, sizeof value);
}

/* Memory for what the device reads as float16s. */
static void *allocate(size_t size, struct nacre_error *error)
{
    void *memory = aligned_alloc(ALIGNMENT, (size / ALIGNMENT + 1) * ALIGNMENT);
    if (!memory) {
        (void)nacre_fail_memory(error, "the light samples");
    }
    return memory;
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

static void fill_lane(const struct receiver *r, uint32_t index, size_t j, struct device_bundle *out)
{
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
    out->index[j] = (int32_t)index;
}

static void set_bundles(struct arguments *arguments, const struct stage *stage)
{
    size_t count = stage->bundles.count;
    struct device_bundle *list = allocate(count * sizeof *list, arguments->error);
    if (!list) {
        arguments->status = NACRE_FAILED;
        return;
    }
#pragma omp parallel for
    for (size_t i = 0; i < count * LANES; i++) {
        uint32_t index = stage->bundles.order[i];
        fill_lane(&stage->receivers[index], index, i % LANES, &list[i / LANES]);
        if (i % LANES == 0) {
            const struct bundle_box *box = &stage->bundles.boxes[i / LANES];
            memset(list[i / LANES].low, 0, sizeof list->low);
            memset(list[i / LANES].high, 0, sizeof list->high);
            memcpy(list[i / LANES].low, box->low, sizeof box->low);
            memcpy(list[i / LANES].high, box->high, sizeof box->high);
        }
    }
    set_memory(arguments,
               share(arguments->run, list, count * sizeof *list, list, arguments->error));
}

static void set_h(struct arguments *arguments)
{
    const struct run *run = arguments->run;
    const struct reach_bundles *bundles = &run->stages[0].bundles;
    size_t terms = (size_t)run->gather->appearance->terms;
    size_t planes = (size_t)run->gather->appearance->factor_channels;
    size_t count = bundles->count * LANES;
    float *h = allocate(count * terms * 4 * sizeof *h, arguments->error);
    if (!h) {
        arguments->status = NACRE_FAILED;
        return;
    }
#pragma omp parallel for
    for (size_t i = 0; i < count; i++) {
        by_terms(run->receivers.h + bundles->order[i] * terms * planes, planes, terms,
                 h + i * terms * 4);
    }
    set_memory(arguments,
               share(arguments->run, h, count * terms * 4 * sizeof *h, h, arguments->error));
}

static void set_factors(struct arguments *arguments)
{
    const struct appearance *a = arguments->run->gather->appearance;
    size_t texels = (size_t)a->width * (size_t)a->height, terms = (size_t)a->terms;
    size_t planes = (size_t)a->factor_channels, mixed = texels * (size_t)a->mixed;
    float *factors = allocate(texels * terms * 4 * sizeof *factors, arguments->error);
    if (!factors) {
        arguments->status = NACRE_FAILED;
        return;
    }
#pragma omp parallel for
    for (size_t i = 0; i < texels; i++) {
        by_terms(a->f + i * terms * planes, planes, terms, factors + i * terms * 4);
    }
    size_t size = texels * terms * 4 * sizeof *factors;
    set_memory(arguments, share(arguments->run, factors, size, factors, arguments->error));
    set_shared(arguments, a->ids, mixed * sizeof *a->ids);
    set_shared(arguments, a->weights, mixed * sizeof *a->weights);
}

/* The runs of sources in the reach of a stage, from `inner` to `outer` surface points, and the sources. */
static void set_runs(struct arguments *arguments, const struct stage *stage,
                     const struct source_set *sources, double inner, double outer,
                     struct reach *reach)
{
    const struct gather *gather = arguments->run->gather;
    double point = gather->mapping->point_mm;
    double corner = (gather->appearance->window / 2 + 1) * 1.4142136; /* NOLINT: K is odd */
    if (arguments->status == NACRE_OK) {
        arguments->status = reach_make(reach, &stage->bundles, sources, inner * point,
                                       fmin(outer, corner) * point, arguments->error);
    }
    if (arguments->status != NACRE_OK) {
        return;
    }
    size_t count = stage->bundles.count;
    set_shared(arguments, reach->starts, (count + 1) * sizeof *reach->starts);
    set_shared(arguments, reach->runs, reach->starts[count] * sizeof *reach->runs);
    set_shared(arguments, sources->list, sources->count * sizeof *sources->list);
    set_number(arguments, sources->count);
}

/* A ring of samples or points, windowed where it is read. */
static void set_near(struct arguments *arguments, const struct stage *stage,
                     const struct source_set *sources, struct ring ring, struct reach *reach)
{
    double point = arguments->run->gather->mapping->point_mm, inner = LEVELS_RISE * ring.begin;
    struct device_ring out = {.inner_square = (float)(inner * inner * point * point),
                              .outer_square = (float)(ring.end * ring.end * point * point),
                              .side = arguments->run->levels.near_side,
                              .rise_from = -1, /* has risen */
                              .rise_steepness = 1,
                              .fall_from = HUGE_VALF,
                              .fall_steepness = 1};
    if (ring.begin > 0) {
        out.rise_from = (float)inner;
        out.rise_steepness = (float)(1 / (ring.begin - inner));
    }
    if (isfinite(ring.end)) {
        out.fall_from = (float)(LEVELS_RISE * ring.end);
        out.fall_steepness = (float)(1 / ((1 - LEVELS_RISE) * ring.end));
    }
    set_runs(arguments, stage, sources, inner, ring.end, reach);
    set(arguments, &out, sizeof out);
}

static void set_far(struct arguments *arguments, const struct level *level, int number)
{
    double point = arguments->run->gather->mapping->point_mm;
    double inner = level->inner * point, outer = level->outer * point;
    struct device_ring ring = {.inner_square = (float)(inner * inner),
                               .outer_square = (float)(outer * outer),
                               .side = arguments->run->gather->appearance->window + 2,
                               .level = number};
    set(arguments, &ring, sizeof ring);
}

/* The posts that a stage takes its light from. */
static void set_links(struct arguments *arguments, const struct stage *stage, cl_mem sums)
{
    size_t links = sums ? stage->count * POSTS_A_RECEIVER : 0;
    if (sums) {
        set_memory(arguments, sums);
    } else {
        set_shared(arguments, NULL, 0);
    }
    set_shared(arguments, stage->posts.links, links * sizeof *stage->posts.links);
    set_shared(arguments, stage->posts.weights, links * sizeof *stage->posts.weights);
    set_number(arguments, sums != NULL);
}

static int launch(struct arguments *arguments, size_t count, struct progress *progress)
{
    struct run *run = arguments->run;
    size_t one = 1, all = 0;
    for (int i = 0; i <= run->levels.count; i++) {
        all += run->stages[i].bundles.count;
    }
    for (size_t first = 0; arguments->status == NACRE_OK && first < count;
         first += BUNDLES_A_LAUNCH) {
        size_t size = count - first < BUNDLES_A_LAUNCH ? count - first : BUNDLES_A_LAUNCH;
        cl_uint offset = (cl_uint)first;
        arguments->status =
            progress_step(progress, run->looked_at, (double)all, NULL, arguments->error);
        if (arguments->status != NACRE_OK) {
            return arguments->status;
        }
        cl_int status = clSetKernelArg(arguments->kernel, 0, sizeof offset, &offset);
        if (status == CL_SUCCESS) {
            status = clEnqueueNDRangeKernel(run->opencl->queue, arguments->kernel, 1, NULL, &size,
                                            &one, 0, NULL, NULL);
        }
        if (status == CL_SUCCESS) {
            status = clFinish(run->opencl->queue);
        }
        arguments->status =
            opencl_check(run->opencl, status, "cannot gather light", arguments->error);
        run->looked_at += (double)size;
    }
    return arguments->status;
}

/* Squares of 2^number points to posts as far apart. */
static int gather_squares(struct run *run, int number, struct progress *progress,
                          struct nacre_error *error)
{
    const struct appearance *a = run->gather->appearance;
    const struct stage *stage = &run->stages[number];
    const struct level *level = &run->levels.squares[number - 1];
    const struct source_set *squares = &run->sources.squares[number - 1];
    struct arguments arguments = {
        .run = run, .kernel = run->squares_kernel, .count = 1, .error = error};
    size_t size = run->sources.moment_size * sizeof(float), square = (size_t)1 << number;
    size_t blocks =
        (((size_t)a->width + square - 1) / square) * (((size_t)a->height + square - 1) / square);
    size_t side = (size_t)a->window + 2;
    size_t table =
        (size_t)a->basis.columns * side * side * (size_t)a->basis.parts * 4 * sizeof(float);
    run->sums[number] =
        share(run, NULL, stage->count * (size_t)a->terms * 4 * sizeof(float), NULL, error);
    set_bundles(&arguments, stage);
    set_runs(&arguments, stage, squares, level->inner, level->outer, &run->reaches[number + 1]);
    set_shared(&arguments, run->sources.moments[number - 1], squares->count * size);
    set_shared(&arguments, level->table, table);
    set_shared(&arguments, run->sources.pyramid[number - 1], blocks * size);
    set_far(&arguments, level, number);
    set_links(&arguments, stage, number < run->levels.count ? run->sums[number + 1] : NULL);
    set_memory(&arguments, run->sums[number]);
    return launch(&arguments, stage->bundles.count, progress);
}

static int gather_vertices(struct run *run, cl_mem out, struct progress *progress,
                           struct nacre_error *error)
{
    const struct appearance *a = run->gather->appearance;
    const struct stage *stage = &run->stages[0];
    const struct levels *levels = &run->levels;
    size_t side = (size_t)levels->near_side;
    size_t kernels = (size_t)(a->layout == NACRE_KERNEL_PER_TERM ? a->terms : a->kernel_count);
    size_t table = kernels * side * side * 4 * sizeof(float);
    struct arguments arguments = {
        .run = run, .kernel = run->gather_kernel, .count = 1, .error = error};
    set_bundles(&arguments, stage);
    set_h(&arguments);
    set_near(&arguments, stage, &run->sources.samples, levels->samples, &run->reaches[0]);
    set_near(&arguments, stage, &run->sources.points, levels->points, &run->reaches[1]);
    set_shared(&arguments, levels->near, table);
    set_shared(&arguments, levels->bends, levels->merges ? table : 0);
    set_factors(&arguments);
    set_links(&arguments, stage, levels->count > 0 ? run->sums[1] : NULL);
    set_memory(&arguments, out);
    return launch(&arguments, stage->bundles.count, progress);
}

static int download(struct run *run, cl_mem out, float (*radiosity)[3], struct nacre_error *error)
{
    size_t count = run->receivers.count;
    float(*sums)[4] = calloc(count + 1, sizeof *sums);
    if (!sums) {
        return nacre_fail_memory(error, "the gathered light");
    }
    cl_int status = clEnqueueReadBuffer(run->opencl->queue, out, CL_TRUE, 0, count * sizeof *sums,
                                        sums, 0, NULL, NULL);
    for (size_t i = 0; status == CL_SUCCESS && i < count; i++) {
        for (int c = 0; c < 3; c++) {
            radiosity[run->receivers.vertices[i]][c] += sums[i][c];
        }
    }
    free(sums);
    return opencl_check(run->opencl, status, "cannot read the gathered light", error);
}

static int gather_light(struct run *run, struct progress *progress, float (*radiosity)[3],
                        struct nacre_error *error)
{
    if (build(run, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (int number = run->levels.count; number > 0; number--) {
        int status = gather_squares(run, number, progress, error);
        if (status != NACRE_OK) {
            return status;
        }
    }
    cl_mem out = share(run, NULL, run->receivers.count * 4 * sizeof(float), NULL, error);
    int status = out ? gather_vertices(run, out, progress, error) : NACRE_FAILED;
    return status == NACRE_OK ? download(run, out, radiosity, error) : status;
}

static void run_finish(struct run *run)
{
    for (size_t i = 0; i < run->piece_count; i++) {
        if (run->pieces[i].memory) {
            (void)clReleaseMemObject(run->pieces[i].memory);
        }
        free(run->pieces[i].owned);
    }
    if (run->gather_kernel) {
        (void)clReleaseKernel(run->gather_kernel);
    }
    if (run->squares_kernel) {
        (void)clReleaseKernel(run->squares_kernel);
    }
    if (run->program) {
        (void)clReleaseProgram(run->program);
    }
    for (int i = 0; i <= LEVELS_MAXIMUM; i++) {
        reach_bundles_finish(&run->stages[i].bundles);
        posts_finish(&run->stages[i].posts);
    }
    for (int i = 0; i < LEVELS_MAXIMUM + 2; i++) {
        reach_finish(&run->reaches[i]);
    }
    receivers_finish(&run->receivers);
    levels_finish(&run->levels);
    sources_finish(&run->sources);
}

/* The vertices, and the lattices of posts above them. */
static int make_stages(struct run *run, struct nacre_error *error)
{
    double point = run->gather->mapping->point_mm;
    for (int i = 0; i <= run->levels.count; i++) {
        struct stage *stage = &run->stages[i];
        const struct posts *finer = i > 0 ? &run->stages[i - 1].posts : NULL;
        stage->receivers = finer ? finer->list : run->receivers.list;
        stage->count = finer ? finer->count : run->receivers.count;
        if (reach_bundle(&stage->bundles, stage->receivers, stage->count, error) != NACRE_OK ||
            (i < run->levels.count && posts_make(&stage->posts, stage->receivers, stage->count,
                                                 (double)(2 << i), point, error) != NACRE_OK)) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

static int prepare(struct run *run, struct nacre_error *error)
{
    const struct gather *gather = run->gather;
    if (receivers_make(&run->receivers, gather->mesh, gather->mapping, gather->appearance, error) !=
        NACRE_OK) {
        return NACRE_FAILED;
    }
    if (run->receivers.count == 0 || !gather->appearance->gathers) {
        return NACRE_OK;
    }
    if (levels_make(&run->levels, gather->appearance, gather->tolerance, error) != NACRE_OK ||
        sources_make(&run->sources, gather->samples, gather->appearance, &run->levels,
                     gather->mapping->point_mm, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    return run->sources.samples.count > 0 ? make_stages(run, error) : NACRE_OK;
}

static void count(const struct run *run, struct gather_counts *counts)
{
    counts->receivers = run->receivers.count;
    counts->samples = run->sources.samples.count;
    counts->estimate = run->levels.estimate;
    for (int i = 0; i < LEVELS_MAXIMUM + 2; i++) {
        size_t stage = i < 2 ? 0 : (size_t)i - 1;
        const uint32_t *starts = run->reaches[i].starts;
        uint64_t pairs =
            starts ? (uint64_t)starts[run->stages[stage].bundles.count] * LANES * LANES : 0;
        *(i < 2 ? &counts->points : &counts->squares) += pairs;
        counts->posts += i > 1 ? run->stages[stage].count : 0;
    }
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
    *counts = (struct gather_counts){.prepare_seconds = seconds_since(start)};
    start = clock_now_ns(&clock);
    if (status == NACRE_OK && run.sources.samples.count > 0) {
        status = gather_light(&run, progress, radiosity, error);
    }
    count(&run, counts);
    counts->launch_seconds = seconds_since(start);
    run_finish(&run);
    return status;
}
