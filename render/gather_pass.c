/* A pass of the gather: lattices of posts from coarse to fine, then the vertices. */
#include "render/gather_pass.h"

#include "render/posts.h"
#include "render/sources.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LANES = REACH_LANES, FIELDS = 16 };

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
    const struct reach_bundles *bundles;
    struct reach_bundles own; /* of posts */
    struct posts posts;       /* of the next coarser lattice, where there is one */
};

struct run {
    const struct gather_pass *pass;
    const struct gather *gather;
    const struct levels *levels;
    struct sources sources;
    struct stage stages[LEVELS_MAXIMUM + 1]; /* vertices, then posts from fine to coarse */
    cl_mem sums[LEVELS_MAXIMUM + 1];         /* of the posts of each stage */
    struct device_memory memory;
    struct reach reaches[LEVELS_MAXIMUM + 2]; /* samples, points, squares */
    double done, all;                         /* bundles */
    struct progress *progress;
};

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
        fill_lane(&stage->receivers[index], index, i % LANES, &list[i / LANES]);
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
    size_t terms = (size_t)run->gather->appearance->terms;
    size_t planes = (size_t)run->gather->appearance->factor_channels;
    size_t count = bundles->count * LANES;
    float *h = device_allocate(count * terms * 4 * sizeof *h, arguments->error);
    if (!h) {
        arguments->status = NACRE_FAILED;
        return;
    }
#pragma omp parallel for
    for (size_t i = 0; i < count; i++) {
        by_terms(run->pass->receivers->h + bundles->order[i] * terms * planes, planes, terms,
                 h + i * terms * 4);
    }
    device_set_memory(arguments, device_share(arguments->memory, h, count * terms * 4 * sizeof *h,
                                              h, arguments->error));
}

static void set_factors(const struct run *run, struct device_arguments *arguments)
{
    const struct appearance *a = run->gather->appearance;
    size_t texels = (size_t)a->width * (size_t)a->height, terms = (size_t)a->terms;
    size_t planes = (size_t)a->factor_channels, mixed = texels * (size_t)a->mixed;
    float *factors = device_allocate(texels * terms * 4 * sizeof *factors, arguments->error);
    if (!factors) {
        arguments->status = NACRE_FAILED;
        return;
    }
#pragma omp parallel for
    for (size_t i = 0; i < texels; i++) {
        by_terms(a->f + i * terms * planes, planes, terms, factors + i * terms * 4);
    }
    size_t size = texels * terms * 4 * sizeof *factors;
    device_set_memory(arguments,
                      device_share(arguments->memory, factors, size, factors, arguments->error));
    device_set_shared(arguments, a->ids, mixed * sizeof *a->ids);
    device_set_shared(arguments, a->weights, mixed * sizeof *a->weights);
}

/* The runs of sources in the reach of a stage, from `inner` to `outer` surface points, and the sources. */
static void set_runs(const struct run *run, struct device_arguments *arguments,
                     const struct stage *stage, const struct source_set *sources, double inner,
                     double outer, struct reach *reach)
{
    const struct gather *gather = run->gather;
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

/* A ring of samples or points, windowed where it is read. */
static void set_near(const struct run *run, struct device_arguments *arguments,
                     const struct stage *stage, const struct source_set *sources, struct ring ring,
                     struct reach *reach)
{
    double point = run->gather->mapping->point_mm, inner = LEVELS_RISE * ring.begin;
    struct device_ring out = {.inner_square = (float)(inner * inner * point * point),
                              .outer_square = (float)(ring.end * ring.end * point * point),
                              .side = run->levels->near_side,
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
    set_runs(run, arguments, stage, sources, inner, ring.end, reach);
    device_set(arguments, &out, sizeof out);
}

static void set_far(const struct run *run, struct device_arguments *arguments,
                    const struct level *level, int number)
{
    double point = run->gather->mapping->point_mm;
    double inner = level->inner * point, outer = level->outer * point;
    struct device_ring ring = {.inner_square = (float)(inner * inner),
                               .outer_square = (float)(outer * outer),
                               .side = run->gather->appearance->window + 2,
                               .level = number};
    device_set(arguments, &ring, sizeof ring);
}

/* The posts that a stage takes its light from. */
static void set_links(struct device_arguments *arguments, const struct stage *stage, cl_mem sums)
{
    size_t links = sums ? stage->count * POSTS_A_RECEIVER : 0;
    if (sums) {
        device_set_memory(arguments, sums);
    } else {
        device_set_shared(arguments, NULL, 0);
    }
    device_set_shared(arguments, stage->posts.links, links * sizeof *stage->posts.links);
    device_set_shared(arguments, stage->posts.weights, links * sizeof *stage->posts.weights);
    device_set_number(arguments, sums != NULL);
}

/* Squares of 2^number points to posts as far apart. */
static int gather_squares(struct run *run, int number, struct nacre_error *error)
{
    const struct appearance *a = run->gather->appearance;
    const struct stage *stage = &run->stages[number];
    const struct level *level = &run->levels->squares[number - 1];
    const struct source_set *squares = &run->sources.squares[number - 1];
    struct device_arguments arguments = {
        .memory = &run->memory, .kernel = run->pass->device->squares, .count = 1, .error = error};
    size_t size = run->sources.moment_size * sizeof(float), square = (size_t)1 << number;
    size_t blocks =
        (((size_t)a->width + square - 1) / square) * (((size_t)a->height + square - 1) / square);
    size_t side = (size_t)a->window + 2;
    size_t table =
        (size_t)a->basis.columns * side * side * (size_t)a->basis.parts * 4 * sizeof(float);
    run->sums[number] = device_share(
        &run->memory, NULL, stage->count * (size_t)a->terms * 4 * sizeof(float), NULL, error);
    set_bundles(&arguments, stage);
    set_runs(run, &arguments, stage, squares, level->inner, level->outer,
             &run->reaches[number + 1]);
    device_set_shared(&arguments, run->sources.moments[number - 1], squares->count * size);
    device_set_shared(&arguments, level->table, table);
    device_set_shared(&arguments, run->sources.pyramid[number - 1], blocks * size);
    set_far(run, &arguments, level, number);
    set_links(&arguments, stage, number < run->levels->count ? run->sums[number + 1] : NULL);
    device_set_memory(&arguments, run->sums[number]);
    return device_launch(&arguments, stage->bundles->count, &run->done, run->all, run->progress);
}

static int gather_vertices(struct run *run, cl_mem out, struct nacre_error *error)
{
    const struct appearance *a = run->gather->appearance;
    const struct stage *stage = &run->stages[0];
    const struct levels *levels = run->levels;
    size_t side = (size_t)levels->near_side;
    size_t kernels = (size_t)(a->layout == NACRE_KERNEL_PER_TERM ? a->terms : a->kernel_count);
    size_t table = kernels * side * side * 4 * sizeof(float);
    struct device_arguments arguments = {
        .memory = &run->memory, .kernel = run->pass->device->gather, .count = 1, .error = error};
    set_bundles(&arguments, stage);
    set_h(run, &arguments);
    set_near(run, &arguments, stage, run->pass->samples, levels->samples, &run->reaches[0]);
    set_near(run, &arguments, stage, &run->sources.points, levels->points, &run->reaches[1]);
    device_set_shared(&arguments, levels->near, table);
    device_set_shared(&arguments, levels->bends, levels->merges ? table : 0);
    set_factors(run, &arguments);
    set_links(&arguments, stage, levels->count > 0 ? run->sums[1] : NULL);
    device_set_memory(&arguments, out);
    return device_launch(&arguments, stage->bundles->count, &run->done, run->all, run->progress);
}

/* The sums of the receivers asked for, added up by vertices. */
static int download(const struct run *run, cl_mem out, float (*light)[3], struct nacre_error *error)
{
    const struct receivers *receivers = run->pass->receivers;
    const struct reach_bundles *bundles = run->pass->bundles;
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

/* The vertices, and the lattices of posts above them. */
static int make_stages(struct run *run, struct nacre_error *error)
{
    const struct gather_pass *pass = run->pass;
    double point = run->gather->mapping->point_mm;
    run->stages[0] = (struct stage){.receivers = pass->receivers->list,
                                    .count = pass->receivers->count,
                                    .bundles = pass->bundles};
    for (int i = 0; i <= run->levels->count; i++) {
        struct stage *stage = &run->stages[i];
        if (i > 0) {
            stage->receivers = run->stages[i - 1].posts.list;
            stage->count = run->stages[i - 1].posts.count;
            stage->bundles = &stage->own;
            if (reach_bundle(&stage->own, stage->receivers, stage->count, error) != NACRE_OK) {
                return NACRE_FAILED;
            }
        }
        run->all += (double)stage->bundles->count;
        if (i < run->levels->count && posts_make(&stage->posts, stage->receivers, stage->count,
                                                 (double)(2 << i), point, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
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
        counts->posts += starts && i > 1 ? run->stages[stage].count : 0;
    }
}

static void run_finish(struct run *run)
{
    device_memory_finish(&run->memory);
    for (int i = 0; i <= LEVELS_MAXIMUM; i++) {
        reach_bundles_finish(&run->stages[i].own);
        posts_finish(&run->stages[i].posts);
    }
    for (int i = 0; i < LEVELS_MAXIMUM + 2; i++) {
        reach_finish(&run->reaches[i]);
    }
    sources_finish(&run->sources);
}

int gather_pass_run(const struct gather_pass *pass, struct progress *progress, float (*light)[3],
                    struct gather_counts *counts, struct nacre_error *error)
{
    struct run run = {.pass = pass,
                      .gather = pass->gather,
                      .levels = pass->levels,
                      .memory = {.opencl = pass->device->opencl},
                      .progress = progress};
    memset(light, 0, pass->gather->mesh->vertex_count * sizeof *light);
    int status = sources_make(&run.sources, pass->samples, pass->gather->appearance, pass->levels,
                              pass->gather->mapping->point_mm, error);
    if (status == NACRE_OK) {
        status = make_stages(&run, error);
    }
    for (int number = run.levels->count; status == NACRE_OK && number > 0; number--) {
        status = gather_squares(&run, number, error);
    }
    cl_mem out = NULL;
    if (status == NACRE_OK) {
        out = device_share(&run.memory, NULL, pass->receivers->count * 4 * sizeof(float), NULL,
                           error);
        status = out ? gather_vertices(&run, out, error) : NACRE_FAILED;
    }
    if (status == NACRE_OK) {
        status = download(&run, out, light, error);
        count(&run, counts);
    }
    run_finish(&run);
    return status;
}
