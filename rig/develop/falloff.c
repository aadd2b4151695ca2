/* The projector's fall-off, told from the camera's vignetting by the reciprocity of the sample. */
#include "rig/develop/falloff.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SIDE = 2 * FALLOFF_REACH + 1, CELLS = SIDE * SIDE };

/* What a coefficient is taken to be like before anything is seen: a projector that loses a third towards the corners is a
 * poor one. Terms of which the pairs say little stay near 0. */
static const double usual_term = 0.3;

int falloff_pairs_init(struct falloff_pairs *pairs, int width, int height,
                       struct nacre_error *error)
{
    size_t count = (size_t)width * (size_t)height * CELLS;
    *pairs = (struct falloff_pairs){width, height, malloc(count * sizeof *pairs->near)};
    if (!pairs->near) {
        return nacre_fail_memory(error, "the search for the projector's fall-off");
    }
    for (size_t i = 0; i < count; i++) {
        pairs->near[i] = NAN;
    }
    return NACRE_OK;
}

void falloff_pairs_finish(struct falloff_pairs *pairs)
{
    if (pairs) {
        free(pairs->near);
        *pairs = (struct falloff_pairs){0};
    }
}

void falloff_pairs_add(struct falloff_pairs *pairs, const struct nacre_scan_info *info, int x,
                       int y, const float *response)
{
    int half = info->window / 2;
    int reach = half < FALLOFF_REACH ? half : FALLOFF_REACH;
    size_t plane = (size_t)info->window * (size_t)info->window;
    float *near = pairs->near + ((size_t)y * (size_t)pairs->width + (size_t)x) * CELLS;
    for (int v = -reach; v <= reach; v++) {
        for (int u = -reach; u <= reach; u++) {
            size_t at = (size_t)(half + v) * (size_t)info->window + (size_t)(half + u);
            float sum = 0;
            for (int c = 0; c < info->channels; c++) {
                sum += response[(size_t)c * plane + at];
            }
            near[(v + FALLOFF_REACH) * SIDE + u + FALLOFF_REACH] = sum;
        }
    }
}

/* x, y, xx, xy, yy, xxx ... in units of half the region's longer side from its middle. */
static void powers(int width, int height, double x, double y, double terms[FALLOFF_TERMS])
{
    double unit = (width > height ? width : height) / 2.0;
    double across = (x + 0.5 - width / 2.0) / unit;
    double down = (y + 0.5 - height / 2.0) / unit;
    int used = 0;
    for (int degree = 1; degree <= 4; degree++) {
        for (int k = 0; k <= degree; k++) {
            terms[used++] = pow(across, degree - k) * pow(down, k);
        }
    }
}

/* Normal equations of the differences d = R'(a, b) - R'(b, a) against their sums s, d = s (log E(a) - log E(b)), with
 * weights 1 / s as shot noise wants them. */
struct equations {
    double normal[FALLOFF_TERMS * FALLOFF_TERMS];
    double right[FALLOFF_TERMS];
    double squares; /* sum of d^2 / s */
    size_t pairs;
};

static void add_pair(const struct falloff_pairs *pairs, int x, int y, int u, int v,
                     struct equations *equations)
{
    size_t here = (size_t)y * (size_t)pairs->width + (size_t)x;
    size_t there = (size_t)(y + v) * (size_t)pairs->width + (size_t)(x + u);
    double forth =
        (double)
            pairs->near[here * CELLS + (size_t)((v + FALLOFF_REACH) * SIDE + u + FALLOFF_REACH)];
    double back =
        (double)
            pairs->near[there * CELLS + (size_t)((FALLOFF_REACH - v) * SIDE + FALLOFF_REACH - u)];
    double sum = forth + back;
    if (!(sum > 0) || !(forth > 0) || !(back > 0)) {
        return;
    }
    double a[FALLOFF_TERMS];
    double b[FALLOFF_TERMS];
    powers(pairs->width, pairs->height, x, y, a);
    powers(pairs->width, pairs->height, x + u, y + v, b);
    for (int i = 0; i < FALLOFF_TERMS; i++) {
        a[i] -= b[i];
    }
    /* tanh(log E(a) - log E(b)) is d / s exactly. */
    double difference = sum * atanh((forth - back) / sum);
    for (int i = 0; i < FALLOFF_TERMS; i++) {
        equations->right[i] += difference * a[i];
        for (int j = 0; j < FALLOFF_TERMS; j++) {
            equations->normal[i * FALLOFF_TERMS + j] += sum * a[i] * a[j];
        }
    }
    equations->squares += difference * difference / sum;
    equations->pairs++;
}

static void gather(const struct falloff_pairs *pairs, struct equations *equations)
{
    for (int y = 0; y < pairs->height; y++) {
        for (int x = 0; x < pairs->width; x++) {
            /* Half of all displacements, so that each pair comes once. */
            for (int v = 0; v <= FALLOFF_REACH; v++) {
                for (int u = v > 0 ? -FALLOFF_REACH : 1; u <= FALLOFF_REACH; u++) {
                    bool apart = v >= FALLOFF_NEAREST || abs(u) >= FALLOFF_NEAREST;
                    if (apart && x + u >= 0 && x + u < pairs->width && y + v < pairs->height) {
                        add_pair(pairs, x, y, u, v, equations);
                    }
                }
            }
        }
    }
}

/* E of every point from the coefficients of log E. */
static void draw(struct falloff *falloff, const double coefficients[FALLOFF_TERMS])
{
    double least = INFINITY;
    double most = 0;
    for (int y = 0; y < falloff->height; y++) {
        for (int x = 0; x < falloff->width; x++) {
            double terms[FALLOFF_TERMS];
            double sum = 0;
            powers(falloff->width, falloff->height, x, y, terms);
            for (int i = 0; i < FALLOFF_TERMS; i++) {
                sum += coefficients[i] * terms[i];
            }
            falloff->light[(size_t)y * (size_t)falloff->width + (size_t)x] = (float)exp(sum);
            least = fmin(least, exp(sum));
            most = fmax(most, exp(sum));
        }
    }
    falloff->range = most / least - 1;
}

/* Standard error of log E in the corner (0, 0), from the inverse of the normal matrix. */
static double corner_doubt(const double *inverse, int width, int height, double scatter)
{
    double corner[FALLOFF_TERMS];
    double variance = 0;
    powers(width, height, 0, 0, corner);
    for (int i = 0; i < FALLOFF_TERMS; i++) {
        for (int j = 0; j < FALLOFF_TERMS; j++) {
            int upper = i < j ? i * FALLOFF_TERMS + j : j * FALLOFF_TERMS + i;
            variance += corner[i] * corner[j] * inverse[upper];
        }
    }
    return sqrt(scatter * variance);
}

int falloff_find(const struct falloff_pairs *pairs, struct falloff *falloff,
                 struct nacre_error *error)
{
    struct equations equations = {0};
    double coefficients[FALLOFF_TERMS] = {0};
    size_t points = (size_t)pairs->width * (size_t)pairs->height;
    *falloff = (struct falloff){.width = pairs->width,
                                .height = pairs->height,
                                .light = malloc(points * sizeof *falloff->light)};
    if (!falloff->light) {
        return nacre_fail_memory(error, "the projector's fall-off");
    }
    gather(pairs, &equations);
    if (equations.pairs >= 2 * FALLOFF_TERMS) {
        double scatter = equations.squares / (double)equations.pairs;
        for (int i = 0; i < FALLOFF_TERMS; i++) {
            equations.normal[i * FALLOFF_TERMS + i] += scatter / (usual_term * usual_term) + 1e-300;
        }
        if (LAPACKE_dposv(LAPACK_ROW_MAJOR, 'U', FALLOFF_TERMS, 1, equations.normal, FALLOFF_TERMS,
                          equations.right, 1) == 0 &&
            LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'U', FALLOFF_TERMS, equations.normal, FALLOFF_TERMS) ==
                0) {
            memcpy(coefficients, equations.right, sizeof coefficients);
            falloff->pairs = equations.pairs;
            falloff->doubt = corner_doubt(equations.normal, pairs->width, pairs->height, scatter);
        }
    }
    draw(falloff, coefficients);
    return NACRE_OK;
}

void falloff_finish(struct falloff *falloff)
{
    if (falloff) {
        free(falloff->light);
        *falloff = (struct falloff){0};
    }
}

void falloff_apply(const struct falloff *falloff, const struct nacre_scan_info *info, int x, int y,
                   float *response)
{
    int half = info->window / 2;
    float here = falloff->light[(size_t)y * (size_t)falloff->width + (size_t)x];
    size_t plane = (size_t)info->window * (size_t)info->window;
    for (int yo = y - half; yo <= y + half; yo++) {
        for (int xo = x - half; xo <= x + half; xo++, response++) {
            if (xo < 0 || yo < 0 || xo >= falloff->width || yo >= falloff->height) {
                continue;
            }
            float gain = falloff->light[(size_t)yo * (size_t)falloff->width + (size_t)xo] / here;
            for (int c = 0; c < info->channels; c++) {
                response[(size_t)c * plane] *= gain;
            }
        }
    }
}
