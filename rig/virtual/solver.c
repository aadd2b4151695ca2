/* Choosing a solver, and scans by closed form and by Monte Carlo. */
#include "rig/virtual/solver.h"

#include "nacre/scan.h"
#include "rig/virtual/closed.h"
#include "rig/virtual/montecarlo.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { CHANNELS = 3, MOST_SUBDIVIDE = 16, LEAST_PATHS = 4096 };

/* Measured on one 2 to 3 GHz core: a wave of the closed form, and a path of ten mean free paths or so. */
static const double WAVE_SECONDS = 60e-9;
static const double PATH_SECONDS = 6e-6;

/* Relative standard error of a response's norm after one path; it falls with the root of their number. */
static const double PATH_DEVIATION = 1;

static const char *const NAMES[SOLVERS] = {"closed form", "diffusion on voxels", "Monte Carlo"};

const char *solver_name(enum solver solver)
{
    return NAMES[solver];
}

static struct closed_slab slab_of(const struct sample *sample, int channel)
{
    const struct sample_material *material = &sample->materials[sample->base_index];
    return (struct closed_slab){.scattering_per_mm = material->scattering_per_mm[channel] *
                                                     (1 - material->anisotropy[channel]),
                                .absorption_per_mm = material->absorption_per_mm[channel],
                                .index = material->index,
                                .thickness_mm = sample->thickness_mm,
                                .pitch_mm = sample->pitch_mm};
}

static double decay_mm(const struct sample *sample)
{
    double decay = 0;
    for (int c = 0; c < CHANNELS; c++) {
        struct closed_slab slab = slab_of(sample, c);
        decay = fmax(decay, closed_decay_mm(&slab));
    }
    return decay;
}

/* What diffusion misses of light that has not lost its direction yet: measured against Monte Carlo and Chandrasekhar's
 * half space, see docs/transport.md. */
static double model_error(const struct sample *sample)
{
    return fmin(0.06 + 0.12 * sample_shortest_path_mm(sample) / sample->pitch_mm, 1);
}

/* What voxels of some mean free paths miss of a response's peak, measured likewise. */
static double voxel_error(const struct sample *sample, int subdivide)
{
    double paths = sample->pitch_mm / subdivide / sample_shortest_path_mm(sample);
    return 0.14 * paths * paths + 0.03 * paths;
}

static void try_closed(const struct sample *sample, int window, double tolerance,
                       struct solver_option *option)
{
    double decay = decay_mm(sample);
    /* Light that would come back from the sides has gone there and back. */
    double sides = exp(-2 * sample->margin_points * sample->pitch_mm / decay);
    double seconds = 0;
    for (int c = 0; c < CHANNELS; c++) {
        struct closed_slab slab = slab_of(sample, c);
        double waves = closed_waves(&slab, window);
        seconds += waves * waves * WAVE_SECONDS * (1 + 0.01 * window);
    }
    option->error = model_error(sample) + sides;
    option->seconds = seconds;
    if (sample->inclusion_count > 0) {
        (void)snprintf(option->reason, sizeof option->reason,
                       "the sample is not homogeneous"); /* fits */
    } else if (sides > 0.02) {
        (void)snprintf(option->reason, sizeof option->reason,
                       "the sides are near: margin_points would have to be %.0f",
                       ceil(2 * decay / sample->pitch_mm));
    } else if (tolerance > 0 && option->error > tolerance) {
        (void)snprintf(option->reason, sizeof option->reason,
                       "its error of about %.2g is above the tolerance", option->error);
    }
}

static void try_diffusion(const struct sample *sample, double tolerance, int subdivide,
                          double seconds, struct solver_choice *choice)
{
    struct solver_option *option = &choice->options[SOLVER_DIFFUSION];
    double model = model_error(sample);
    choice->subdivide = subdivide;
    while (tolerance > 0 && sample->voxels.subdivide == 0 && choice->subdivide < MOST_SUBDIVIDE &&
           model + voxel_error(sample, choice->subdivide) > tolerance) {
        choice->subdivide++;
    }
    double finer = (double)choice->subdivide / subdivide;
    option->seconds = seconds * finer * finer;
    option->error = model + voxel_error(sample, choice->subdivide);
    if (tolerance > 0 && option->error > tolerance) {
        (void)snprintf(option->reason, sizeof option->reason,
                       "its error of about %.2g is above the tolerance: %.2g of diffusion itself, "
                       "%.2g of %d voxels a point",
                       option->error, model, option->error - model, choice->subdivide);
        choice->subdivide = subdivide;
    }
}

static void try_montecarlo(const struct sample *sample, double tolerance,
                           struct solver_choice *choice)
{
    struct solver_option *option = &choice->options[SOLVER_MONTECARLO];
    double deviation = tolerance > 0 ? tolerance : 0.02;
    double paths = fmax(pow(PATH_DEVIATION / deviation, 2), LEAST_PATHS);
    choice->paths = (uint64_t)ceil(paths);
    option->error = PATH_DEVIATION / sqrt(paths);
    option->seconds = paths * CHANNELS * sample->width * sample->height * PATH_SECONDS;
    if (paths > 1e9) {
        (void)snprintf(option->reason, sizeof option->reason, "it takes %.2g paths a point", paths);
    }
}

int solver_choose(const struct sample *sample, int window, double tolerance,
                  double diffusion_seconds, int subdivide, struct solver_choice *choice,
                  struct nacre_error *error)
{
    *choice = (struct solver_choice){0};
    try_closed(sample, window, tolerance, &choice->options[SOLVER_CLOSED]);
    try_diffusion(sample, tolerance, subdivide, diffusion_seconds, choice);
    try_montecarlo(sample, tolerance, choice);
    int best = -1;
    for (int i = 0; i < SOLVERS; i++) {
        const struct solver_option *option = &choice->options[i];
        if (!option->reason[0] && (best < 0 || option->seconds < choice->options[best].seconds)) {
            best = i;
        }
    }
    if (best < 0) {
        return nacre_fail(error, "no solver reaches a tolerance of %g on this sample", tolerance);
    }
    choice->solver = (enum solver)best;
    for (int i = 0; i < SOLVERS; i++) {
        struct solver_option *option = &choice->options[i];
        if (i != best && !option->reason[0]) {
            (void)snprintf(option->reason, sizeof option->reason,
                           "it would do, and takes longer"); /* fits */
        }
    }
    return NACRE_OK;
}

static int begin(const struct sample *sample, int window, const char *source, const char *path,
                 struct nacre_scan_writer **writer, struct nacre_error *error)
{
    struct nacre_scan_info info = {.width = sample->width,
                                   .height = sample->height,
                                   .window = window,
                                   .channels = CHANNELS,
                                   .pixel = NACRE_FLOAT,
                                   .pitch_mm = sample->pitch_mm};
    char without[128];
    sample_without_text(sample, without, sizeof without);
    (void)snprintf(info.source, sizeof info.source, "nacre simulate: %.100s%.100s", source,
                   without);
    return nacre_scan_create(path, &info, writer, error);
}

int solver_write_closed(const struct sample *sample, int window, const char *path,
                        struct progress *progress, struct nacre_error *error)
{
    size_t plane = (size_t)window * (size_t)window;
    struct nacre_scan_writer *writer = NULL;
    float *response = calloc(CHANNELS * plane, sizeof *response);
    int status = response ? NACRE_OK : nacre_fail_memory(error, "the responses");
    for (int c = 0; c < CHANNELS && !status; c++) {
        struct closed_slab slab = slab_of(sample, c);
        status =
            closed_response(&slab, CLOSED_RADIANCE, window, response + (size_t)c * plane, error);
    }
    if (!status) {
        status = begin(sample, window, "closed form of a homogeneous slab", path, &writer, error);
    }
    for (int y = 0; y < sample->height && !status; y++) {
        for (int x = 0; x < sample->width && !status; x++) {
            status = nacre_scan_write(writer, x, y, response, error);
        }
        if (!status) {
            status = progress_step(progress, y + 1, sample->height, NULL, error);
        }
    }
    if (!status) {
        status = nacre_scan_commit(writer, error);
        writer = NULL;
    }
    nacre_scan_discard(writer);
    free(response);
    return status;
}

/* A row of surface points by Monte Carlo. */
struct paths_row {
    int (*points)[2];  /* [width] */
    float *responses;  /* [3][width][K][K] */
    float *deviations; /* the same */
    float *gathered;   /* [3][K][K] of one point */
};

static int trace_row(struct montecarlo *montecarlo, const struct sample *sample,
                     const struct solver_choice *choice, int window, uint32_t seed,
                     const struct paths_row *row, struct nacre_error *error)
{
    size_t block = (size_t)sample->width * (size_t)window * (size_t)window;
    int status = NACRE_OK;
    for (int c = 0; c < CHANNELS && !status; c++) {
        struct montecarlo_request request = {.estimator = MONTECARLO_RADIANCE,
                                             .channel = c,
                                             .window = window,
                                             .points = (const int(*)[2])row->points,
                                             .count = (size_t)sample->width,
                                             .paths = choice->paths,
                                             .seed = seed};
        status = montecarlo_trace(montecarlo, &request, row->responses + (size_t)c * block,
                                  row->deviations + (size_t)c * block, NULL, error);
    }
    return status;
}

/* Write a row; returns the sum of its points' relative standard errors in *deviation. */
static int write_row(const struct sample *sample, int window, const struct paths_row *row, int y,
                     struct nacre_scan_writer *writer, double *deviation, struct nacre_error *error)
{
    size_t plane = (size_t)window * (size_t)window;
    int status = NACRE_OK;
    for (int x = 0; x < sample->width && !status; x++) {
        double squares = 0;
        double variances = 0;
        for (size_t i = 0; i < CHANNELS * plane; i++) {
            size_t at = (i / plane * (size_t)sample->width + (size_t)x) * plane + i % plane;
            row->gathered[i] = row->responses[at];
            squares += (double)row->responses[at] * (double)row->responses[at];
            variances += (double)row->deviations[at] * (double)row->deviations[at];
        }
        *deviation += squares > 0 ? sqrt(variances / squares) : 0;
        status = nacre_scan_write(writer, x, y, row->gathered, error);
    }
    return status;
}

int solver_write_montecarlo(const struct sample *sample, const struct solver_choice *choice,
                            int window, uint32_t seed, const char *path, struct progress *progress,
                            double *deviation, struct nacre_error *error)
{
    size_t width = (size_t)sample->width;
    size_t plane = (size_t)window * (size_t)window;
    struct montecarlo *montecarlo = NULL;
    struct nacre_scan_writer *writer = NULL;
    struct paths_row row = {.points = calloc(width, sizeof *row.points),
                            .responses = calloc(width * plane, CHANNELS * sizeof(float)),
                            .deviations = calloc(width * plane, CHANNELS * sizeof(float)),
                            .gathered = calloc(plane, CHANNELS * sizeof(float))};
    char source[128];
    int status = NACRE_OK;
    *deviation = 0;
    if (!row.points || !row.responses || !row.deviations || !row.gathered) {
        status = nacre_fail_memory(error, "the responses");
        goto out;
    }
    (void)snprintf(source, sizeof source, "Monte Carlo, %llu paths a point and channel, seed %u",
                   (unsigned long long)choice->paths, seed); /* fits */
    status = montecarlo_new(sample, NULL, &montecarlo, error);
    if (!status) {
        status = begin(sample, window, source, path, &writer, error);
    }
    for (int y = 0; y < sample->height && !status; y++) {
        for (size_t x = 0; x < width; x++) {
            row.points[x][0] = (int)x;
            row.points[x][1] = y;
        }
        status = progress_step(progress, y, sample->height, NULL, error);
        if (!status) {
            status = trace_row(montecarlo, sample, choice, window, seed, &row, error);
        }
        if (!status) {
            status = write_row(sample, window, &row, y, writer, deviation, error);
        }
    }
    *deviation /= (double)width * sample->height;
    if (!status) {
        status = nacre_scan_commit(writer, error);
        writer = NULL;
    }
out:
    nacre_scan_discard(writer);
    montecarlo_free(montecarlo);
    free(row.points);
    free(row.responses);
    free(row.deviations);
    free(row.gathered);
    return status;
}
