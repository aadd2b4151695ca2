/* Compares representations of responses by their error and their bytes: the paper's model, plain and quantised, by both
 * weights; the same with soft weights; and the reciprocal forms, a kernel per term, kernels of pairs, the squared link.
 * What is measured and what came out: docs/representation.md. */
#include "bilinear.h"
#include "fitted.h"
#include "judge.h"
#include "soft.h"
#include "sweep.h"

#include "../timing.h"

#include "factor/layout.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char usage[] =
    "usage: representations [--nacre PROGRAM] [--sweep] [--quick] [--shaped] "
    "[--points N] SAMPLE.yaml|SCAN.exr ...";

static const char *const weight_names[] = {"kernel", "response"};

/* Fits end when 20 steps lower the objective by less than half a per cent. */
static const struct minimise_limits reference = {400, 5e-3};

static void print_head(const struct sample *s)
{
    printf("\n### %s: %d x %d points, K %d, %d channel%s, noise off the centre %.4f%s\n\n", s->name,
           s->width, s->height, s->window, s->channels, s->channels > 1 ? "s" : "", judge_noise(s),
           s->exact ? "" : " (by reciprocal pairs)");
    printf("| representation | numbers | weight | bytes | error | without the centre | noise-free, "
           "without the centre | steps, s |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n");
}

/* One row. `of_kept` models the kept ones; NULL where the exact response is known. */
static void print_row(const struct sample *s, const char *what, const char *numbers,
                      enum factor_weight weight, size_t bytes, const float *model,
                      const float *of_kept, int steps, double seconds)
{
    struct errors errors = judge_errors(s, model);
    printf("| %s | %s | %s | %zu | %.4f | %.4f | %.4f | %d, %.1f |\n", what, numbers,
           weight_names[weight], bytes, errors.whole, errors.without_centre,
           judge_noise_free(s, s->exact ? model : of_kept), steps, seconds);
    (void)fflush(stdout);
}

/* Bytes as docs/representation.md counts them here: planes at `bits` a number (0: floats), kernels as half floats (floats),
 * a hard label one. */
static size_t count_bytes(const struct nacre_material *m, int bits)
{
    size_t points = (size_t)m->width * (size_t)m->height;
    size_t planes = (size_t)m->terms * (size_t)m->factor_channels * (m->h ? 2 : 1);
    size_t kernels = (size_t)nacre_material_kernel_count(m) * (size_t)m->channels *
                     (size_t)m->window * (size_t)m->window;
    planes += m->mixed > 1 ? (size_t)m->mixed : 0;
    return (planes * points * (size_t)(bits ? bits : 32) + 7) / 8 + kernels * (bits ? 2 : 4) +
           (m->mixed == 1 ? points : 0);
}

/* Rows of one or two materials: as floats and quantised. */
static void print_materials(const struct sample *s, const char *what, enum factor_weight weight,
                            struct nacre_material *full, struct nacre_material *kept,
                            double seconds)
{
    for (int bits = 0; bits <= FITTED_BITS; bits += FITTED_BITS) {
        char name[64], numbers[64];
        struct fitted fitted = fitted_tell(s, full, s->exact ? NULL : kept, bits);
        (void)snprintf(name, sizeof name, "%s, T %d, k %d", what, full->terms, full->clusters);
        (void)snprintf(numbers, sizeof numbers, bits ? "%d bits" : "floats", bits);
        print_row(s, name, numbers, weight, count_bytes(full, bits), fitted.model, fitted.of_kept,
                  fitted.steps, seconds);
        fitted_finish(&fitted);
    }
}

static void paper(const struct bench *b, const struct sample *s, int terms, int clusters,
                  enum factor_weight weight)
{
    struct factor_options options = fitted_paper(terms, clusters, weight);
    struct nacre_material kept = {0};
    struct moment begun = timing_now();
    struct nacre_material full = fitted_material(b, s, false, &options);
    double seconds = timing_since(begun).processor;
    if (!s->exact) {
        kept = fitted_material(b, s, true, &options);
    }
    print_materials(s, "paper", weight, &full, &kept, seconds);
    nacre_material_finish(&kept);
    nacre_material_finish(&full);
}

/* Fit soft weights from where the hard ones ended. */
static struct nacre_material soften(const struct bench *b, const struct sample *s, bool kept,
                                    int terms, int clusters, enum factor_weight weight)
{
    struct factor_options options = fitted_paper(terms, clusters, weight);
    struct nacre_material hard = fitted_material(b, s, kept, &options), soft;
    struct entries entries;
    entries_make(s, kept ? s->kept_measured : s->measured, weight, false, &entries);
    int steps = soft_fit(&entries, &hard, &reference, &soft);
    soft.iterations = steps;
    entries_finish(&entries);
    nacre_material_finish(&hard);
    return soft;
}

static void softened(const struct bench *b, const struct sample *s, int terms, int clusters,
                     enum factor_weight weight)
{
    struct nacre_material kept = {0};
    struct moment begun = timing_now();
    struct nacre_material full = soften(b, s, false, terms, clusters, weight);
    double seconds = timing_since(begun).processor;
    if (!s->exact) {
        kept = soften(b, s, true, terms, clusters, weight);
    }
    print_materials(s, "paper, soft weights", weight, &full, &kept, seconds);
    nacre_material_finish(&kept);
    nacre_material_finish(&full);
}

static void form_fit(const struct sample *s, bool kept, struct bilinear_form form,
                     enum factor_weight weight, struct bilinear *fit)
{
    struct entries entries;
    entries_make(s, kept ? s->kept_measured : s->measured, weight, true, &entries);
    bilinear_fit(&entries, form, 1, &reference, fit);
    entries_finish(&entries);
}

static void reciprocal(const struct sample *s, const char *what, struct bilinear_form form,
                       enum factor_weight weight)
{
    struct bilinear full, kept = {0};
    char name[64], numbers[64];
    float *model = allocate(sample_size(s) * sizeof *model), *of_kept = NULL;
    struct moment begun = timing_now();
    form_fit(s, false, form, weight, &full);
    double seconds = timing_since(begun).processor;
    bilinear_quantise(&full, FITTED_BITS);
    bilinear_predict(&full, model);
    if (!s->exact) {
        of_kept = allocate(sample_size(s) * sizeof *of_kept);
        form_fit(s, true, form, weight, &kept);
        bilinear_quantise(&kept, FITTED_BITS);
        bilinear_predict(&kept, of_kept);
    }
    (void)snprintf(name, sizeof name, "%s, M %d, %s", what, form.terms,
                   form.radial ? "radial" : "half windows");
    (void)snprintf(numbers, sizeof numbers, "%d bits", FITTED_BITS);
    print_row(s, name, numbers, weight, bilinear_bytes(&full, FITTED_BITS), model, of_kept,
              full.iterations, seconds);
    bilinear_finish(&full);
    bilinear_finish(&kept);
    free(model);
    free(of_kept);
}

/* Everything against everything, at a few sizes. */
static bool compare(const struct bench *b, const struct sample *s)
{
    enum factor_weight kernel = FACTOR_WEIGHT_KERNEL, response = FACTOR_WEIGHT_RESPONSE;
    print_head(s);
    paper(b, s, 4, 5, response);
    for (enum factor_weight weight = kernel; weight <= response; weight++) {
        paper(b, s, 12, 5, weight);
        if (!b->quick) {
            softened(b, s, 4, 5, weight);
            reciprocal(s, "kernel per term", (struct bilinear_form){8, false, false, true}, weight);
        }
    }
    if (b->quick) {
        softened(b, s, 4, 5, response);
        reciprocal(s, "kernel per term", (struct bilinear_form){8, false, false, true}, response);
    }
    reciprocal(s, "kernel per term", (struct bilinear_form){4, false, false, true}, response);
    reciprocal(s, "kernel per term", (struct bilinear_form){8, false, false, false}, response);
    reciprocal(s, "kernels of pairs", (struct bilinear_form){4, true, false, true}, response);
    reciprocal(s, "squared link", (struct bilinear_form){4, true, true, true}, response);
    if (!b->quick) {
        softened(b, s, 12, 5, response);
        reciprocal(s, "kernels of pairs", (struct bilinear_form){4, true, false, false}, response);
        reciprocal(s, "squared link", (struct bilinear_form){6, true, true, true}, response);
    }
    return true; /* it only tells */
}

static bool ends_with(const char *text, const char *end)
{
    size_t length = strlen(text), tail = strlen(end);
    return length >= tail && strcmp(text + length - tail, end) == 0;
}

int main(int argc, char **argv)
{
    struct nacre_error error = {0};
    struct bench bench = {.points = SAMPLE_ALL};
    bool (*study)(const struct bench *, const struct sample *) = compare;
    bool good = true;
    int first = 1;
    for (; first < argc && argv[first][0] == '-'; first++) {
        if (strcmp(argv[first], "--nacre") == 0 && first + 1 < argc) {
            bench.nacre = argv[++first];
        } else if (strcmp(argv[first], "--sweep") == 0) {
            study = sweep;
        } else if (strcmp(argv[first], "--quick") == 0) {
            bench.quick = true;
        } else if (strcmp(argv[first], "--shaped") == 0) {
            bench.shaped = true;
        } else if (strcmp(argv[first], "--points") == 0 && first + 1 < argc) {
            bench.points = (int)strtol(argv[++first], NULL, 10);
        } else if (strcmp(argv[first], "--plots") == 0 && first + 1 < argc) {
            bench.plots = argv[++first];
        } else {
            fail(usage);
        }
    }
    if (first == argc || bench.points < 1) {
        fail(usage);
    }
    if (opencl_open(NULL, &bench.opencl, &error) != NACRE_OK) {
        fail(error.text);
    }
    for (int i = first; i < argc; i++) {
        struct sample sample;
        bool described = ends_with(argv[i], ".yaml");
        if (described && !bench.nacre) {
            fail("a described sample wants --nacre PROGRAM to simulate it");
        }
        if (described) {
            sample_simulate(bench.nacre, argv[i], layout_lanes(&bench.opencl), bench.points,
                            &sample);
        } else {
            sample_read(argv[i], layout_lanes(&bench.opencl), bench.points, &sample);
        }
        good = study(&bench, &sample) && good;
        sample_finish(&sample);
    }
    opencl_close(&bench.opencl);
    return good ? EXIT_SUCCESS : EXIT_FAILURE;
}
