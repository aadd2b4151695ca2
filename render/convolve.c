/* Patches block by block: light to the lattice, its planes there and back, and the sums at the receivers. */
#include "render/convolve.h"

#include "render/convolve_fft.h"
#include "render/convolve_kernels.h"
#include "render/convolve_rows.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

enum { MIRRORINGS = 4 };

struct run {
    const struct convolve *convolve;
    const struct convolve_light *how;
    float (*light)[3];
    int32_t *of_sample; /* [samples]: its patch, or -1 */
    const struct convolve_plan *plan;
    struct convolve_rows samples, receivers; /* of the patch */
    int threads;
    struct fft_plane *ffts; /* [threads] */
    float complex *spectra; /* [threads][2][width / 2 + 1][height] */
    float *sums;            /* [threads][width][planes of light, terms rounded up] */
    struct convolve_kernels kernels;
    float *in, *out; /* [planes][height][width]; [mirrorings][planes][rows][width] */
    size_t out_size; /* floats */
};

/* A block: what it serves, and the node at the corner of its transform. */
struct block {
    int x, y, right, down; /* surface points */
    int node_x, node_y;
    int rows;             /* of what leaves */
    int slot[MIRRORINGS]; /* of those there are: which of `out`; else -1 */
    int slots;
};

static bool same_kernels(const struct appearance *a)
{
    size_t side = (size_t)a->window + 2, count = side * side * (size_t)a->terms;
    bool same = true;
    for (size_t i = 0; same && i < count; i++) {
        const float *g = a->kernels + i * 4;
        same = g[0] == g[1] && g[1] == g[2];
    }
    return same;
}

struct convolve_light convolve_light(const struct appearance *appearance,
                                     const struct source_set *samples)
{
    struct convolve_light how = {.suits = appearance->layout == NACRE_KERNEL_PER_TERM &&
                                          samples->count > 0 && samples->count < UINT32_MAX,
                                 .one_color = appearance->factor_channels == 1};
    double sum[3] = {0};
    for (size_t i = 0; how.suits && i < samples->count; i++) {
        for (int c = 0; c < 3; c++) {
            sum[c] += samples->list[i].flux[c];
        }
    }
    double all = sum[0] + sum[1] + sum[2];
    how.suits = how.suits && isfinite(all) && all > 0;
    for (int c = 0; how.suits && c < 3; c++) {
        how.color[c] = (float)(sum[c] / all);
    }
    for (size_t i = 0; how.suits && how.one_color && i < samples->count; i++) {
        const float *flux = samples->list[i].flux;
        double own = (double)flux[0] + flux[1] + flux[2];
        for (int c = 0; c < 3; c++) {
            how.one_color = how.one_color && fabs(flux[c] - own * how.color[c]) <= 2e-6 * own;
        }
    }
    how.one_kernel = how.suits && how.one_color && same_kernels(appearance);
    how.planes.in = appearance->kernel_count * (how.one_color ? 1 : 3);
    how.planes.out = appearance->kernel_count * (how.one_kernel ? 1 : 3);
    return how;
}

/* Which patch each sample's light falls on. */
static void place_samples(const struct run *run)
{
    const struct convolve *c = run->convolve;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < c->samples->count; i++) {
        const struct source *s = &c->samples->list[i];
        run->of_sample[i] = convolve_patch_at(c->patches, c->receivers->list, s->chart, s->x, s->y,
                                              s->position, s->normal, c->mapping->point_mm);
    }
}

static int sort_rows(struct run *run, size_t patch, struct nacre_error *error)
{
    const struct convolve *c = run->convolve;
    const struct convolve_patch *p = &c->patches->list[patch];
    size_t samples = c->samples->count, receivers = c->receivers->count;
    float fine = (float)run->plan->fine;
    int32_t *row = malloc(((samples > receivers ? samples : receivers) + 1) * sizeof *row);
    if (!row) {
        return nacre_fail_memory(error, "the light in the texture");
    }
    for (size_t i = 0; i < samples; i++) {
        bool here = run->of_sample[i] == (int32_t)patch;
        row[i] = here ? (int32_t)floorf(c->samples->list[i].y * fine - 0.5F) : INT32_MIN;
    }
    int status = convolve_rows_make(&run->samples, p->y * run->plan->fine - 1,
                                    p->height * run->plan->fine + 1, row, samples, error);
    for (size_t i = 0; i < receivers; i++) {
        bool here = c->patches->of[i] == (int)patch;
        row[i] = here ? (int32_t)floorf(c->receivers->list[i].along_y[3]) : INT32_MIN;
    }
    if (status == NACRE_OK) {
        status = convolve_rows_make(&run->receivers, p->y, p->height, row, receivers, error);
    }
    free(row);
    return status;
}

/* What one sample's light is in each plane, at a node, or less where only a share is handed to it. */
static void add_to_node(float *sums, const float *factors, const float *flux, float share,
                        size_t colors, size_t planes, size_t terms)
{
    for (size_t c = 0; c < colors; c++) {
        const float *f = factors + (planes == 1 ? 0 : c) * terms;
        float weight = share * flux[c];
        for (size_t t = 0; t < terms; t++) {
            sums[c * terms + t] += weight * f[t];
        }
    }
}

/* How much a node `away` nodes from light is handed of it, along one axis. */
static float share_of(float away, float fine)
{
    return fmaxf(1 - fabsf(away) / fine, 0);
}

/* To one row of nodes, light of the samples between two rows. */
static void add_row(const struct run *run, const struct block *block, int node, int row,
                    float *sums)
{
    const struct convolve *c = run->convolve;
    const struct appearance *a = c->appearance;
    size_t colors = run->how->one_color ? 1 : 3, planes = (size_t)a->factor_channels;
    size_t terms = (size_t)a->terms, from, to;
    int width = run->plan->x.size;
    float fine = (float)run->plan->fine;
    convolve_rows_between(&run->samples, row, row + 1, &from, &to);
    for (size_t k = from; k < to; k++) {
        const struct source *s = &c->samples->list[run->samples.order[k]];
        float x = s->x * fine - 0.5F - (float)block->node_x;
        float down = share_of(s->y * fine - 0.5F - (float)node, fine);
        const float gray = s->flux[0] + s->flux[1] + s->flux[2];
        const float *flux = colors == 1 ? &gray : s->flux;
        const float *factors = a->f + (size_t)s->texel * planes * terms;
        int first = (int)floorf(x) + 1 - run->plan->fine;
        for (int column = first; column < first + 2 * run->plan->fine; column++) {
            if (column >= 0 && column < width) {
                add_to_node(sums + (size_t)column * colors * terms, factors, flux,
                            down * share_of(x - (float)column, fine), colors, planes, terms);
            }
        }
    }
}

static void splat(const struct run *run, const struct block *block)
{
    const struct appearance *a = run->convolve->appearance;
    size_t colors = run->how->one_color ? 1 : 3, terms = (size_t)a->terms;
    size_t width = (size_t)run->plan->x.size, height = (size_t)run->plan->y.size;
    size_t kept = (size_t)a->kernel_count;
#pragma omp parallel for schedule(dynamic, 8)
    for (size_t j = 0; j < height; j++) {
        float *sums = run->sums + (size_t)omp_get_thread_num() * width * colors * terms;
        memset(sums, 0, width * colors * terms * sizeof *sums);
        for (int row = -run->plan->fine; row < run->plan->fine; row++) {
            add_row(run, block, block->node_y + (int)j, block->node_y + (int)j + row, sums);
        }
        for (size_t k = 0; k < colors * kept; k++) {
            size_t plane = k / kept * terms + k % kept;
            float *out = run->in + (k * height + j) * width;
            for (size_t x = 0; x < width; x++) {
                out[x] = sums[x * colors * terms + plane];
            }
        }
    }
}

/* A plane of light there, times the kernels that it is for, and back. */
static void transform_plane(const struct run *run, const struct block *block, int plane)
{
    const struct convolve_plan *plan = run->plan;
    size_t width = (size_t)plan->x.size, height = (size_t)plan->y.size;
    size_t size = (width / 2 + 1) * height, rows = (size_t)block->rows;
    int thread = omp_get_thread_num(), kept = run->kernels.terms, term = plane % kept;
    float complex *light = run->spectra + (size_t)thread * 2 * size, *product = light + size;
    const struct fft_plane *fft = &run->ffts[thread];
    int color = plane / kept, last = run->how->one_color ? run->kernels.colors : color + 1;
    fft_plane_forward(fft, run->in + (size_t)plane * height * width, 0, (int)height, light);
    for (; color < last; color++) {
        for (int m = 0; m < MIRRORINGS; m++) {
            if (block->slot[m] >= 0) {
                size_t out = (size_t)block->slot[m] * (size_t)run->how->planes.out +
                             (size_t)color * (size_t)kept + (size_t)term;
                convolve_kernels_apply(&run->kernels, color, term, m & 1, m >> 1, light, product);
                fft_plane_inverse(fft, product, plan->reach, plan->reach + block->rows,
                                  run->out + out * rows * width);
            }
        }
    }
}

static int mirroring_of(const struct receiver *receiver)
{
    return (receiver->flip_x < 0) + 2 * (receiver->flip_y < 0);
}

/* Weights of the four nodes around a place by cubic B-splines; returns the first. */
static int spline(float place, float weights[4])
{
    float whole = floorf(place), f = place - whole, g = 1 - f;
    weights[0] = g * g * g / 6;
    weights[1] = (4 - 6 * f * f + 3 * f * f * f) / 6;
    weights[2] = (4 - 6 * g * g + 3 * g * g * g) / 6;
    weights[3] = f * f * f / 6;
    return (int)whole - 1;
}

static void read_receiver(const struct run *run, const struct block *block, size_t index)
{
    const struct convolve *c = run->convolve;
    const struct receiver *receiver = &c->receivers->list[index];
    size_t kept = (size_t)c->appearance->kernel_count, terms = (size_t)c->appearance->terms;
    size_t planes = (size_t)c->appearance->factor_channels, width = (size_t)run->plan->x.size;
    size_t rows = (size_t)block->rows, all = (size_t)run->how->planes.out;
    const float *h = c->receivers->h + index * planes * terms;
    float across[4], down[4];
    float fine = (float)run->plan->fine;
    int column = spline(receiver->along_x[3] * fine - 0.5F, across) - block->node_x;
    int row = spline(receiver->along_y[3] * fine - 0.5F, down) - block->node_y - run->plan->reach;
    size_t first = (size_t)block->slot[mirroring_of(receiver)] * all * rows * width +
                   (size_t)row * width + (size_t)column;
    double point = c->mapping->point_mm, sums[3] = {0};
    for (size_t k = 0; k < all; k++) {
        const float *from = run->out + first + k * rows * width;
        float value = 0;
        for (int j = 0; j < 4; j++, from += width) {
            value += down[j] * (across[0] * from[0] + across[1] * from[1] + across[2] * from[2] +
                                across[3] * from[3]);
        }
        for (size_t color = k / kept; color < (run->how->one_kernel ? 3 : k / kept + 1); color++) {
            sums[color] += (double)value * h[(planes == 1 ? 0 : color) * terms + k % kept];
        }
    }
    for (int color = 0; color < 3; color++) {
        double scale = run->how->one_color ? run->how->color[color] : 1;
        run->light[index][color] = (float)(scale * sums[color] / (point * point));
    }
}

static bool within(const struct receiver *receiver, const struct block *block)
{
    return receiver->along_x[3] >= (float)block->x && receiver->along_x[3] < (float)block->right;
}

/* Number the ways in which kernels are mirrored for the block's receivers. */
static void find_slots(const struct run *run, struct block *block)
{
    const struct receiver *list = run->convolve->receivers->list;
    bool there[MIRRORINGS] = {false};
    size_t from, to;
    convolve_rows_between(&run->receivers, block->y, block->down, &from, &to);
    for (size_t k = from; k < to; k++) {
        const struct receiver *receiver = &list[run->receivers.order[k]];
        if (within(receiver, block)) {
            there[mirroring_of(receiver)] = true;
        }
    }
    block->slots = 0;
    for (int m = 0; m < MIRRORINGS; m++) {
        block->slot[m] = there[m] ? block->slots++ : -1;
    }
}

static void read_receivers(const struct run *run, const struct block *block)
{
    size_t from, to;
    convolve_rows_between(&run->receivers, block->y, block->down, &from, &to);
#pragma omp parallel for schedule(dynamic, 1024)
    for (size_t k = from; k < to; k++) {
        size_t index = run->receivers.order[k];
        if (within(&run->convolve->receivers->list[index], block)) {
            read_receiver(run, block, index);
        }
    }
}

static int reserve(struct run *run, const struct block *block, struct nacre_error *error)
{
    size_t size = (size_t)block->slots * (size_t)run->how->planes.out * (size_t)block->rows *
                  (size_t)run->plan->x.size;
    if (size <= run->out_size) {
        return NACRE_OK;
    }
    free(run->out);
    run->out = malloc(size * sizeof *run->out);
    run->out_size = run->out ? size : 0;
    return run->out ? NACRE_OK : nacre_fail_memory(error, "the light in the texture");
}

static int convolve_block(struct run *run, int column, int row, struct nacre_error *error)
{
    const struct convolve_plan *plan = run->plan;
    struct block block = {.x = plan->x.starts[column],
                          .right = plan->x.starts[column + 1],
                          .y = plan->y.starts[row],
                          .down = plan->y.starts[row + 1]};
    block.node_x = block.x * plan->fine - 2 - plan->reach;
    block.node_y = block.y * plan->fine - 2 - plan->reach;
    block.rows = (block.down - block.y) * plan->fine + 4;
    find_slots(run, &block);
    if (block.slots == 0) {
        return NACRE_OK;
    }
    if (reserve(run, &block, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    splat(run, &block);
#pragma omp parallel for schedule(dynamic, 1)
    for (int plane = 0; plane < run->how->planes.in; plane++) {
        transform_plane(run, &block, plane);
    }
    read_receivers(run, &block);
    return NACRE_OK;
}

static int make_patch(struct run *run, size_t patch, struct nacre_error *error)
{
    const struct appearance *a = run->convolve->appearance;
    size_t width = (size_t)run->plan->x.size, height = (size_t)run->plan->y.size;
    size_t threads = (size_t)run->threads, colors = run->how->one_color ? 1 : 3;
    size_t in = (size_t)run->how->planes.in * height * width;
    run->ffts = calloc(threads, sizeof *run->ffts);
    run->spectra = malloc(threads * 2 * (width / 2 + 1) * height * sizeof *run->spectra);
    run->sums = malloc(threads * width * colors * (size_t)a->terms * sizeof *run->sums);
    run->in = malloc(in * sizeof *run->in);
    if (!run->ffts || !run->spectra || !run->sums || !run->in) {
        return nacre_fail_memory(error, "the light in the texture");
    }
    for (size_t i = 0; i < threads; i++) {
        if (fft_plane_make(&run->ffts[i], (int)width, (int)height, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    if (convolve_kernels_make(&run->kernels, a, run->how->one_kernel ? 1 : 3, run->plan->fine,
                              run->ffts, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    /* NOLINTNEXTLINE(clang-analyzer-unix.Malloc): finish_patch frees it all */
    return sort_rows(run, patch, error);
}

static void finish_patch(struct run *run)
{
    for (int i = 0; run->ffts && i < run->threads; i++) {
        fft_plane_finish(&run->ffts[i]);
    }
    free(run->ffts);
    free(run->spectra);
    free(run->sums);
    free(run->in);
    free(run->out);
    run->ffts = NULL;
    run->spectra = NULL;
    run->sums = run->in = run->out = NULL;
    run->out_size = 0;
    convolve_kernels_finish(&run->kernels);
    convolve_rows_finish(&run->samples);
    convolve_rows_finish(&run->receivers);
}

static int convolve_patch(struct run *run, size_t patch, int fine, struct progress *progress,
                          struct nacre_error *error)
{
    const struct convolve *c = run->convolve;
    struct convolve_plan plan;
    convolve_plan(&plan, &c->patches->list[patch], c->mapping, c->appearance, run->how->planes,
                  fine);
    if (!isfinite(plan.points)) {
        return NACRE_OK;
    }
    run->plan = &plan;
    int status = make_patch(run, patch, error);
    for (int i = 0; status == NACRE_OK && i < plan.x.count * plan.y.count; i++) {
        status = convolve_block(run, i % plan.x.count, i / plan.x.count, error);
        if (status == NACRE_OK) {
            status = progress_step(progress, i + 1, plan.x.count * plan.y.count, NULL, error);
        }
    }
    finish_patch(run);
    return status;
}

int convolve_run(const struct convolve *convolve, const struct convolve_light *how, int fine,
                 struct progress *progress, float (*light)[3], struct nacre_error *error)
{
    struct run run = {
        .convolve = convolve, .how = how, .light = light, .threads = omp_get_max_threads()};
    int status = NACRE_OK;
    run.of_sample = malloc((convolve->samples->count + 1) * sizeof *run.of_sample);
    if (!run.of_sample) {
        return nacre_fail_memory(error, "the light in the texture");
    }
    place_samples(&run);
    for (size_t i = 0; status == NACRE_OK && i < convolve->patches->count; i++) {
        if (convolve->patches->list[i].receivers > 0) {
            status = convolve_patch(&run, i, fine, progress, error);
        }
    }
    free(run.of_sample);
    return status;
}
