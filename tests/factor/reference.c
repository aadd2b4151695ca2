/* The paper's updates in double precision. */
#include "reference.h"

#include <math.h>
#include <stdlib.h>

static double kernel_at(const struct reference *r, int x, int y, int dx, int dy)
{
    int half = r->window / 2;
    return r->kernels[((size_t)r->ids[y * r->width + x] * (size_t)r->window + (size_t)(dy + half)) *
                          (size_t)r->window +
                      (size_t)(dx + half)];
}

static double response_at(const struct reference *r, int x, int y, int dx, int dy)
{
    int half = r->window / 2;
    return r->responses[(((size_t)y * (size_t)r->width + (size_t)x) * (size_t)r->window +
                         (size_t)(dy + half)) *
                            (size_t)r->window +
                        (size_t)(dx + half)];
}

double reference_model(const struct reference *r, int x, int y, int dx, int dy)
{
    double sum = 0;
    for (int t = 0; t < r->terms; t++) {
        int plane = t * r->height;
        sum += r->f[(plane + y) * r->width + x] * r->h[(plane + y + dy) * r->width + x + dx];
    }
    return sum * kernel_at(r, x, y, dx, dy);
}

/* Call `visit` for each measured pair of points inside the sample. */
static void for_pairs(const struct reference *r,
                      void (*visit)(const struct reference *r, int x, int y, int dx, int dy,
                                    void *data),
                      void *data)
{
    int half = r->window / 2;
    for (int y = 0; y < r->height; y++) {
        for (int x = 0; x < r->width; x++) {
            for (int dy = -half; dy <= half; dy++) {
                for (int dx = -half; dx <= half; dx++) {
                    if (y + dy >= 0 && y + dy < r->height && x + dx >= 0 && x + dx < r->width &&
                        !isnan(response_at(r, x, y, dx, dy))) {
                        visit(r, x, y, dx, dy, data);
                    }
                }
            }
        }
    }
}

struct sums {
    bool of_h;
    double *numerator, *denominator; /* [terms][height][width] */
};

static void add_sums(const struct reference *r, int x, int y, int dx, int dy, void *data)
{
    const struct sums *sums = data;
    double g = kernel_at(r, x, y, dx, dy), weight = 1 / g;
    double response = response_at(r, x, y, dx, dy), model = reference_model(r, x, y, dx, dy);
    for (int t = 0; t < r->terms; t++) {
        int in = (t * r->height + y) * r->width + x;
        int out = (t * r->height + y + dy) * r->width + x + dx;
        double factor = sums->of_h ? r->f[in] : r->h[out];
        int own = sums->of_h ? out : in;
        sums->numerator[own] += weight * g * fmax(response, 0) * factor;
        sums->denominator[own] += weight * g * (model - fmin(response, 0)) * factor;
    }
}

void reference_update(struct reference *reference, bool of_h)
{
    size_t count = (size_t)reference->terms * (size_t)reference->height * (size_t)reference->width;
    double *own = of_h ? reference->h : reference->f;
    struct sums sums = {.of_h = of_h,
                        .numerator = calloc(count, sizeof(double)),
                        .denominator = calloc(count, sizeof(double))};
    for_pairs(reference, add_sums, &sums);
    for (size_t i = 0; i < count; i++) {
        own[i] = sums.denominator[i] > 0 ? own[i] * sums.numerator[i] / sums.denominator[i] : 0;
    }
    free(sums.numerator);
    free(sums.denominator);
}

struct equations {
    bool of_h;
    double *matrix,
        *right; /* of each point: [height][width][terms][terms] and [height][width][terms] */
};

static void add_equations(const struct reference *r, int x, int y, int dx, int dy, void *data)
{
    const struct equations *equations = data;
    size_t terms = (size_t)r->terms, plane = (size_t)r->height * (size_t)r->width;
    size_t in = (size_t)y * (size_t)r->width + (size_t)x;
    size_t out = (size_t)(y + dy) * (size_t)r->width + (size_t)(x + dx);
    size_t own = equations->of_h ? out : in, other = equations->of_h ? in : out;
    const double *factor = equations->of_h ? r->f : r->h;
    double g = kernel_at(r, x, y, dx, dy), response = response_at(r, x, y, dx, dy);
    for (size_t t = 0; t < terms; t++) {
        double left = factor[t * plane + other];
        equations->right[own * terms + t] += response * left;
        for (size_t u = 0; u < terms; u++) {
            equations->matrix[(own * terms + t) * terms + u] +=
                g * left * factor[u * plane + other];
        }
    }
}

void reference_descend(struct reference *reference, bool of_h, int sweeps)
{
    size_t terms = (size_t)reference->terms;
    size_t plane = (size_t)reference->height * (size_t)reference->width;
    double *own = of_h ? reference->h : reference->f;
    struct equations equations = {.of_h = of_h,
                                  .matrix = calloc(plane * terms * terms, sizeof(double)),
                                  .right = calloc(plane * terms, sizeof(double))};
    for_pairs(reference, add_equations, &equations);
    for (size_t i = 0; i < plane; i++) {
        const double *matrix = equations.matrix + i * terms * terms;
        for (size_t step = 0; step < (size_t)sweeps * terms; step++) {
            size_t t = step % terms;
            double rest = equations.right[i * terms + t];
            for (size_t u = 0; u < terms; u++) {
                rest -= u == t ? 0 : matrix[t * terms + u] * own[u * plane + i];
            }
            if (matrix[t * terms + t] > 0) {
                own[t * plane + i] = fmax(0, rest / matrix[t * terms + t]);
            }
        }
    }
    free(equations.matrix);
    free(equations.right);
}

static void add_objective(const struct reference *r, int x, int y, int dx, int dy, void *data)
{
    double difference = response_at(r, x, y, dx, dy) - reference_model(r, x, y, dx, dy);
    *(double *)data += difference * difference / kernel_at(r, x, y, dx, dy) / 2;
}

double reference_objective(const struct reference *reference)
{
    double sum = 0;
    for_pairs(reference, add_objective, &sum);
    return sum;
}
