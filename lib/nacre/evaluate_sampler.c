/* Sampling a material with a kernel per term by tables of its kernels. */
#include "nacre/evaluate.h"

#include <stdbool.h>
#include <stdlib.h>

/* The lobes of a point are its terms and its centre. Of lobe t are chosen F(x_i, t) S m, with S the sum of g_t and m the mean of
 * H(t, .): that does not depend on how a term's scale is spread over F, g and H. */
struct nacre_sampler {
    const struct nacre_material *material;
    double *masses;  /* [terms][channels]: S m */
    double *h_means; /* [terms][channels]: m */
    double *
        cumulative; /* [terms][channels][K][K]: sums of g_t up to and with an entry, the last is 1; all 0 without any */
};

static size_t table_of(const struct nacre_material *m, int term, int channel)
{
    return (size_t)term * (size_t)m->channels + (size_t)channel;
}

/* F (or H) of a term and channel: a plane. */
static const float *plane_of(const struct nacre_material *m, const float *factor, int term,
                             int channel)
{
    size_t plane = (size_t)m->width * (size_t)m->height;
    size_t shared = m->factor_channels == 1 ? 0 : (size_t)channel;
    return factor + ((size_t)term * (size_t)m->factor_channels + shared) * plane;
}

static const float *h_of(const struct nacre_material *m, int term, int channel)
{
    return plane_of(m, m->h ? m->h : m->f, term, channel);
}

static void fill_table(struct nacre_sampler *s, int term, int channel)
{
    const struct nacre_material *m = s->material;
    size_t area = (size_t)m->window * (size_t)m->window;
    size_t points = (size_t)m->width * (size_t)m->height, table = table_of(m, term, channel);
    const float *kernel = m->kernels + table * area, *h = h_of(m, term, channel);
    double *cumulative = s->cumulative + table * area, sum = 0, mean = 0;
    for (size_t i = 0; i < area; i++) {
        sum += (double)kernel[i];
        cumulative[i] = sum;
    }
    for (size_t i = 0; i < area && sum > 0; i++) {
        cumulative[i] /= sum;
    }
    for (size_t i = 0; i < points; i++) {
        mean += (double)h[i] / (double)points;
    }
    s->h_means[table] = mean;
    s->masses[table] = sum * mean;
}

int nacre_sampler_new(const struct nacre_material *m, struct nacre_sampler **sampler,
                      struct nacre_error *error)
{
    if (m->layout != NACRE_KERNEL_PER_TERM) {
        *sampler = NULL;
        return nacre_fail(error,
                          "a material whose kernels do not belong to terms cannot be sampled "
                          "by tables; use nacre_material_sample");
    }
    size_t tables = (size_t)m->terms * (size_t)m->channels;
    size_t area = (size_t)m->window * (size_t)m->window;
    struct nacre_sampler *s = *sampler = calloc(1, sizeof *s);
    if (!s) {
        return nacre_fail_memory(error, "the kernels' tables");
    }
    s->material = m;
    s->masses = calloc(tables, sizeof *s->masses);
    s->h_means = calloc(tables, sizeof *s->h_means);
    s->cumulative = calloc(tables * area, sizeof *s->cumulative);
    if (!s->masses || !s->h_means || !s->cumulative) {
        nacre_sampler_free(s);
        *sampler = NULL;
        return nacre_fail_memory(error, "the kernels' tables");
    }
    for (int t = 0; t < m->terms; t++) {
        for (int c = 0; c < m->channels; c++) {
            fill_table(s, t, c);
        }
    }
    return NACRE_OK;
}

void nacre_sampler_free(struct nacre_sampler *s)
{
    if (!s) {
        return;
    }
    free(s->masses);
    free(s->h_means);
    free(s->cumulative);
    free(s);
}

/* What is chosen of a lobe at x_i; the lobe behind the terms is the centre. */
static double share_of(const struct nacre_sampler *s, int lobe, int channel, size_t point)
{
    const struct nacre_material *m = s->material;
    if (lobe < m->terms) {
        return (double)plane_of(m, m->f, lobe, channel)[point] *
               s->masses[table_of(m, lobe, channel)];
    }
    size_t plane = (size_t)m->width * (size_t)m->height;
    return m->centre ? (double)m->centre[(size_t)channel * plane + point] : 0;
}

static double total_of(const struct nacre_sampler *s, int channel, size_t point)
{
    double total = 0;
    for (int lobe = 0; lobe <= s->material->terms; lobe++) {
        total += share_of(s, lobe, channel, point);
    }
    return total;
}

/* The lobe in which `target` of the total lies; the last that has a share where rounding puts it beyond. */
static int choose_lobe(const struct nacre_sampler *s, int channel, size_t point, double target)
{
    int chosen = 0;
    double before = 0;
    for (int lobe = 0; lobe <= s->material->terms; lobe++) {
        double share = share_of(s, lobe, channel, point);
        if (share > 0) {
            chosen = lobe;
            before += share;
            if (before > target) {
                break;
            }
        }
    }
    return chosen;
}

/* The first entry whose sum is above u, which is below 1, the last sum: so the entry is not 0. */
static size_t choose_entry(const double *cumulative, size_t area, double u)
{
    size_t low = 0, high = area - 1;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (cumulative[middle] > u) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return low;
}

float nacre_sampler_draw(const struct nacre_sampler *s, int channel, int xi, int yi,
                         const float u[2], int *xo, int *yo)
{
    const struct nacre_material *m = s->material;
    size_t point = (size_t)yi * (size_t)m->width + (size_t)xi;
    size_t area = (size_t)m->window * (size_t)m->window;
    double total = total_of(s, channel, point);
    *xo = xi;
    *yo = yi;
    if (!(total > 0)) {
        return 0;
    }
    int lobe = choose_lobe(s, channel, point, (double)u[0] * total);
    if (lobe == m->terms) {
        return (float)total;
    }
    size_t table = table_of(m, lobe, channel);
    size_t entry = choose_entry(s->cumulative + table * area, area, (double)u[1]);
    *xo += (int)(entry % (size_t)m->window) - m->window / 2;
    *yo += (int)(entry / (size_t)m->window) - m->window / 2;
    if (*xo < 0 || *yo < 0 || *xo >= m->width || *yo >= m->height) {
        return 0;
    }
    size_t out = (size_t)*yo * (size_t)m->width + (size_t)*xo;
    return (float)(total * (double)h_of(m, lobe, channel)[out] / s->h_means[table]);
}

float nacre_sampler_probability(const struct nacre_sampler *s, int channel, int xi, int yi, int xo,
                                int yo)
{
    const struct nacre_material *m = s->material;
    size_t point = (size_t)yi * (size_t)m->width + (size_t)xi;
    size_t area = (size_t)m->window * (size_t)m->window;
    long u = (long)xo - xi + m->window / 2, v = (long)yo - yi + m->window / 2;
    double total = total_of(s, channel, point), sum = 0;
    if (u < 0 || v < 0 || u >= m->window || v >= m->window || !(total > 0)) {
        return 0;
    }
    size_t entry = (size_t)v * (size_t)m->window + (size_t)u;
    for (int t = 0; t < m->terms; t++) {
        size_t table = table_of(m, t, channel);
        sum += (double)plane_of(m, m->f, t, channel)[point] * s->h_means[table] *
               (double)m->kernels[table * area + entry];
    }
    sum += xo == xi && yo == yi ? share_of(s, m->terms, channel, point) : 0;
    return (float)(sum / total);
}
