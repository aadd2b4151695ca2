/* Evaluating and sampling R_d of a material. */
#include "nacre/evaluate.h"

#include <string.h>

/* One response, ready to be asked for its rows: what does not change from entry to entry. */
struct response {
    const struct nacre_material *material;
    int channel, x, y;
    const float *f, *h; /* of term 0 in this channel */
    size_t plane, term; /* floats of a plane, and from one term to the next */
    size_t point;       /* index of x_i in a plane */
    int radius;
};

static struct response begin(const struct nacre_material *material, int channel, int x, int y)
{
    size_t plane = (size_t)material->width * (size_t)material->height;
    size_t offset = material->factor_channels == 1 ? 0 : (size_t)channel * plane;
    return (struct response){
        .material = material,
        .channel = channel,
        .x = x,
        .y = y,
        .f = material->f + offset,
        .h = (material->h ? material->h : material->f) + offset,
        .plane = plane,
        .term = (size_t)material->factor_channels * plane,
        .point = (size_t)y * (size_t)material->width + (size_t)x,
        .radius = (material->window - 1) / 2,
    };
}

/* Kernel j at entry (u, v). */
static float kernel(const struct response *r, int j, int u, int v)
{
    const struct nacre_material *m = r->material;
    size_t window = (size_t)m->window;
    return m
        ->kernels[(((size_t)j * (size_t)m->channels + (size_t)r->channel) * window + (size_t)v) *
                      window +
                  (size_t)u];
}

/* G(x_i, x_o) of the layouts that have it outside the sum. */
static float mixed_kernel(const struct response *r, int u, int v, size_t point_o)
{
    const struct nacre_material *m = r->material;
    float g = 0;
    for (int a = 0; a < m->mixed; a++) {
        int id = (int)m->ids[(size_t)a * r->plane + r->point];
        float weight = m->weights[(size_t)a * r->plane + r->point];
        if (weight == 0) {
            continue;
        }
        if (m->layout == NACRE_KERNEL_SINGLE) {
            g += weight * kernel(r, id, u, v);
            continue;
        }
        for (int b = 0; b < m->mixed; b++) {
            int other = (int)m->ids[(size_t)b * r->plane + point_o];
            float share = m->weights[(size_t)b * r->plane + point_o];
            g += weight * share * kernel(r, id * m->clusters + other, u, v);
        }
    }
    return g;
}

/* Entry (u, v) of the response; 0 outside the sample. */
static float entry(const struct response *r, int u, int v)
{
    const struct nacre_material *m = r->material;
    int xo = r->x + u - r->radius;
    int yo = r->y + v - r->radius;
    if (xo < 0 || yo < 0 || xo >= m->width || yo >= m->height) {
        return 0;
    }
    size_t point_o = (size_t)yo * (size_t)m->width + (size_t)xo;
    bool per_term = m->layout == NACRE_KERNEL_PER_TERM;
    float sum = 0;
    for (int t = 0; t < m->terms; t++) {
        float product = r->f[(size_t)t * r->term + r->point] * r->h[(size_t)t * r->term + point_o];
        sum += per_term ? product * kernel(r, t, u, v) : product;
    }
    if (!per_term) {
        sum *= mixed_kernel(r, u, v, point_o);
    }
    if (m->centre && u == r->radius && v == r->radius) {
        sum += m->centre[(size_t)r->channel * r->plane + r->point];
    }
    return sum;
}

static double row_sum(const struct response *r, int v)
{
    double sum = 0;
    for (int u = 0; u < r->material->window; u++) {
        sum += (double)entry(r, u, v);
    }
    return sum;
}

float nacre_material_evaluate(const struct nacre_material *material, int channel, int xi, int yi,
                              int xo, int yo)
{
    struct response r = begin(material, channel, xi, yi);
    long u = (long)xo - xi + r.radius;
    long v = (long)yo - yi + r.radius;
    if (u < 0 || v < 0 || u >= material->window || v >= material->window) {
        return 0;
    }
    return entry(&r, (int)u, (int)v);
}

/* Row v of the sum over the terms, each with its kernel if it has one: entries [first, end) of a row of zeros. */
static void add_terms(const struct response *r, int v, int first, int end, float *row)
{
    const struct nacre_material *m = r->material;
    ptrdiff_t start = (ptrdiff_t)(r->y + v - r->radius) * m->width + r->x - r->radius;
    for (int t = 0; t < m->terms; t++) {
        float f = r->f[(size_t)t * r->term + r->point];
        const float *h = r->h + (ptrdiff_t)((size_t)t * r->term) + start;
        if (m->layout == NACRE_KERNEL_PER_TERM) {
            for (int u = first; u < end; u++) {
                row[u] += f * h[u] * kernel(r, t, u, v);
            }
        } else if (t + 1 < m->terms) { /* two at a time, in the same order */
            float next = r->f[(size_t)++t * r->term + r->point];
            const float *other = h + r->term;
#pragma omp simd
            for (int u = first; u < end; u++) {
                row[u] = row[u] + f * h[u] + next * other[u];
            }
        } else {
#pragma omp simd
            for (int u = first; u < end; u++) {
                row[u] += f * h[u];
            }
        }
    }
}

/* Multiply row v by G(x_i, x_o) of the layouts that have it outside the sum. */
static void multiply_kernels(const struct response *r, int v, int first, int end, float *row)
{
    const struct nacre_material *m = r->material;
    if (m->layout == NACRE_KERNEL_SINGLE && m->mixed == 1) {
        float weight = m->weights[r->point];
        size_t at = (size_t)m->ids[r->point] * (size_t)m->channels + (size_t)r->channel;
        const float *g = m->kernels + (at * (size_t)m->window + (size_t)v) * (size_t)m->window;
#pragma omp simd
        for (int u = first; u < end; u++) {
            row[u] *= weight * g[u];
        }
        return;
    }
    for (int u = first; u < end; u++) {
        row[u] *= mixed_kernel(r, u, v,
                               (size_t)(r->y + v - r->radius) * (size_t)m->width +
                                   (size_t)(r->x + u - r->radius));
    }
}

/* Row v of the response: entry() of each, a row at a time, which is many times faster. */
static void fill_row(const struct response *r, int v, float *row)
{
    const struct nacre_material *m = r->material;
    int yo = r->y + v - r->radius;
    int first = r->x < r->radius ? r->radius - r->x : 0;
    int end = r->x + r->radius >= m->width ? m->width - r->x + r->radius : m->window;
    memset(row, 0, (size_t)m->window * sizeof *row);
    if (yo < 0 || yo >= m->height) {
        return;
    }
    add_terms(r, v, first, end, row);
    if (m->layout != NACRE_KERNEL_PER_TERM) {
        multiply_kernels(r, v, first, end, row);
    }
    if (m->centre && v == r->radius) {
        row[r->radius] += m->centre[(size_t)r->channel * r->plane + r->point];
    }
}

void nacre_material_response(const struct nacre_material *material, int x, int y, float *response)
{
    for (int c = 0; c < material->channels; c++) {
        struct response r = begin(material, c, x, y);
        for (int v = 0; v < material->window; v++) {
            fill_row(&r, v, response);
            response += material->window;
        }
    }
}

/* Choosing walks through the response three times rather than keep a table: it needs no memory, and
 * so cannot fail. */
float nacre_material_sample(const struct nacre_material *material, int channel, int xi, int yi,
                            const float u[2], int *xo, int *yo, float *probability)
{
    struct response r = begin(material, channel, xi, yi);
    double total = 0;
    *xo = xi;
    *yo = yi;
    *probability = 0;
    for (int v = 0; v < material->window; v++) {
        total += row_sum(&r, v);
    }
    if (!(total > 0)) {
        return 0;
    }
    double target = (double)u[0] * total;
    double before = 0;
    double row = 0;
    int chosen_row = -1;
    for (int v = 0; v < material->window; v++) {
        double sum = row_sum(&r, v);
        if (sum > 0) {
            chosen_row = v;
            row = sum;
            if (before + sum > target) {
                break;
            }
        }
        before += sum;
    }
    float chosen = 0;
    before = 0;
    for (int column = 0; column < material->window; column++) {
        float value = entry(&r, column, chosen_row);
        if (value > 0) {
            chosen = value;
            *xo = xi + column - r.radius;
            *yo = yi + chosen_row - r.radius;
            if (before + (double)value > (double)u[1] * row) {
                break;
            }
        }
        before += (double)value;
    }
    *probability = (float)((double)chosen / total);
    return (float)total;
}
