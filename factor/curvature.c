/* The weights between cells of points, and the launches that gather the far part of normal matrices. */
#include "factor/curvature.h"

#include <stdlib.h>
#include <string.h>

static int round_up(int value, int unit)
{
    return (value + unit - 1) / unit * unit;
}

static struct cells set_cells(const struct responses *r)
{
    int reach = (r->window / 2 + CURVATURE_CELL - 1) / CURVATURE_CELL;
    struct cells c = {.columns = (r->width + CURVATURE_CELL - 1) / CURVATURE_CELL,
                      .rows = (r->height + CURVATURE_CELL - 1) / CURVATURE_CELL,
                      .reach = reach};
    c.blocks = (c.columns + r->lanes - 1) / r->lanes;
    c.pad = round_up(reach, r->lanes);
    c.stride = c.blocks * r->lanes + 2 * c.pad;
    c.wide = c.blocks * r->lanes * CURVATURE_CELL;
    return c;
}

static size_t weight_floats(const struct cells *c)
{
    size_t side = 2 * (size_t)c->reach + 1;
    return (size_t)c->rows * side * side * (size_t)c->stride;
}

double curvature_bytes(const struct problem *problem, int near, int pairs)
{
    const struct responses *r = problem->responses;
    struct cells c = set_cells(r);
    if (near >= r->window / 2) {
        return 0;
    }
    return sizeof(float) * ((double)r->channels * (double)weight_floats(&c) +
                            (double)c.rows * pairs * ((double)c.stride + 2.0 * c.wide));
}

/* Sums of one kernel over the points of each cell that a point reaches, near entries left out: for each place of the
 * point in its own cell, [CELL][CELL][offset y][offset x]. */
static void add_templates(const float *kernel, int window, int near, int reach, double *sums)
{
    int half = window / 2, side = 2 * reach + 1;
    for (int place = 0; place < CURVATURE_CELL * CURVATURE_CELL; place++) {
        double *to = sums + (size_t)place * (size_t)side * (size_t)side;
        int from_y = place / CURVATURE_CELL + reach * CURVATURE_CELL;
        int from_x = place % CURVATURE_CELL + reach * CURVATURE_CELL;
        for (int dy = -half; dy <= half; dy++) {
            for (int dx = -half; dx <= half; dx++) {
                if (abs(dy) > near || abs(dx) > near) {
                    to[(from_y + dy) / CURVATURE_CELL * side + (from_x + dx) / CURVATURE_CELL] +=
                        (double)kernel[(dy + half) * window + dx + half];
                }
            }
        }
    }
}

/* Points in the order of their clusters: `first` [clusters + 1] tells where each cluster's begin in `points`. */
static void sort_points(const struct problem *p, size_t count, size_t *first, size_t *points)
{
    for (size_t i = 0; i < count; i++) {
        first[p->ids[i] + 1]++;
    }
    for (size_t k = 0; k < (size_t)p->clusters; k++) {
        first[k + 1] += first[k];
    }
    for (size_t i = count; i-- > 0;) {
        points[--first[p->ids[i] + 1]] = i;
    }
    for (size_t k = 0; k < (size_t)p->clusters; k++) { /* each entry has become the one before it */
        first[k] = first[k + 1];
    }
    first[p->clusters] = count;
}

/* How many points the cell of a point has. */
static int points_near(const struct responses *r, int x, int y)
{
    int right = r->width - x / CURVATURE_CELL * CURVATURE_CELL;
    int below = r->height - y / CURVATURE_CELL * CURVATURE_CELL;
    return (right < CURVATURE_CELL ? right : CURVATURE_CELL) *
           (below < CURVATURE_CELL ? below : CURVATURE_CELL);
}

/* W(cell of the point, .) += the point's part times `scale`: [offset y][offset x][stride]. */
static void add_point(const struct curvature *v, size_t point, const double *templates,
                      double scale, float *weights)
{
    const struct responses *r = v->layout->problem->responses;
    const struct cells *c = &v->cells;
    const size_t side = 2 * (size_t)c->reach + 1, area = side * side;
    int x = (int)(point % (size_t)r->width), y = (int)(point / (size_t)r->width);
    int cell_x = x / CURVATURE_CELL, cell_y = y / CURVATURE_CELL;
    int pairs = points_near(r, x, y) * CURVATURE_CELL * CURVATURE_CELL;
    int place = y % CURVATURE_CELL * CURVATURE_CELL + x % CURVATURE_CELL;
    const double *from = templates + (size_t)place * area;
    float *to = weights + (size_t)cell_y * area * (size_t)c->stride + c->pad + cell_x;
    for (size_t i = 0; i < area; i++) {
        to[i * (size_t)c->stride] += (float)(from[i] * scale / pairs);
    }
}

/* The far part of a kernel in all. */
static double mass_of(const double *templates, size_t area)
{
    double sum = 0;
    for (size_t i = 0; i < area; i++) {
        sum += templates[i];
    }
    return sum;
}

/* W of a channel, [row][offset y][offset x][stride], and masses[height][blocks * lanes]. Points that were not measured
 * count in W as others do: their F is 0, and so is what they would add in H's step. */
static int weigh(const struct curvature *v, int channel, float *weights, float *masses,
                 struct nacre_error *error)
{
    const struct problem *p = v->layout->problem;
    const struct responses *r = p->responses;
    const size_t side = 2 * (size_t)v->cells.reach + 1;
    const size_t count = (size_t)r->width * (size_t)r->height;
    const size_t area = (size_t)r->window * (size_t)r->window;
    const size_t wide = (size_t)r->blocks * (size_t)r->lanes;
    const size_t sums = CURVATURE_CELL * CURVATURE_CELL * side * side;
    size_t *first = calloc((size_t)p->clusters + 1, sizeof *first);
    size_t *points = malloc(count * sizeof *points);
    double *templates = malloc(sums * sizeof *templates);
    int status = NACRE_OK;
    if (!first || !points || !templates) {
        status = nacre_fail_memory(error, "the cells");
        goto out;
    }
    sort_points(p, count, first, points);
    for (size_t k = 0; k < (size_t)p->clusters; k++) {
        const float *kernel = p->kernels + (k * (size_t)r->channels + (size_t)channel) * area;
        memset(templates, 0, sums * sizeof *templates);
        add_templates(kernel, r->window, v->near, v->cells.reach, templates);
        double mass = mass_of(templates, side * side);
        for (size_t i = first[k]; i < first[k + 1] && mass > 0; i++) {
            size_t point = points[i];
            masses[point / (size_t)r->width * wide + point % (size_t)r->width] = (float)mass;
            add_point(v, point, templates, 1 / mass, weights);
        }
    }
out:
    free(first);
    free(points);
    free(templates);
    return status;
}

static int place_weights(struct curvature *v, int channel, struct nacre_error *error)
{
    const struct responses *r = v->layout->problem->responses;
    size_t count = weight_floats(&v->cells);
    size_t points = (size_t)r->height * (size_t)r->blocks * (size_t)r->lanes;
    float *weights = calloc(count, sizeof *weights), *masses = calloc(points, sizeof *masses);
    int status = weights && masses ? weigh(v, channel, weights, masses, error)
                                   : nacre_fail_memory(error, "the cells' weights");
    if (status == NACRE_OK) {
        status = layout_make_buffer(v->layout, count * sizeof *weights, weights, false,
                                    &v->channels[channel].weights, error);
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(v->layout, points * sizeof *masses, masses, false,
                                    &v->channels[channel].masses, error);
    }
    free(weights);
    free(masses);
    return status;
}

static int make_kernel(const struct layout *layout, cl_program program, const char *name,
                       cl_kernel *kernel, struct nacre_error *error)
{
    cl_int status = CL_SUCCESS;
    *kernel = clCreateKernel(program, name, &status);
    return opencl_check(layout->opencl, status, name, error);
}

int curvature_begin(struct curvature *v, const struct layout *layout, cl_program program, int near,
                    int tile, int pairs, struct nacre_error *error)
{
    *v = (struct curvature){.layout = layout,
                            .cells = set_cells(layout->problem->responses),
                            .near = near,
                            .tile = tile,
                            .pairs = pairs};
    const struct cells *c = &v->cells;
    size_t matrices = (size_t)c->rows * (size_t)pairs;
    int status = make_kernel(layout, program, "pool", &v->pool, error);
    if (status == NACRE_OK) {
        status = make_kernel(layout, program, "gather_far", &v->gather, error);
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(layout, matrices * (size_t)c->stride * sizeof(float), NULL,
                                    false, &v->pooled, error);
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(layout,
                                    matrices * (size_t)c->blocks *
                                        (size_t)layout->problem->responses->lanes * sizeof(float),
                                    NULL, false, &v->gathered, error);
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(layout, matrices * (size_t)c->wide * sizeof(float), NULL, false,
                                    &v->far, error);
    }
    for (int i = 0; i < layout->problem->responses->channels && status == NACRE_OK; i++) {
        status = place_weights(v, i, error);
    }
    return status;
}

void curvature_finish(struct curvature *v)
{
    for (int i = 0; i < RESPONSES_CHANNELS; i++) {
        layout_release(v->channels[i].weights);
        layout_release(v->channels[i].masses);
    }
    layout_release(v->pooled);
    layout_release(v->gathered);
    layout_release(v->far);
    if (v->pool) {
        (void)clReleaseKernel(v->pool);
    }
    if (v->gather) {
        (void)clReleaseKernel(v->gather);
    }
    *v = (struct curvature){0};
}

/* Sums of products over cells, of one factor. */
static cl_int pool(struct curvature *v, int channel, cl_mem factor, cl_int outgoing)
{
    const size_t items[] = {(size_t)v->cells.rows, (size_t)(v->pairs / (v->tile * v->tile))},
                 one[] = {1, 1};
    const cl_mem buffers[] = {factor, v->channels[channel].masses, v->pooled};
    cl_int status = CL_SUCCESS;
    for (cl_uint i = 0; i < 3 && status == CL_SUCCESS; i++) {
        status = clSetKernelArg(v->pool, i, sizeof(cl_mem), &buffers[i]);
    }
    status = status ? status : clSetKernelArg(v->pool, 3, sizeof outgoing, &outgoing);
    status = status ? status : clSetKernelArg(v->pool, 4, sizeof v->cells, &v->cells);
    status =
        status ? status : clSetKernelArg(v->pool, 5, sizeof v->layout->sizes, &v->layout->sizes);
    return status ? status
                  : clEnqueueNDRangeKernel(v->layout->opencl->queue, v->pool, 2, NULL, items, one,
                                           0, NULL, NULL);
}

static cl_int gather(struct curvature *v, int channel, cl_int outgoing)
{
    const size_t items[] = {(size_t)v->cells.rows, (size_t)(v->pairs / (v->tile * v->tile))},
                 one[] = {1, 1};
    const cl_mem buffers[] = {v->channels[channel].weights, v->pooled, v->gathered, v->far};
    cl_int status = CL_SUCCESS;
    for (cl_uint i = 0; i < 4 && status == CL_SUCCESS; i++) {
        status = clSetKernelArg(v->gather, i, sizeof(cl_mem), &buffers[i]);
    }
    status = status ? status : clSetKernelArg(v->gather, 4, sizeof outgoing, &outgoing);
    status = status ? status : clSetKernelArg(v->gather, 5, sizeof v->cells, &v->cells);
    return status ? status
                  : clEnqueueNDRangeKernel(v->layout->opencl->queue, v->gather, 2, NULL, items, one,
                                           0, NULL, NULL);
}

int curvature_gather(struct curvature *v, int channel, cl_mem factor, bool outgoing,
                     struct nacre_error *error)
{
    cl_int status = pool(v, channel, factor, outgoing);
    if (status == CL_SUCCESS) {
        status = gather(v, channel, outgoing);
    }
    return opencl_check(v->layout->opencl, status, "cannot gather the normal matrices", error);
}
