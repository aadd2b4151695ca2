/* Average or maximum response of each cluster. */
#include "factor/kernels.h"

#include <math.h>
#include <stdlib.h>

/* One row dy of the kernels of one channel being gathered: sum or maximum and count, [clusters + 1][K], the last of all
 * points; and that row of one response. */
struct row {
    double *value;
    size_t *count;
    float *response;
};

static void take(const struct row *row, size_t at, enum kernels_kind kind, double value)
{
    if (kind == KERNELS_AVERAGE) {
        row->value[at] += value;
    } else if (row->count[at] == 0 || value > row->value[at]) {
        row->value[at] = value;
    }
    row->count[at]++;
}

static double result(const struct row *row, size_t at, enum kernels_kind kind)
{
    double value = kind == KERNELS_AVERAGE && row->count[at]
                       ? row->value[at] / (double)row->count[at]
                       : row->value[at];
    return value > 0 ? value : 0; /* averages of noise around 0 may be below it */
}

static void gather_row(const struct responses *r, const uint32_t *ids, int clusters,
                       enum kernels_kind kind, int channel, int v, float *kernels, struct row *row)
{
    size_t window = (size_t)r->window;
    for (int y = 0; y < r->height; y++) {
        for (int x = 0; x < r->width; x++) {
            size_t own = ids[y * r->width + x];
            responses_get_row(r, channel, x, y, v, row->response);
            for (size_t u = 0; u < window; u++) {
                double value = (double)row->response[u];
                if (!isnan(value)) {
                    take(row, own * window + u, kind, value);
                    take(row, (size_t)clusters * window + u, kind, value);
                }
            }
        }
    }
    for (size_t k = 0; k < (size_t)clusters; k++) {
        for (size_t u = 0; u < window; u++) {
            size_t at = k * window + u;
            kernels[((k * (size_t)r->channels + (size_t)channel) * window + (size_t)v) * window +
                    u] = row->count[at] ? (float)result(row, at, kind) : (float)NAN;
        }
    }
}

/* Let all[K][K], the kernel of all points together, stand in where a cluster has no measurement (NaN) or is dark. */
static void complete(const struct responses *r, int clusters, int channel, float *kernels,
                     const float *all)
{
    size_t area = (size_t)r->window * (size_t)r->window;
    float largest_of_all = 0;
    for (size_t i = 0; i < area; i++) {
        largest_of_all = fmaxf(largest_of_all, all[i]);
    }
    for (size_t k = 0; k < (size_t)clusters; k++) {
        float *kernel = kernels + (k * (size_t)r->channels + (size_t)channel) * area;
        float largest = 0;
        for (size_t i = 0; i < area; i++) {
            largest = fmaxf(largest, kernel[i]); /* passes over NaN */
        }
        for (size_t i = 0; i < area; i++) {
            if (largest == 0 || isnan(kernel[i])) {
                kernel[i] = largest_of_all > 0 ? all[i] : 1;
            }
        }
    }
}

static void add_epsilon(float *kernel, size_t area, double epsilon)
{
    float largest = 0;
    for (size_t i = 0; i < area; i++) {
        largest = fmaxf(largest, kernel[i]);
    }
    for (size_t i = 0; i < area; i++) {
        kernel[i] += (float)(epsilon * (double)largest);
    }
}

/* One channel; all[K][K] gets the kernel of all points together. */
static int compute_channel(const struct responses *r, const uint32_t *ids, int clusters,
                           enum kernels_kind kind, int channel, float *kernels, float *all)
{
    size_t window = (size_t)r->window, entries = ((size_t)clusters + 1) * window;
    bool failed = false;
#pragma omp parallel for schedule(dynamic)
    for (int v = 0; v < r->window; v++) {
        struct row row = {.value = calloc(entries, sizeof *row.value),
                          .count = calloc(entries, sizeof *row.count),
                          .response = calloc(window, sizeof *row.response)};
        if (row.value && row.count && row.response) {
            gather_row(r, ids, clusters, kind, channel, v, kernels, &row);
            for (size_t u = 0; u < window; u++) {
                all[(size_t)v * window + u] =
                    (float)result(&row, (size_t)clusters * window + u, kind);
            }
        } else {
#pragma omp critical(factor_kernels)
            failed = true;
        }
        free(row.value);
        free(row.count);
        free(row.response);
    }
    return failed ? NACRE_FAILED : NACRE_OK;
}

int kernels_compute(const struct responses *r, const uint32_t *ids, int clusters,
                    enum kernels_kind kind, double epsilon, float *kernels,
                    struct nacre_error *error)
{
    size_t area = (size_t)r->window * (size_t)r->window;
    float *all = malloc(area * sizeof *all);
    int status = all ? NACRE_OK : NACRE_FAILED;
    for (int c = 0; c < r->channels && status == NACRE_OK; c++) {
        status = compute_channel(r, ids, clusters, kind, c, kernels, all);
        if (status == NACRE_OK) {
            complete(r, clusters, c, kernels, all);
        }
    }
    for (size_t i = 0; i < (size_t)clusters * (size_t)r->channels && status == NACRE_OK; i++) {
        add_epsilon(kernels + i * area, area, epsilon);
    }
    free(all);
    return status == NACRE_OK ? NACRE_OK : nacre_fail_memory(error, "the kernels");
}
