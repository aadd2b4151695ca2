/* Seconds per iteration of the multiplicative updates, against OpenBLAS sgemm and a plain OpenMP program in one run. */
#include "peer.h"
#include "timing.h"

#include "factor/layout.h"
#include "factor/random.h"
#include "factor/update.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ROUNDS = 7 };

struct shape {
    const char *name;
    int width, height, window, terms, clusters;
};

/* Exponential fall-offs with 1 % noise; the kernel gets the fall-off itself. */
static float *make_responses(const struct shape *s, float *kernel)
{
    int half = s->window / 2, area = s->window * s->window;
    float *responses =
        allocate((size_t)s->width * (size_t)s->height * (size_t)area * sizeof(float));
    for (int i = 0; i < area; i++) {
        int dx = i % s->window - half, dy = i / s->window - half;
        kernel[i] = expf(-0.3F * hypotf((float)dx, (float)dy)) + 1e-5F;
    }
    for (size_t p = 0; p < (size_t)s->width * (size_t)s->height; p++) {
        for (size_t i = 0; i < (size_t)area; i++) {
            float noise = (float)random_uniform(7, p * (size_t)area + i);
            responses[p * (size_t)area + i] = kernel[i] * (0.99F + 0.02F * noise);
        }
    }
    return responses;
}

static struct moment time_iteration(struct method *method, bool with_objective)
{
    struct nacre_error error = {0};
    double objective = 0;
    struct moment start = timing_now();
    if (method->ops->step(method, 0, with_objective ? &objective : NULL, &error) != NACRE_OK ||
        update_wait(method, &error) != NACRE_OK) {
        fail(error.text);
    }
    return timing_since(start);
}

static double time_peer(const struct shape *s, const float *responses, const float *kernel)
{
    size_t count = (size_t)s->width * (size_t)s->height * (size_t)s->terms;
    struct peer peer = {.width = s->width,
                        .height = s->height,
                        .window = s->window,
                        .terms = s->terms,
                        .responses = responses,
                        .ids = allocate((size_t)s->width * (size_t)s->height * sizeof(uint32_t)),
                        .kernels = kernel,
                        .f = allocate(count * sizeof(float)),
                        .h = allocate(count * sizeof(float))};
    for (size_t i = 0; i < count; i++) {
        peer.f[i] = (float)random_uniform(1, i);
        peer.h[i] = (float)random_uniform(2, i);
    }
    struct moment start = timing_now();
    peer_update(&peer, false);
    peer_update(&peer, true);
    double seconds = timing_since(start).wall;
    free((void *)peer.ids);
    free(peer.f);
    free(peer.h);
    return seconds;
}

static void load(struct responses *responses, const struct shape *s, const float *values, int lanes)
{
    struct nacre_error error = {0};
    struct nacre_scan_info info = {.width = s->width,
                                   .height = s->height,
                                   .window = s->window,
                                   .channels = 1,
                                   .pixel = NACRE_FLOAT,
                                   .pitch_mm = 1};
    if (responses_begin(responses, &info, lanes, false, &error) != NACRE_OK) {
        fail(error.text);
    }
#pragma omp parallel for
    for (int y = 0; y < s->height; y++) {
        for (int x = 0; x < s->width; x++) {
            responses_put(responses, x, y,
                          values + ((size_t)y * (size_t)s->width + (size_t)x) * (size_t)s->window *
                                       (size_t)s->window);
        }
    }
    responses_scale(responses);
}

/* Rounds of sgemm and one iteration in turns, so that both meet the same load. */
static void compare(const struct shape *s, struct method *method, double peer)
{
    struct sgemm sgemm = sgemm_new();
    double wall[ROUNDS], share_wall[ROUNDS], share_processor[ROUNDS], sgemm_rate[ROUNDS],
        extra[ROUNDS];
    double useful = 12.0 * s->terms * entries_inside(s->width, s->height, s->window),
           sgemm_flops = 2 * pow(SGEMM_SIZE, 3);
    (void)time_iteration(method, false); /* compiles on first use */
    (void)time_iteration(method, true);
    (void)sgemm_run(&sgemm);
    for (int i = 0; i < ROUNDS; i++) {
        struct moment product = sgemm_run(&sgemm), step = time_iteration(method, false);
        double with_objective = time_iteration(method, true).processor;
        wall[i] = step.wall;
        extra[i] = with_objective / step.processor - 1;
        sgemm_rate[i] = sgemm_flops / product.wall * 1e-9;
        share_wall[i] = useful / step.wall / (sgemm_flops / product.wall);
        share_processor[i] = useful / step.processor / (sgemm_flops / product.processor);
    }
    double seconds = timing_median(wall, ROUNDS);
    printf("%-14s %4d x %-4d K %2d T %2d k %3d  %8.4f s/iteration  %6.1f GF/s  sgemm %6.1f GF/s  "
           "%5.1f %% wall  %5.1f %% processor  objective %+.1f %%",
           s->name, s->width, s->height, s->window, s->terms, s->clusters, seconds,
           useful / seconds * 1e-9, timing_median(sgemm_rate, ROUNDS),
           100 * timing_median(share_wall, ROUNDS), 100 * timing_median(share_processor, ROUNDS),
           100 * timing_median(extra, ROUNDS));
    if (peer > 0) {
        printf("  OpenMP C %.3f s = %.1f times", peer, peer / seconds);
    }
    printf("\n");
    (void)fflush(stdout);
    sgemm_finish(&sgemm);
}

static void run(const struct shape *s, const struct opencl *opencl, const struct update_tile *tile)
{
    struct nacre_error error = {0};
    size_t area = (size_t)s->window * (size_t)s->window;
    size_t points = (size_t)s->width * (size_t)s->height;
    float *kernel = allocate(area * sizeof *kernel);
    float *values = make_responses(s, kernel);
    float *kernels = allocate((size_t)s->clusters * area * sizeof *kernels);
    uint32_t *ids = allocate(points * sizeof *ids);
    struct responses responses;
    struct method *method = NULL;
    double peer = s->clusters == 1 && !tile ? time_peer(s, values, kernel) : 0;
    load(&responses, s, values, layout_lanes(opencl));
    free(values);
    for (size_t k = 0; k < (size_t)s->clusters; k++) {
        memcpy(kernels + k * area, kernel, area * sizeof *kernel);
    }
    /* Clusters in patches of 5 x 5 points. */
    for (size_t i = 0; i < points; i++) {
        size_t patch = i % (size_t)s->width / 5 + i / (size_t)s->width / 5 * 31;
        ids[i] = (uint32_t)(random_bits(3, patch) % (uint64_t)s->clusters);
    }
    struct problem problem = {.responses = &responses,
                              .ids = ids,
                              .kernels = kernels,
                              .clusters = s->clusters,
                              .terms = s->terms,
                              .seed = 1};
    if (update_new(opencl, &problem, tile, &method, &error) != NACRE_OK) {
        fail(error.text);
    }
    compare(s, method, peer);
    method_free(method);
    responses_finish(&responses);
    free(kernel);
    free(kernels);
    free(ids);
}

static int number(const char *text)
{
    return (int)strtol(text, NULL, 10);
}

/* Arguments: --full for the paper's sizes; --tile ROWS STEPS GROUP to try one. */
int main(int argc, char **argv)
{
    static const struct shape reduced[] = {{"candle/4", 106, 77, 49, 12, 1},
                                           {"candle/4", 106, 77, 49, 12, 100},
                                           {"marble 4x4/4", 138, 138, 39, 20, 1},
                                           {"marble 4x4/4", 138, 138, 39, 20, 100}};
    static const struct shape full[] = {{"candle", 212, 154, 49, 12, 1},
                                        {"candle", 212, 154, 49, 12, 100},
                                        {"marble 4x4", 277, 277, 39, 20, 1},
                                        {"marble 4x4", 277, 277, 39, 20, 100}};
    const struct shape *shapes = reduced;
    struct update_tile tile = {0};
    struct opencl opencl;
    struct nacre_error error = {0};
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--full") == 0) {
            shapes = full;
        } else if (strcmp(argv[i], "--tile") == 0 && i + 3 < argc) {
            tile =
                (struct update_tile){number(argv[i + 1]), number(argv[i + 2]), number(argv[i + 3])};
            i += 3;
        } else {
            fail("usage: bench_update [--full] [--tile ROWS STEPS GROUP]");
        }
    }
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        (void)fprintf(stderr, "SKIP: %s\n", error.text);
        return 77;
    }
    printf("%s, %u compute units; useful flops: 12 T for each entry inside the sample\n",
           opencl.name, opencl.compute_units);
    for (int i = 0; i < 4; i++) {
        run(&shapes[i], &opencl, tile.rows ? &tile : NULL);
    }
    opencl_close(&opencl);
    return EXIT_SUCCESS;
}
