/* Seconds per step of the model with a kernel per term against OpenBLAS's sgemm, each kernel's part of them, and seconds
 * until a run settles, at the paper's sizes. */
#include "cases.h"
#include "profile.h"
#include "timing.h"

#include "factor/layout.h"
#include "factor/terms.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    WARM = 6,    /* steps before any is timed: the first make all normal matrices afresh */
    ROUNDS = 12, /* a multiple of the steps from one such to the next */
    MOST_STEPS = 1000,
    PATIENCE = 5 /* as in iterate.c */
};

#define TOLERANCE 3e-3

struct sample {
    const char *name;
    enum field_kind kind;
    int width, height, window, channels, terms;
};

static const struct sample samples[] = {
    {"small", FIELD_CANDLE, 64, 48, 25, 1, 8},
    {"small", FIELD_CANDLE, 64, 48, 25, 3, 8},
    {"candle", FIELD_CANDLE, 212, 154, 49, 1, 8},
    {"candle", FIELD_CANDLE, 212, 154, 49, 3, 8},
    {"marble 4x4", FIELD_MARBLE, 277, 277, 39, 1, 8},
    {"marble 4x4", FIELD_MARBLE, 277, 277, 39, 1, 12},
};

enum { SAMPLES = sizeof samples / sizeof *samples };

/* A sample's responses and what a step needs of them. */
struct made {
    struct responses responses;
    struct terms_data data;
    struct attempt attempt;
    struct method *method;
};

/* Unless with `bursts` each step visits all entries, and is one. */
static void make(const struct sample *s, const struct opencl *opencl, bool bursts,
                 struct made *made)
{
    const struct factor_options options = factor_options_default();
    const struct terms_options how = {0};
    struct field field = field_new(s->kind, s->width, s->height, s->window, s->channels, CASE_SEED);
    struct factor_prepared prepared = {0};
    struct nacre_error error = {0};
    *made = (struct made){.responses = field_load(&field, layout_lanes(opencl), true)};
    field_finish(&field);
    if (terms_data_begin(&made->data, &made->responses, &how, options.epsilon, &error) !=
        NACRE_OK) {
        fail(error.text);
    }
    if (!bursts) {
        made->data.reach = s->window / 2;
    }
    if (features_new(&made->responses, &prepared.features, &error) != NACRE_OK ||
        attempt_begin(&made->attempt, &made->responses, &prepared, &made->data, &options, s->terms,
                      1, &error) != NACRE_OK ||
        terms_new(opencl, &made->attempt.problem, &made->method, &error) != NACRE_OK ||
        !made->method) {
        fail(error.text);
    }
    factor_prepared_finish(&prepared);
}

static void finish(struct made *made)
{
    method_free(made->method);
    attempt_finish(&made->attempt);
    terms_data_finish(&made->data);
    responses_finish(&made->responses);
}

/* One step of all channels; returns the objective before it, in the responses' own unit. */
static double advance(struct made *made)
{
    struct nacre_error error = {0};
    double sum = 0;
    for (int c = 0; c < made->responses.channels; c++) {
        double part = 0;
        if (made->method->ops->step(made->method, c, &part, &error) != NACRE_OK) {
            fail(error.text);
        }
        sum += ldexp(part, made->responses.exponent[c]);
    }
    return sum;
}

/* What a step cannot do without. Of each entry and channel 5 M: g times the other end's values, the model, the gradient.
 * Of each pair of points that is one number, half as many, 3 M a channel for the right side of the kernels' equations and
 * 2 for each pair of terms, for all channels together. Normal matrices of points are not counted. */
static double useful_flops(const struct sample *s)
{
    double m = s->terms, pairs = m * (m + 1) / 2;
    return entries_inside(s->width, s->height, s->window) *
           (s->channels * (5 * m + 1.5 * m) + pairs);
}

static void print_kernels(const struct profile *profile, int steps)
{
    double total = 0;
    for (int i = 0; i < profile->count; i++) {
        total += profile->kernels[i].seconds;
    }
    for (int i = 0; i < profile->count; i++) {
        const struct profile_kernel *k = &profile->kernels[i];
        printf("    %-12s %8.4f s a step  %5.1f %%\n", k->name, k->seconds / steps,
               100 * k->seconds / total);
    }
}

/* Steps and sgemm in turns, so that both meet the same load. */
static void time_steps(const struct sample *s, struct made *made)
{
    struct sgemm sgemm = sgemm_new();
    double wall[ROUNDS], products[ROUNDS], flops = 2 * pow(SGEMM_SIZE, 3);
    struct moment all = {0};
    (void)sgemm_run(&sgemm);
    profile_clear();
    for (int i = 0; i < ROUNDS; i++) {
        products[i] = sgemm_run(&sgemm).processor;
        profile_count(true);
        struct moment start = timing_now();
        (void)advance(made);
        (void)profile_read(); /* waits until it is done */
        struct moment taken = timing_since(start);
        profile_count(false);
        wall[i] = taken.wall;
        all.processor += taken.processor / ROUNDS;
    }
    struct profile profile = profile_read();
    double rate = flops / timing_median(products, ROUNDS);
    double entries = entries_inside(s->width, s->height, s->window) * s->channels;
    printf("%-10s %4d x %-4d K %2d M %2d channels %d  %8.4f s/step  %8.4f processor s, %.2f ns an "
           "entry and channel  %5.1f GF/s a processor second, sgemm %5.1f: %5.1f %%\n",
           s->name, s->width, s->height, s->window, s->terms, s->channels,
           timing_median(wall, ROUNDS), all.processor, all.processor / entries * 1e9,
           useful_flops(s) / all.processor * 1e-9, rate * 1e-9,
           100 * useful_flops(s) / all.processor / rate);
    print_kernels(&profile, ROUNDS);
    (void)fflush(stdout);
    sgemm_finish(&sgemm);
}

/* As in iterate.c: five steps and the later half of all, in multiples of the tolerance. */
#define VALLEY 15

/* From the start until a run settles. */
static void settle(const struct sample *s, const struct opencl *opencl)
{
    struct made made;
    double objective[MOST_STEPS + 1];
    int steps = 0;
    make(s, opencl, true, &made);
    profile_clear();
    profile_count(true);
    struct moment start = timing_now();
    for (bool settled = false; !settled && steps < MOST_STEPS; steps++) {
        objective[steps] = advance(&made);
        settled = steps > PATIENCE &&
                  objective[steps] >= (1 - PATIENCE * TOLERANCE) * objective[steps - PATIENCE] &&
                  objective[steps] >= (1 - VALLEY * TOLERANCE) * objective[steps / 2];
    }
    struct moment taken = timing_since(start);
    profile_count(false);
    struct profile profile = profile_read();
    printf("    settles after %d steps at %.6g: %.2f s, %.2f processor s\n", steps,
           objective[steps - 1], taken.wall, taken.processor);
    print_kernels(&profile, steps);
    (void)fflush(stdout);
    finish(&made);
}

static void run(const struct sample *s, const struct opencl *opencl)
{
    struct made made;
    make(s, opencl, false, &made);
    for (int i = 0; i < WARM; i++) {
        (void)advance(&made);
    }
    time_steps(s, &made);
    finish(&made);
    settle(s, opencl);
}

/* Arguments: --terms M for another number of terms; numbers of the samples, from 0, none for all. */
int main(int argc, char **argv)
{
    struct nacre_error error = {0};
    struct opencl opencl;
    bool wanted[SAMPLES] = {false}, any = false;
    int terms = 0;
    for (int i = 1; i < argc; i++) {
        long value = strtol(argv[i], NULL, 10);
        if (strcmp(argv[i], "--terms") == 0 && i + 1 < argc) {
            terms = (int)strtol(argv[++i], NULL, 10);
        } else if (value >= 0 && value < SAMPLES) {
            wanted[value] = any = true;
        } else {
            fail("usage: bench_terms [--terms M] [NUMBER OF A SAMPLE ...]");
        }
    }
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        (void)fprintf(stderr, "SKIP: %s\n", error.text);
        return 77;
    }
    printf("%s, %u compute units\n", opencl.name, opencl.compute_units);
    for (int i = 0; i < SAMPLES; i++) {
        struct sample sample = samples[i];
        sample.terms = terms > 0 ? terms : sample.terms;
        if (!any || wanted[i]) {
            run(&sample, &opencl);
        }
    }
    opencl_close(&opencl);
    return EXIT_SUCCESS;
}
