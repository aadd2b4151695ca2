/* Seconds to the objective that 1000 of the paper's updates reach: the default method against them, on scans. */
#include "timing.h"

#include "factor/factorize.h"
#include "factor/layout.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { UPDATES = 1000, STEPS = 200, ROUNDS = 5 };

/* The share of sgemm's rate that the pinned baseline, a thousand updates, is taken to run at. */
#define PINNED_SHARE 0.45

static struct nacre_material factor(const struct responses *responses, enum factor_method method,
                                    int terms, int clusters, int iterations,
                                    const struct opencl *opencl)
{
    struct nacre_error error = {0};
    struct factor_options options = factor_options_default();
    struct factor_summary summary = {0};
    struct nacre_material material;
    options.method = method;
    options.terms = terms;
    options.clusters = clusters;
    options.iterations = iterations;
    options.tolerance = 0;
    if (factorize_responses(responses, 1, &options, opencl, NULL, &material, &summary, &error) !=
        NACRE_OK) {
        fail(error.text);
    }
    factor_summary_finish(&summary);
    return material;
}

static double sgemm_rate(void)
{
    struct sgemm sgemm = sgemm_new();
    double rates[ROUNDS];
    (void)sgemm_run(&sgemm);
    for (int i = 0; i < ROUNDS; i++) {
        rates[i] = 2 * pow(SGEMM_SIZE, 3) / sgemm_run(&sgemm).wall;
    }
    sgemm_finish(&sgemm);
    return timing_median(rates, ROUNDS);
}

static void compare(const char *path, const struct responses *r, int terms, int clusters,
                    const struct opencl *opencl)
{
    struct nacre_material warm = factor(r, FACTOR_METHOD_HALS, terms, clusters, 2, opencl);
    nacre_material_finish(&warm); /* its kernels are compiled now */
    warm = factor(r, FACTOR_METHOD_MU, terms, clusters, 2, opencl);
    nacre_material_finish(&warm);
    double rate = sgemm_rate();
    struct nacre_material mu = factor(r, FACTOR_METHOD_MU, terms, clusters, UPDATES, opencl);
    struct nacre_material hals = factor(r, FACTOR_METHOD_HALS, terms, clusters, STEPS, opencl);
    rate = (rate + sgemm_rate()) / 2;
    double flops = 12.0 * terms * r->channels * entries_inside(r->width, r->height, r->window);
    double pinned = UPDATES * flops / (PINNED_SHARE * rate),
           seconds = mu.history_seconds[UPDATES - 1];
    float goal = mu.history_objective[UPDATES - 1];
    int step = 0;
    while (step < hals.iterations && hals.history_objective[step] > goal) {
        step++;
    }
    printf("%s  %d x %d K %d, %d channels, T %d k %d\n", path, r->width, r->height, r->window,
           r->channels, terms, clusters);
    printf(
        "  mu    %8.4f s/iteration  %5.1f %% of sgemm's %.0f GF/s  %8.2f s to its objective %.6g,"
        " error %.4f\n",
        seconds / UPDATES, 100 * flops * UPDATES / seconds / rate, rate * 1e-9, seconds,
        (double)goal, mu.error_mean);
    if (step < hals.iterations) {
        double reached = hals.history_seconds[step];
        printf(
            "  hals  %8.2f s to that objective in %d steps: %.1f times sooner than mu, %.1f times "
            "sooner than the pinned baseline (%.2f s)\n",
            reached, step + 1, seconds / reached, pinned / reached, pinned);
    } else {
        printf("  hals  did not reach that objective in %d steps\n", STEPS);
    }
    printf("        %8.2f s for %d steps: objective %.6g, error %.4f\n",
           (double)hals.history_seconds[STEPS - 1], STEPS,
           (double)hals.history_objective[STEPS - 1], hals.error_mean);
    (void)fflush(stdout);
    nacre_material_finish(&mu);
    nacre_material_finish(&hals);
}

/* Arguments: SCAN TERMS CLUSTERS, any number of such triples. */
int main(int argc, char **argv)
{
    struct nacre_error error = {0};
    struct opencl opencl;
    if (argc < 4 || argc % 3 != 1) {
        fail("usage: bench_methods SCAN TERMS CLUSTERS ...");
    }
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        (void)fprintf(stderr, "SKIP: %s\n", error.text);
        return 77;
    }
    for (int i = 1; i < argc; i += 3) {
        struct nacre_scan *scan = NULL;
        struct responses responses;
        if (nacre_scan_open(argv[i], &scan, &error) != NACRE_OK ||
            responses_load(&responses, scan, layout_lanes(&opencl), NULL, &error) != NACRE_OK) {
            fail(error.text);
        }
        compare(argv[i], &responses, (int)strtol(argv[i + 1], NULL, 10),
                (int)strtol(argv[i + 2], NULL, 10), &opencl);
        responses_finish(&responses);
        nacre_scan_close(scan);
    }
    opencl_close(&opencl);
    return EXIT_SUCCESS;
}
