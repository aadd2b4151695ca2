/* The best kernels for planes: their equations, summed on the device and solved on the host. */
#include "factor/terms_kernels.h"
#include "factor/terms_steps.h"

#include <math.h>
#include <stdlib.h>

int terms_run(struct terms *m, enum terms_kernel name, const void *const *values,
              const size_t *sizes, int count, size_t across, size_t down, size_t deep,
              struct nacre_error *error)
{
    const struct opencl *opencl = m->layouts[0].opencl;
    const size_t items[] = {across, down, deep}, one[] = {1, 1, 1}, *group = &m->layouts[0].group;
    const cl_uint dimensions = deep > 0 ? 3 : down > 0 ? 2 : 1;
    cl_int status = CL_SUCCESS;
    for (int i = 0; i < count && status == CL_SUCCESS; i++) {
        status = clSetKernelArg(m->kernels[name], (cl_uint)i, sizes[i], values[i]);
    }
    if (status == CL_SUCCESS) {
        status = clEnqueueNDRangeKernel(opencl->queue, m->kernels[name], dimensions, NULL, items,
                                        name != TERMS_EXTRAPOLATE ? one : group, 0, NULL, NULL);
    }
    return opencl_check(opencl, status, "cannot run a step of the terms", error);
}

int terms_place_kernels(struct terms *m, int channel, const float *numbers,
                        struct nacre_error *error)
{
    const struct terms_grid *g = &m->data->grid;
    const struct layout *l = &m->layouts[0];
    size_t terms = (size_t)l->sizes.terms, area = (size_t)g->window * (size_t)g->window;
    cl_int status = CL_SUCCESS;
    for (int side = 0; side < m->sides && status == CL_SUCCESS; side++) {
        for (size_t t = 0; t < terms; t++) {
            terms_grid_spread(g, numbers + t * (size_t)g->count, m->window);
            for (size_t i = 0; i < area; i++) {
                m->staged[i * terms + t] = m->window[side == 0 ? i : area - 1 - i];
            }
        }
        status =
            clEnqueueWriteBuffer(l->opencl->queue, m->channels[channel].kernels[side], CL_TRUE, 0,
                                 area * terms * sizeof *m->staged, m->staged, 0, NULL, NULL);
    }
    return opencl_check(l->opencl, status, "cannot write the kernels", error);
}

static int read_floats(struct terms *m, cl_mem from, size_t count, void *to,
                       struct nacre_error *error)
{
    const struct opencl *opencl = m->layouts[0].opencl;
    return opencl_check(opencl,
                        clEnqueueReadBuffer(opencl->queue, from, CL_TRUE, 0, count * sizeof(float),
                                            to, 0, NULL, NULL),
                        "cannot read the kernels' equations", error);
}

/* The part of the kernels' equations that is the same for all channels. */
static int correlate(struct terms *m, cl_mem own, cl_mem other, int most, struct nacre_error *error)
{
    const struct layout_sizes *s = &m->layouts[0].sizes;
    size_t lanes = (size_t)m->data->copies[0].lanes, window = (size_t)s->window;
    size_t side = 2 * (size_t)most + 1;
    cl_int pairs = s->terms * (s->terms + 1) / 2;
    int status = NACRE_OK;
    for (cl_int first = 0; first < pairs && status == NACRE_OK; first += TERMS_PRODUCTS) {
        size_t count = (size_t)(pairs - first < TERMS_PRODUCTS ? pairs - first : TERMS_PRODUCTS);
        const void *products[] = {
            &own, &other, &m->weights, &m->equations.weighted, &m->equations.plain, &first, s};
        const void *sums[] = {&m->equations.weighted,
                              &m->equations.plain,
                              &m->equations.correlations,
                              &first,
                              &most,
                              s};
        const size_t sizes[] = {sizeof(cl_mem), sizeof(cl_mem), sizeof(cl_mem), sizeof(cl_mem),
                                sizeof(cl_mem), sizeof first,   sizeof *s};
        const size_t sums_sizes[] = {sizeof(cl_mem), sizeof(cl_mem), sizeof(cl_mem),
                                     sizeof first,   sizeof most,    sizeof *s};
        status = terms_run(m, TERMS_MULTIPLY, products, sizes, 7, (size_t)s->stride / lanes,
                           (size_t)s->height, count, error);
        if (status == NACRE_OK) {
            status = terms_run(m, TERMS_CORRELATE, sums, sums_sizes, 6,
                               (side + TERMS_ACROSS - 1) / TERMS_ACROSS,
                               (side + TERMS_DOWN - 1) / TERMS_DOWN, count, error);
        }
    }
    return status == NACRE_OK ? read_floats(m, m->equations.correlations,
                                            (size_t)pairs * window * window, m->correlations, error)
                              : status;
}

/* The channel's own part: right sides, and what was not measured. */
static int find_sides(struct terms *m, int channel, cl_mem own, cl_mem other, cl_int top, int most,
                      struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    const struct layout_sizes *s = &l->sizes;
    const cl_int left = s->window / 2 - most;
    size_t window = (size_t)s->window, side = 2 * (size_t)most + 1;
    size_t rows = window / 2 + (size_t)most + 1 - (size_t)top;
    size_t terms = (size_t)s->terms, pairs = terms * (terms + 1) / 2;
    cl_mem far = m->sides == 2 ? m->nothing : m->weights;
    cl_mem mask = l->channels[channel].mask;
    const void *sides[] = {&l->channels[channel].responses,
                           &mask,
                           &own,
                           &other,
                           &m->weights,
                           &far,
                           &m->equations.sides,
                           &top,
                           &most,
                           s};
    const void *lacks[] = {
        &mask, &own,  &other, &m->weights, &far, &m->equations.lacks, &m->equations.measured,
        &top,  &left, s};
    const size_t sizes[] = {sizeof(cl_mem), sizeof(cl_mem), sizeof(cl_mem), sizeof(cl_mem),
                            sizeof(cl_mem), sizeof(cl_mem), sizeof(cl_mem), sizeof top,
                            sizeof most,    sizeof *s};
    int status = terms_run(m, TERMS_SIDES, sides, sizes, 10, rows, 0, 0, error);
    if (status == NACRE_OK) {
        status = read_floats(m, m->equations.sides, window * window * terms, m->right, error);
    }
    if (status == NACRE_OK && m->lacks) {
        status = terms_run(m, TERMS_LACK, lacks, sizes, 10, side, rows, 0, error);
    }
    if (status == NACRE_OK && m->lacks) {
        status = read_floats(m, m->equations.lacks, window * window * pairs, m->lacks, error);
    }
    return status == NACRE_OK && m->lacks
               ? read_floats(m, m->equations.measured, window * window, m->measured, error)
               : status;
}

/* One channel's equations from what was read. Where both ends weigh, each distance is met forth and back. */
static void assemble_equations(struct terms *m, int channel, int top, int most)
{
    const struct terms_data *d = m->data;
    size_t window = (size_t)d->grid.window, area = window * window;
    size_t terms = (size_t)m->layouts[0].sizes.terms, pairs = terms * (terms + 1) / 2;
    for (size_t i = (size_t)top * window; i < area; i++) {
        if (abs((int)(i % window) - (int)window / 2) > most ||
            abs((int)(i / window) - (int)window / 2) > most) {
            continue;
        }
        float *to = m->sums + i * m->equation_size;
        double scale = (double)d->scales[channel][i];
        for (size_t pair = 0; pair < pairs; pair++) {
            const float *of_pair = m->correlations + pair * area;
            double sum = (double)of_pair[i];
            sum += m->sides == 1 ? (double)of_pair[area - 1 - i] : 0;
            if (m->lacks) {
                double lack = (double)m->lacks[i * pairs + pair];
                sum = m->measured[i] ? lack : fmax(0, sum - lack);
            }
            to[pair] = (float)(scale * sum);
        }
        for (size_t t = 0; t < terms; t++) {
            to[pairs + t] = (float)(scale * (double)m->right[i * terms + t]);
        }
    }
}

int terms_find_kernels(struct terms *m, const struct terms_set *set, int most,
                       struct nacre_error *error)
{
    const struct terms_grid *g = &m->data->grid;
    cl_mem own = set->tracks[0].next, other = set->tracks[m->sides - 1].next;
    const cl_int top = m->sides == 2 ? 0 : g->window / 2;
    int status = correlate(m, own, other, most, error);
    for (int c = set->first; c < set->first + set->count && status == NACRE_OK; c++) {
        status = find_sides(m, c, own, other, top, most, error);
        if (status == NACRE_OK) {
            assemble_equations(m, c, top, most);
            status = terms_kernels_solve(g, m->layouts[0].sizes.terms, m->sides == 1, most, m->sums,
                                         m->channels[c].next, error);
        }
        if (status == NACRE_OK) {
            status = terms_place_kernels(m, c, m->channels[c].next, error);
        }
    }
    return status;
}
