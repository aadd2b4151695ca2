/* One of the paper's updates in double precision, point by point. */
#include "exact.h"

enum { TERMS = 256 };

/* Sums of one point over the entries that light takes from it (or, for H, to it). */
static void update_point(const struct case_problem *made, const float *windows, bool of_h, int x,
                         int y, double *own, const double *others)
{
    const struct responses *r = &made->responses;
    int half = r->window / 2, sign = of_h ? -1 : 1, terms = made->attempt.problem.terms;
    double numerator[TERMS] = {0}, denominator[TERMS] = {0};
    for (int v = 0; v < r->window; v++) {
        for (int u = 0; u < r->window; u++) {
            int ox = x + sign * (u - half), oy = y + sign * (v - half);
            if (ox < 0 || ox >= r->width || oy < 0 || oy >= r->height) {
                continue;
            }
            int lit_x = of_h ? ox : x, lit_y = of_h ? oy : y;
            size_t lit = (size_t)lit_y * (size_t)r->width + (size_t)lit_x,
                   id = made->attempt.ids[lit];
            size_t area = (size_t)r->window * (size_t)r->window;
            size_t entry = (size_t)v * (size_t)r->window + (size_t)u;
            double g = made->attempt.kernels[id * area + entry];
            double response = windows[lit * area + entry], model = 0;
            const double *other =
                others + ((size_t)oy * (size_t)r->width + (size_t)ox) * (size_t)terms;
            for (int t = 0; t < terms; t++) {
                model += own[t] * other[t] * g;
            }
            for (int t = 0; t < terms; t++) { /* W^2 times g is 1 */
                numerator[t] += response * other[t];
                denominator[t] += model * other[t];
            }
        }
    }
    for (int t = 0; t < terms; t++) {
        own[t] = denominator[t] > 0 ? own[t] * numerator[t] / denominator[t] : 0;
    }
}

void exact_update(const struct case_problem *made, const float *windows, bool of_h, double *f,
                  double *h)
{
    const struct responses *r = &made->responses;
    size_t terms = (size_t)made->attempt.problem.terms;
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < r->height; y++) {
        for (int x = 0; x < r->width; x++) {
            size_t point = (size_t)y * (size_t)r->width + (size_t)x;
            update_point(made, windows, of_h, x, y, (of_h ? h : f) + point * terms, of_h ? f : h);
        }
    }
}
