/* A pass of the gather: lattices of posts from coarse to fine, then the vertices. */
#include "render/gather_pass.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LANES = REACH_LANES, FIELDS = 16 };

static const double away = SOURCES_WIDEST;

/* In place of infinity, as gather.cl has it: surface points or mm. */
static const double farthest = 1e15;

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

/* A stage and which of its bundles are worked out. */
struct stage {
    const struct gather_stage *all;
    const struct reach_bundles *bundles;
    struct reach_bundles own; /* where not all are */
};

struct run {
    const struct gather_pass *pass;
    const struct gather_stock *stock;
    const struct levels *levels;
    struct stage stages[LEVELS_MAXIMUM + 1];
    cl_mem sums[LEVELS_MAXIMUM + 1]; /* of the posts of each stage */
    struct device_memory memory;
    struct reach reaches[LEVELS_MAXIMUM + 2]; /* samples, points, squares */
    double done, all;                         /* bundles */
    struct progress *progress;
};

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

static void set_bundles(struct device_arguments *arguments, const struct stage *stage)
{
    size_t count = stage->bundles->count;
    struct device_bundle *list = device_allocate(count * sizeof *list, arguments->error);
    if (!list) {
        arguments->status = NACRE_FAILED;
        return;
    }
#pragma omp parallel for
    for (size_t i = 0; i < count * LANES; i++) {
        uint32_t index = stage->bundles->order[i];
        fill_lane(&stage->all->receivers[index], index, i % LANES, &list[i / LANES]);
        if (i % LANES == 0) {
            const struct bundle_box *box = &stage->bundles->boxes[i / LANES];
            memset(list[i / LANES].low, 0, sizeof list->low);
            memset(list[i / LANES].high, 0, sizeof list->high);
            memcpy(list[i / LANES].low, box->low, sizeof box->low);
            memcpy(list[i / LANES].high, box->high, sizeof box->high);
        }
    }
    device_set_memory(arguments, device_share(arguments->memory, list, count * sizeof *list, list,
                                              arguments->error));
}

static void set_h(const struct run *run, struct device_arguments *arguments)
{
    const struct reach_bundles *bundles = run->stages[0].bundles;
    size_t terms = (size_t)run->stock->gather->appearance->terms;
    size_t planes = (size_t)run->stock->gather->appearance->factor_channels;
    size_t count = bundles->count * LANES;
    float *h = device_allocate(count * terms * 4 * sizeof *h, arguments->error);
    if (!h) {
        arguments->status = NACRE_FAILED;
        return;
    }
#pragma omp parallel for
    for (size_t i = 0; i < count; i++) {
        gather_by_terms(run->stock->receivers.h + bundles->order[i] * terms * planes, planes, terms,
                        h + i * terms * 4);
    }
    device_set_memory(arguments, device_share(arguments->memory, h, count * terms * 4 * sizeof *h,
                                              h, arguments->error));
}

static void set_factors(const struct run *run, struct device_arguments *arguments)
{
    const struct appearance *a = run->stock->gather->appearance;
    size_t texels = (size_t)a->width * (size_t)a->height, mixed = texels * (size_t)a->mixed;
    device_set_shared(arguments, run->stock->surface->factors,
                      texels * (size_t)a->terms * 4 * sizeof *run->stock->surface->factors);
    device_set_shared(arguments, a->ids, mixed * sizeof *a->ids);
    device_set_shared(arguments, a->weights, mixed * sizeof *a->weights);
}

/* The runs of sources in the reach of a stage, from `inner` to `outer` surface points, and the sources. */
static void set_runs(const struct run *run, struct device_arguments *arguments,
                     const struct stage *stage, const struct source_set *sources, double inner,
                     double outer, struct reach *reach)
{
    const struct gather *gather = run->stock->gather;
    double point = gather->mapping->point_mm;
    double corner = (gather->appearance->window / 2 + 1) * 1.4142136; /* NOLINT: K is odd */
    if (arguments->status == NACRE_OK) {
        arguments->status = reach_make(reach, stage->bundles, sources, inner * point,
                                       fmin(outer, corner) * point, arguments->error);
    }
    if (arguments->status != NACRE_OK) {
        return;
    }
    size_t count = stage->bundles->count;
    device_set_shared(arguments, reach->starts, (count + 1) * sizeof *reach->starts);
    device_set_shared(arguments, reach->runs, reach->starts[count] * sizeof *reach->runs);
    device_set_shared(arguments, sources->list, sources->count * sizeof *sources->list);
    device_set_number(arguments, sources->count);
}

/* A ring of samples or points, windowed where it is read; they lie at most `apart` from the middle by which they are told.
 * A ring of no width has no sources. */
static void set_near(const struct run *run, struct device_arguments *arguments,
                     const struct source_set *sources, struct ring ring, double apart,
                     struct reach *reach)
{
    const struct stage *stage = &run->stages[0];
    const struct source_set none = {0};
    double point = run->stock->gather->mapping->point_mm;
    double inner = fmax(LEVELS_RISE * ring.begin - apart, 0);
    double outer = fmin(ring.end + apart, farthest / point);
    sources = ring.end > ring.begin ? sources : &none;
    struct device_ring out = {.inner_square = (float)(inner * inner * point * point),
                              .outer_square = (float)(outer * outer * point * point),
                              .side = run->levels->near_side,
                              .rise_from = -1, /* has risen */
                              .rise_steepness = 1,
                              .fall_from = (float)farthest,
                              .fall_steepness = 1};
    if (ring.begin > 0) {
        out.rise_from = (float)(LEVELS_RISE * ring.begin);
        out.rise_steepness = (float)(1 / ((1 - LEVELS_RISE) * ring.begin));
    }
    if (isfinite(ring.end)) {
        out.fall_from = (float)(LEVELS_RISE * ring.end);
        out.fall_steepness = (float)(1 / ((1 - LEVELS_RISE) * ring.end));
    }
    set_runs(run, arguments, stage, sources, inner, outer, reach);
    device_set(arguments, &out, sizeof out);
}

static void set_far(const struct run *run, struct device_arguments *arguments,
                    const struct level *level, int number)
{
    double point = run->stock->gather->mapping->point_mm;
    double inner = level->inner * point, outer = fmin(level->outer * point, farthest);
    struct device_ring ring = {.inner_square = (float)(inner * inner),
                               .outer_square = (float)(outer * outer),
                               .side = run->stock->gather->appearance->window + 2,
                               .level = number};
    device_set(arguments, &ring, sizeof ring);
}

/* The posts that a stage takes its light from. */
static void set_links(struct device_arguments *arguments, const struct stage *stage, cl_mem sums)
{
    size_t links = sums ? stage->all->count * POSTS_A_RECEIVER : 0;
    if (sums) {
        device_set_memory(arguments, sums);
    } else {
        device_set_shared(arguments, NULL, 0);
    }
    device_set_shared(arguments, stage->all->posts.links, links * sizeof *stage->all->posts.links);
    device_set_shared(arguments, stage->all->posts.weights,
                      links * sizeof *stage->all->posts.weights);
    device_set_number(arguments, sums != NULL);
}

/* The kernels as light that is spread over a surface point has them, on the mean. */
static void set_point_kernels(const struct run *run, struct device_arguments *arguments,
                              size_t size)
{
    const struct levels *levels = run->levels;
    float *kernels = levels->merges ? device_allocate(size, arguments->error) : NULL;
    if (!levels->merges) {
        device_set_shared(arguments, NULL, 0);
        return;
    }
    if (!kernels) {
        arguments->status = NACRE_FAILED;
        return;
    }
    float variance = run->stock->sources.variance;
    for (size_t i = 0; i < size / sizeof *kernels; i++) {
        kernels[i] = levels->near[i] + variance * levels->bends[i];
    }
    device_set_memory(arguments,
                      device_share(arguments->memory, kernels, size, kernels, arguments->error));
}

/* Squares of 2^number points to posts as far apart. */
static int gather_squares(struct run *run, int number, struct nacre_error *error)
{
    const struct appearance *a = run->stock->gather->appearance;
    const struct stage *stage = &run->stages[number];
    const struct level *level = &run->levels->squares[number - 1];
    const struct source_set *squares = &run->stock->sources.squares[number - 1];
    struct device_arguments arguments = {
        .memory = &run->memory, .kernel = run->pass->device->squares, .count = 1, .error = error};
    size_t size = run->stock->sources.moment_size * sizeof(float), square = (size_t)1 << number;
    size_t blocks =
        (((size_t)a->width + square - 1) / square) * (((size_t)a->height + square - 1) / square);
    size_t side = (size_t)a->window + 2;
    size_t table =
        (size_t)a->basis.columns * side * side * (size_t)a->basis.parts * 4 * sizeof(float);
    run->sums[number] = device_share(
        &run->memory, NULL, stage->all->count * (size_t)a->terms * 4 * sizeof(float), NULL, error);
    set_bundles(&arguments, stage);
    set_runs(run, &arguments, stage, squares, level->inner, level->outer,
             &run->reaches[number + 1]);
    device_set_shared(&arguments, run->stock->sources.moments[number - 1], squares->count * size);
    device_set_shared(&arguments, level->table, table);
    device_set_shared(&arguments, run->stock->sources.pyramid[number - 1], blocks * size);
    set_far(run, &arguments, level, number);
    set_links(&arguments, stage, number < run->levels->count ? run->sums[number + 1] : NULL);
    device_set_memory(&arguments, run->sums[number]);
    return device_launch(&arguments, stage->bundles->count, &run->done, run->all, run->progress);
}

static int gather_vertices(struct run *run, cl_mem out, struct nacre_error *error)
{
    const struct appearance *a = run->stock->gather->appearance;
    const struct stage *stage = &run->stages[0];
    const struct levels *levels = run->levels;
    size_t side = (size_t)levels->near_side;
    size_t kernels = (size_t)(a->layout == NACRE_KERNEL_PER_TERM ? a->terms : a->kernel_count);
    size_t table = kernels * side * side * 4 * sizeof(float);
    struct device_arguments arguments = {
        .memory = &run->memory, .kernel = run->pass->device->gather, .count = 1, .error = error};
    set_bundles(&arguments, stage);
    set_h(run, &arguments);
    set_near(run, &arguments, levels->merges ? &run->stock->samples : &run->stock->by_kernel,
             levels->samples, away, &run->reaches[0]);
    set_near(run, &arguments, &run->stock->sources.points, levels->points, 0, &run->reaches[1]);
    device_set_shared(&arguments, levels->near, table);
    set_point_kernels(run, &arguments, table);
    set_factors(run, &arguments);
    set_links(&arguments, stage, levels->count > 0 ? run->sums[1] : NULL);
    device_set_memory(&arguments, out);
    return device_launch(&arguments, stage->bundles->count, &run->done, run->all, run->progress);
}

/* The sums of the receivers asked for, added up by vertices. */
static int download(const struct run *run, cl_mem out, float (*light)[3], struct nacre_error *error)
{
    const struct receivers *receivers = &run->stock->receivers;
    const struct reach_bundles *bundles = run->stages[0].bundles;
    const struct opencl *opencl = run->memory.opencl;
    float(*sums)[4] = calloc(receivers->count + 1, sizeof *sums);
    bool *wanted = calloc(receivers->count + 1, sizeof *wanted);
    if (!sums || !wanted) {
        free(sums);
        free(wanted);
        return nacre_fail_memory(error, "the gathered light");
    }
    cl_int status = clEnqueueReadBuffer(opencl->queue, out, CL_TRUE, 0,
                                        receivers->count * sizeof *sums, sums, 0, NULL, NULL);
    for (size_t i = 0; i < bundles->count * LANES; i++) {
        wanted[bundles->order[i]] = true;
    }
    for (size_t i = 0; status == CL_SUCCESS && i < receivers->count; i++) {
        for (int c = 0; wanted[i] && c < 3; c++) {
            light[receivers->vertices[i]][c] += sums[i][c];
        }
    }
    free(sums);
    free(wanted);
    return opencl_check(opencl, status, "cannot read the gathered light", error);
}

/* The posts that the bundles of a stage take light from. */
static int need_posts(const struct run *run, int index, struct reach_bundles *out,
                      struct nacre_error *error)
{
    const struct stage *stage = &run->stages[index];
    const struct gather_stage *coarse = &run->stock->stages[index + 1];
    double apart = (double)(16 << index) * run->stock->gather->mapping->point_mm;
    bool *needed = calloc(coarse->count + 1, sizeof *needed);
    if (!needed) {
        return nacre_fail_memory(error, "the check on the gathered light");
    }
    for (size_t i = 0; i < stage->bundles->count * LANES; i++) {
        const uint32_t *links =
            stage->all->posts.links + stage->bundles->order[i] * (size_t)POSTS_A_RECEIVER;
        for (int k = 0; k < POSTS_A_RECEIVER; k++) {
            needed[links[k]] = true;
        }
    }
    int status = reach_bundle_some(out, coarse->receivers, &coarse->bundles, needed, apart, error);
    free(needed);
    return status;
}

static int make_stages(struct run *run, struct nacre_error *error)
{
    for (int i = 0; i <= LEVELS_MAXIMUM; i++) {
        run->stages[i].all = &run->stock->stages[i];
        run->stages[i].bundles = &run->stock->stages[i].bundles;
    }
    for (int i = 0; i <= run->levels->count; i++) {
        struct stage *stage = &run->stages[i];
        if (run->pass->vertices && i > 0) {
            if (need_posts(run, i - 1, &stage->own, error) != NACRE_OK) {
                return NACRE_FAILED;
            }
            stage->bundles = &stage->own;
        } else if (run->pass->vertices) {
            stage->bundles = run->pass->vertices;
        }
        run->all += (double)stage->bundles->count;
    }
    return NACRE_OK;
}

static void count(const struct run *run, struct gather_counts *counts)
{
    for (int i = 0; i < LEVELS_MAXIMUM + 2; i++) {
        size_t stage = i < 2 ? 0 : (size_t)i - 1;
        const uint32_t *starts = run->reaches[i].starts;
        uint64_t pairs =
            starts ? (uint64_t)starts[run->stages[stage].bundles->count] * LANES * LANES : 0;
        *(i < 2 ? &counts->points : &counts->squares) += pairs;
        counts->posts += starts && i > 1 ? run->stages[stage].bundles->count * LANES : 0;
    }
}

static void run_finish(struct run *run)
{
    device_memory_finish(&run->memory);
    for (int i = 0; i <= LEVELS_MAXIMUM; i++) {
        reach_bundles_finish(&run->stages[i].own);
    }
    for (int i = 0; i < LEVELS_MAXIMUM + 2; i++) {
        reach_finish(&run->reaches[i]);
    }
}

int gather_pass_run(const struct gather_pass *pass, struct progress *progress, float (*light)[3],
                    struct gather_counts *counts, struct nacre_error *error)
{
    struct run run = {.pass = pass,
                      .stock = pass->stock,
                      .levels = pass->levels,
                      .memory = {.opencl = pass->device->opencl},
                      .progress = progress};
    memset(light, 0, pass->stock->gather->mesh->vertex_count * sizeof *light);

    int status = gather_stock_extend(pass->stock, pass->levels, error);
    if (status == NACRE_OK) {
        status = make_stages(&run, error);
    }
    for (int number = run.levels->count; status == NACRE_OK && number > 0; number--) {
        status = gather_squares(&run, number, error);
    }
    cl_mem out = NULL;
    if (status == NACRE_OK) {
        out = device_share(&run.memory, NULL, pass->stock->receivers.count * 4 * sizeof(float),
                           NULL, error);
        status = out ? gather_vertices(&run, out, error) : NACRE_FAILED;
    }
    if (status == NACRE_OK) {
        status = download(&run, out, light, error);
        count(&run, counts);
    }
    run_finish(&run);
    return status;
}
