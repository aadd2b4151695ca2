/* Two waxes, a hundred kernels between them. */
#include "candle_model.h"

#include "render/random.h"
#include "timing.h"

#include <math.h>

enum { WIDTH = 212, HEIGHT = 154, WINDOW = 49, TERMS = 12, CLUSTERS = 100 };

/* Smooth noise in (0, 1): random values on a lattice of step `size`, blended. */
static double noise(uint64_t seed, double x, double y, double size)
{
    double u = x / size, v = y / size, sum = 0;
    double fu = u - floor(u), fv = v - floor(v);
    fu = fu * fu * (3 - 2 * fu);
    fv = fv * fv * (3 - 2 * fv);
    for (int k = 0; k < 4; k++) {
        uint64_t column = (uint64_t)(floor(u) + 1000 + (k & 1));
        uint64_t row = (uint64_t)(floor(v) + 1000 + (k >> 1));
        sum +=
            ((k & 1) ? fu : 1 - fu) * ((k >> 1) ? fv : 1 - fv) * random_uniform(seed, column, row);
    }
    return sum;
}

/* 0 in yellow wax, 1 in red: clouds with an edge about three surface points wide. */
static double redness(double x, double y)
{
    double cloud = 0.65 * noise(11, x, y, 62) + 0.35 * noise(12, x, y, 27);
    return 1 / (1 + exp(-(cloud - 0.53) / 0.018));
}

/* How dense the wax is at a point: what tells clusters of the same wax apart. */
static double density(double x, double y)
{
    return 0.7 * noise(21, x, y, 14) + 0.3 * noise(22, x, y, 5);
}

/* Kernels 0 to 49 of yellow wax, 50 to 99 of red, each from thin to dense. */
static uint32_t cluster_at(double x, double y)
{
    double step = fmin(fmax((density(x, y) - 0.2) / 0.6, 0), 0.999);
    return (uint32_t)(redness(x, y) > 0.5 ? 50 : 0) + (uint32_t)(step * 50);
}

/* Falls off like the far field of a diffusion dipole, exp(-r / reach) / (r + core), a little longer in one direction. */
static void fill_kernel(struct nacre_material *material, int cluster, int channel)
{
    const double reach[2][3] = {{7.5, 6, 2.8}, {3, 1.3, 1.1}};
    const double albedo[2][3] = {{0.82, 0.7, 0.36}, {0.62, 0.17, 0.14}};
    uint64_t number = (uint64_t)cluster;
    int red = cluster / 50, half = WINDOW / 2;
    double step = cluster % 50 / 49.0, sum = 0, top = 0;
    double length = reach[red][channel] * (1.35 - 0.7 * step), core = 0.6 + 0.8 * step;
    double lean = 0.16 * random_uniform(31, number, 0),
           angle = 3.14159 * random_uniform(32, number, 0);
    float *kernel = material->kernels + ((size_t)cluster * 3 + (size_t)channel) * WINDOW * WINDOW;
    for (int i = 0; i < WINDOW * WINDOW; i++) {
        int column = i % WINDOW - half, row = i / WINDOW - half;
        double x = column, y = row;
        double r = hypot(x, y) * (1 - lean * cos(2 * (atan2(y, x) - angle)));
        kernel[i] = (float)(exp(-r / length) / (r + core));
        top = fmax(top, (double)kernel[i]);
        sum += (double)kernel[i];
    }
    for (int i = 0; i < WINDOW * WINDOW; i++) {
        kernel[i] = (float)((double)kernel[i] * albedo[red][channel] / sum + 1e-5 * top / sum);
    }
}

/* Each term is strong somewhere and weak elsewhere; together F H is about 1. */
static void fill_factors(struct nacre_material *material, size_t t, size_t c)
{
    size_t points = (size_t)WIDTH * HEIGHT;
    float *f = material->f + (t * 3 + c) * points, *h = material->h + (t * 3 + c) * points;
    for (size_t i = 0; i < points; i++) {
        size_t row = i / WIDTH;
        double x = (double)(i % WIDTH), y = (double)row, red = redness(x, y);
        double wax = t % 3 == 2 ? red : 1 - 0.8 * red; /* a third of the terms belong to red wax */
        double place = pow(noise(100 + t, x, y, 30), 2) * 3;
        double grain = 0.85 + 0.3 * noise(200 + c, x, y, 3);
        f[i] = (float)(wax * place * grain);
        h[i] = (float)((0.4 + 0.6 * noise(100 + t, x + 3, y, 30)) *
                       (0.9 + 0.2 * noise(300 + c, x, y, 4)) * 5 / TERMS);
    }
}

struct nacre_material candle_model(void)
{
    struct nacre_material material = {.width = WIDTH,
                                      .height = HEIGHT,
                                      .channels = 3,
                                      .window = WINDOW,
                                      .terms = TERMS,
                                      .clusters = CLUSTERS,
                                      .mixed = 1,
                                      .layout = NACRE_KERNEL_SINGLE,
                                      .pixel = NACRE_FLOAT,
                                      .factor_channels = 3,
                                      .pitch_mm = 0.934,
                                      .method = "made"};
    struct nacre_error error = {0};
    if (nacre_material_allocate(&material, true, false, &error) != NACRE_OK) {
        fail(error.text);
    }
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++) {
        size_t row = i / WIDTH;
        material.ids[i] = cluster_at((double)(i % WIDTH), (double)row);
        material.weights[i] = 1;
    }
    for (int j = 0; j < CLUSTERS; j++) {
        for (int c = 0; c < 3; c++) {
            fill_kernel(&material, j, c);
        }
    }
#pragma omp parallel for
    for (size_t k = 0; k < (size_t)TERMS * 3; k++) {
        fill_factors(&material, k / 3, k % 3);
    }
    return material;
}
