/* Weighted non-negative matrix factorization with dense matrices. */
#include "dense.h"

#include <stdlib.h>

/* c[rows][columns] = a[rows][inner] b[inner][columns]. */
static double *multiply(const double *a, const double *b, size_t rows, size_t inner, size_t columns)
{
    double *c = calloc(rows * columns, sizeof *c);
    for (size_t i = 0; i < rows; i++) {
        for (size_t k = 0; k < inner; k++) {
            for (size_t j = 0; j < columns; j++) {
                c[i * columns + j] += a[i * inner + k] * b[k * columns + j];
            }
        }
    }
    return c;
}

static double *transpose(const double *a, size_t rows, size_t columns)
{
    double *t = calloc(rows * columns, sizeof *t);
    for (size_t i = 0; i < rows * columns; i++) {
        t[i % columns * rows + i / columns] = a[i];
    }
    return t;
}

/* W^2 * G * R and W^2 * G * ((F H) * G). */
static void weigh(const struct dense *d, double **data, double **model)
{
    size_t count = d->points * d->points;
    double *product = multiply(d->f, d->h, d->points, d->terms, d->points);
    *data = malloc(count * sizeof **data);
    *model = malloc(count * sizeof **model);
    for (size_t i = 0; i < count; i++) {
        double w2 = d->w[i] * d->w[i];
        (*data)[i] = w2 > 0 ? w2 * d->g[i] * d->r[i] : 0;
        (*model)[i] = w2 * d->g[i] * (product[i] * d->g[i]);
    }
    free(product);
}

static void apply(double *factor, const double *numerator, const double *denominator, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        factor[i] = denominator[i] > 0 ? factor[i] * numerator[i] / denominator[i] : 0;
    }
}

void dense_update_f(struct dense *d)
{
    double *data = NULL, *model = NULL;
    weigh(d, &data, &model);
    double *ht = transpose(d->h, d->terms, d->points);
    double *numerator = multiply(data, ht, d->points, d->points, d->terms);
    double *denominator = multiply(model, ht, d->points, d->points, d->terms);
    apply(d->f, numerator, denominator, d->points * d->terms);
    free(data);
    free(model);
    free(ht);
    free(numerator);
    free(denominator);
}

void dense_update_h(struct dense *d)
{
    double *data = NULL, *model = NULL;
    weigh(d, &data, &model);
    double *ft = transpose(d->f, d->points, d->terms);
    double *numerator = multiply(ft, data, d->terms, d->points, d->points);
    double *denominator = multiply(ft, model, d->terms, d->points, d->points);
    apply(d->h, numerator, denominator, d->terms * d->points);
    free(data);
    free(model);
    free(ft);
    free(numerator);
    free(denominator);
}
