/* Trials of tiles: each is compiled and timed on the same small problem, in turns. */
#include "factor/tune_trial.h"

#include "factor/layout.h"
#include "factor/random.h"
#include "factor/update.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { WIDTH = 96, HEIGHT = 64, WINDOW = 25, TERMS = 12, CLUSTERS = 8, ROUNDS = 7, CLASSES = 4 };

struct trial {
    const struct opencl *opencl;
    const struct update_tile *tiles;
    size_t count; /* of them, at most TUNE_TILES */
    struct responses responses;
    struct problem problem;
    uint32_t ids[HEIGHT * WIDTH];
    float kernels[CLUSTERS * WINDOW * WINDOW];
    struct method *methods[TUNE_TILES];
    double seconds[TUNE_TILES]; /* least of an iteration */
};

/* Exponential fall-offs with a little noise; clusters in patches, as they are in samples. */
static int make_problem(struct trial *t, bool half, bool clustered, struct nacre_error *error)
{
    const struct nacre_scan_info info = {.width = WIDTH,
                                         .height = HEIGHT,
                                         .window = WINDOW,
                                         .channels = 1,
                                         .pixel = NACRE_FLOAT,
                                         .pitch_mm = 1};
    float response[WINDOW * WINDOW];
    int status = responses_begin(&t->responses, &info, layout_lanes(t->opencl), half, error);
    if (status != NACRE_OK) {
        return status;
    }
    for (int i = 0; i < CLUSTERS * WINDOW * WINDOW; i++) {
        int dx = i % WINDOW - WINDOW / 2, dy = i / WINDOW % WINDOW - WINDOW / 2;
        t->kernels[i] = expf(-0.3F * hypotf((float)dx, (float)dy)) + 1e-5F;
    }
    for (int p = 0; p < WIDTH * HEIGHT; p++) {
        for (int i = 0; i < WINDOW * WINDOW; i++) {
            double noise = random_uniform(1, (uint64_t)p * WINDOW * WINDOW + (uint64_t)i);
            response[i] = t->kernels[i] * (float)(0.99 + 0.02 * noise);
        }
        responses_put(&t->responses, p % WIDTH, p / WIDTH, response);
        t->ids[p] = (uint32_t)(p % WIDTH / 5 + p / WIDTH / 5 * 3) % CLUSTERS;
        t->ids[p] = clustered ? t->ids[p] : 0;
    }
    responses_scale(&t->responses);
    t->problem = (struct problem){.responses = &t->responses,
                                  .ids = t->ids,
                                  .kernels = t->kernels,
                                  .clusters = clustered ? CLUSTERS : 1,
                                  .terms = TERMS};
    return NACRE_OK;
}

/* What a step costs: seconds, or where the processor is the device its time, which what else runs there leaves alone. */
static double now(const struct opencl *opencl)
{
    cl_device_type type = 0;
    struct timespec time = {0};
    (void)clGetDeviceInfo(opencl->device, CL_DEVICE_TYPE, sizeof type, &type, NULL);
    (void)clock_gettime(type & CL_DEVICE_TYPE_CPU ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC,
                        &time);
    return (double)time.tv_sec + (double)time.tv_nsec * 1e-9;
}

static int time_step(const struct opencl *opencl, struct method *method, double *seconds,
                     struct nacre_error *error)
{
    double start = now(opencl);
    int status = method->ops->step(method, 0, NULL, error);
    if (status == NACRE_OK) {
        status = update_wait(method, error);
    }
    *seconds = now(opencl) - start;
    return status;
}

/* The first step of each compiles; then they take turns, so that all meet the same load. */
static int time_tiles(struct trial *t, int class, struct progress *progress,
                      struct nacre_error *error)
{
    size_t count = t->count;
    int status = NACRE_OK;
    double seconds = 0;
    for (size_t i = 0; i < count && status == NACRE_OK; i++) {
        status = progress_step(progress, (double)((size_t) class * count + i),
                               (double)(CLASSES * count), "compiling kernels", error);
        if (status == NACRE_OK) {
            status = update_new(t->opencl, &t->problem, &t->tiles[i], &t->methods[i], error);
        }
        if (status == NACRE_OK) {
            status = time_step(t->opencl, t->methods[i], &seconds, error);
        }
        t->seconds[i] = INFINITY;
    }
    for (size_t i = 0; i < ROUNDS * count && status == NACRE_OK; i++) {
        status = time_step(t->opencl, t->methods[i % count], &seconds, error);
        t->seconds[i % count] = fmin(t->seconds[i % count], seconds);
    }
    return status;
}

static void tell_gain(const struct trial *t, const struct tune_class *class, FILE *told)
{
    const struct update_tile *tiles = t->tiles;
    struct update_tile best = update_tile_choose(t->opencl, &t->problem);
    struct update_tile standard = update_tile_default(class->lanes, TERMS);
    double best_seconds = NAN, standard_seconds = NAN;
    for (size_t i = 0; i < t->count; i++) {
        best_seconds = memcmp(&tiles[i], &best, sizeof best) == 0 ? t->seconds[i] : best_seconds;
        standard_seconds =
            memcmp(&tiles[i], &standard, sizeof best) == 0 ? t->seconds[i] : standard_seconds;
    }
    (void)fprintf(
        told, "  %-5s %-15s %d rows, %d steps, %d terms: %.1f %% less time than the default\n",
        class->half ? "half" : "float", class->clustered ? "several kernels" : "one kernel",
        best.rows, best.steps, best.group, 100 * (1 - best_seconds / standard_seconds));
}

static int try_class(struct trial *t, int number, struct progress *progress, FILE *told,
                     struct nacre_error *error)
{
    struct tune_class class = {.method = "mu",
                               .lanes = layout_lanes(t->opencl),
                               .clustered = number % 2,
                               .half = number / 2};
    struct tune_result results[TUNE_TILES];
    const struct update_tile *tiles = t->tiles;
    int status = make_problem(t, class.half, class.clustered, error);
    if (status == NACRE_OK) {
        status = time_tiles(t, number, progress, error);
    }
    for (size_t i = 0; i < t->count && status == NACRE_OK; i++) {
        int planes = (TERMS + tiles[i].group - 1) / tiles[i].group * tiles[i].group;
        results[i] = (struct tune_result){.tile = {tiles[i].rows, tiles[i].steps, tiles[i].group},
                                          .seconds = t->seconds[i] / planes};
    }
    if (status == NACRE_OK) {
        status = tune_remember(t->opencl, class, results, t->count, error);
    }
    if (status == NACRE_OK) {
        tell_gain(t, &class, told);
    }
    for (size_t i = 0; i < TUNE_TILES; i++) {
        method_free(t->methods[i]);
        t->methods[i] = NULL;
    }
    responses_finish(&t->responses);
    return status;
}

int tune_trial(const struct opencl *opencl, const struct update_tile *tiles, size_t count,
               struct progress *progress, FILE *told, struct nacre_error *error)
{
    struct trial *t = calloc(1, sizeof *t);
    int status = NACRE_OK;
    if (!t) {
        return nacre_fail_memory(error, "the trial");
    }
    for (int i = 0; i < CLASSES && status == NACRE_OK; i++) {
        t->opencl = opencl;
        t->tiles = tiles;
        t->count = count < TUNE_TILES ? count : TUNE_TILES;
        status = try_class(t, i, progress, told, error);
    }
    free(t);
    return status;
}
