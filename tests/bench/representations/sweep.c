/* Going over sizes: 4, 8, 12 and 20 terms with 1, 5 and 10 clusters, both weights, as floats and quantised; and 1 to 12 terms
 * with a kernel each, of which some are fitted by the reference too. */
#include "sweep.h"

#include "bilinear.h"
#include "judge.h"

#include "../timing.h"

#include "factor/cross.h"
#include "study/plot.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TERMS_MOST = 12, LIMIT = 64 };

enum kind { PAPER, PAPER_RESPONSE, QUANTISED, QUANTISED_RESPONSE, TERMS, REFERENCE, KINDS };

static const char *const kind_names[] = {"paper",           "paper, weight response",
                                         "paper, 8 bits",   "paper, 8 bits, weight response",
                                         "kernel per term", "kernel per term, reference fit"};

struct result {
    enum kind kind;
    int terms, clusters;
    struct errors errors;
    double noise_free;
    size_t bytes, file;
};

struct results {
    struct result all[LIMIT];
    size_t count;
};

static void add(struct results *results, const struct sample *s, enum kind kind, int terms,
                int clusters, const struct fitted *fitted)
{
    struct result result = {.kind = kind,
                            .terms = terms,
                            .clusters = clusters,
                            .errors = judge_errors(s, fitted->model),
                            .noise_free =
                                judge_noise_free(s, s->exact ? fitted->model : fitted->of_kept),
                            .bytes = fitted->bytes,
                            .file = fitted->file};
    char size[32];
    (void)snprintf(size, sizeof size, kind >= TERMS ? "M %d" : "T %d, k %d", terms, clusters);
    printf("| %s | %s | %zu | %zu | %.4f | %.4f | %.4f |\n", kind_names[kind], size, result.bytes,
           result.file, result.errors.whole, result.errors.without_centre, result.noise_free);
    (void)fflush(stdout);
    results->all[results->count++] = result;
}

/* Both judges add the same pairs, one in double precision and one from scaled floats: 2^-24 of sums of like size. */
static void compare_judges(const struct sample *s, const struct nacre_material *kept)
{
    struct nacre_error error = {0};
    struct nacre_material copy = *kept; /* is read alone */
    struct cross_report report;
    struct fitted fitted = fitted_tell(s, &copy, NULL, 0);
    if (cross_judge(&s->responses, kept, &report, &error) != NACRE_OK) {
        fail(error.text);
    }
    if (fabs(report.error - judge_noise_free(s, fitted.model)) > 1e-5 * report.error) {
        fail("factor/cross.c and judge.c differ on the noise-free error");
    }
    fitted_finish(&fitted);
}

/* As floats, then quantised. */
static void add_paper(const struct bench *b, const struct sample *s, int terms, int clusters,
                      enum factor_weight weight, struct results *results)
{
    bool response = weight == FACTOR_WEIGHT_RESPONSE;
    struct factor_options options = fitted_paper(terms, clusters, weight);
    struct nacre_material full = fitted_material(b, s, false, &options), kept = {0};
    if (!s->exact) {
        kept = fitted_material(b, s, true, &options);
        compare_judges(s, &kept);
    }
    for (int bits = 0; bits <= FITTED_BITS; bits += FITTED_BITS) {
        struct fitted fitted = fitted_tell(s, &full, s->exact ? NULL : &kept, bits);
        enum kind kind = (enum kind)((bits ? QUANTISED : PAPER) + (response ? 1 : 0));
        add(results, s, kind, terms, clusters, &fitted);
        fitted_finish(&fitted);
    }
    nacre_material_finish(&full);
    nacre_material_finish(&kept);
}

/* By libfactor, as `nacre factor --model terms` stores it; judged as `nacre error --cross` does, after as many iterations. */
static void add_terms(const struct bench *b, const struct sample *s, int terms,
                      struct results *results)
{
    struct factor_options options = factor_options_default();
    options.model = FACTOR_MODEL_TERMS;
    options.clusters = 0;
    options.terms = terms;
    struct nacre_material full = fitted_material(b, s, false, &options), kept = {0};
    if (!s->exact) {
        options.iterations = full.iterations;
        options.tolerance = 0;
        kept = fitted_material(b, s, true, &options);
    }
    struct fitted fitted = fitted_tell(s, &full, s->exact ? NULL : &kept, 0);
    add(results, s, TERMS, terms, 0, &fitted);
    fitted_finish(&fitted);
    nacre_material_finish(&full);
    nacre_material_finish(&kept);
}

/* A reference fit in double precision, stored as bilinear_bytes counts: there is no file of it. */
static void add_reference(const struct sample *s, int terms, struct results *results)
{
    static const struct minimise_limits limits = {400, 5e-3};
    struct bilinear_form form = {.terms = terms, .radial = true};
    struct fitted fitted = {.model = NULL};
    for (int kept = 0; kept <= (s->exact ? 0 : 1); kept++) {
        struct entries entries;
        struct bilinear fit;
        float *model = allocate(sample_size(s) * sizeof *model);
        entries_make(s, kept ? s->kept_measured : s->measured, FACTOR_WEIGHT_RESPONSE, true,
                     &entries);
        bilinear_fit(&entries, form, 1, &limits, &fit);
        bilinear_quantise(&fit, FITTED_BITS);
        bilinear_predict(&fit, model);
        fitted.bytes = bilinear_bytes(&fit, FITTED_BITS);
        if (kept) {
            fitted.of_kept = model;
        } else {
            fitted.model = model;
        }
        bilinear_finish(&fit);
        entries_finish(&entries);
    }
    add(results, s, REFERENCE, terms, 0, &fitted);
    fitted_finish(&fitted);
}

/* The smallest file with a kernel per term whose noise-free error is at most that of the paper's 12 terms and 5 clusters, and
 * whether the goal is reached by the numbers' bytes. */
static bool print_goal(const struct sample *s, const struct results *results, enum kind kind)
{
    const struct result *paper = NULL, *best = NULL;
    double asked = s->channels == 3 ? 20 : 10;
    for (size_t i = 0; i < results->count; i++) {
        const struct result *r = &results->all[i];
        paper = r->kind == kind && r->terms == 12 && r->clusters == 5 ? r : paper;
    }
    for (size_t i = 0; i < results->count && paper; i++) {
        const struct result *r = &results->all[i];
        if (r->kind == TERMS && r->noise_free <= paper->noise_free &&
            (!best || r->file < best->file)) {
            best = r;
        }
    }
    if (!paper || !best) {
        printf("\n%s: no kernel per term holds the noise-free error of T 12, k 5 (%s), %.4f.\n",
               s->name, kind_names[kind], paper ? paper->noise_free : 0);
        return false;
    }
    printf(
        "\n%s: the noise-free error of T 12, k 5 (%s), %.4f, is held by M %d, %.4f, in 1/%.1f of "
        "the numbers' bytes and 1/%.1f of the file's; asked: 1/%.0f: %s.\n",
        s->name, kind_names[kind], paper->noise_free, best->terms, best->noise_free,
        (double)paper->bytes / (double)best->bytes, (double)paper->file / (double)best->file, asked,
        (double)paper->file >= asked * (double)best->file ? "reached" : "missed by the file");
    return (double)paper->bytes >= asked * (double)best->bytes;
}

static const char colours[REFERENCE][8] = {"#999999", "#c43c4e", "#c9a227", "#2a8a57", "#1a5e8c"};

/* The plot as a file of its own, with a legend below it. */
static void save(const char *path, const struct plot *plot)
{
    enum { LEGEND = 42 };
    char *text = NULL;
    size_t size = 0;
    FILE *memory = open_memstream(&text, &size), *file = fopen(path, "w");
    if (!memory || !file) {
        fail("cannot write the plot");
    }
    plot_write(memory, plot);
    if (fclose(memory) != 0 || strncmp(text, "<svg", 4) != 0) {
        fail("cannot write the plot");
    }
    (void)fprintf(file,
                  "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" "
                  "font-family=\"sans-serif\" font-size=\"11\">\n"
                  "<rect width=\"100%%\" height=\"100%%\" fill=\"#fff\"/>\n"
                  "<svg width=\"%d\" height=\"%d\"%s",
                  plot->width, plot->height + LEGEND, plot->width, plot->height,
                  text + strlen("<svg"));
    for (int kind = 0; kind < REFERENCE; kind++) {
        (void)fprintf(file, "<text x=\"%d\" y=\"%d\" fill=\"%s\">%s</text>\n", 52 + kind / 2 * 145,
                      plot->height + 14 + kind % 2 * 15, colours[kind], kind_names[kind]);
    }
    (void)fputs("</svg>\n", file);
    free(text);
    if (fclose(file) != 0) {
        fail("cannot write the plot");
    }
}

/* Noise-free error against the file's bytes: dots of the paper's model, a line of a kernel per term. */
static void write_plot(const struct bench *b, const struct sample *s, const struct results *results)
{
    double x[REFERENCE][LIMIT], y[REFERENCE][LIMIT];
    struct plot_series series[REFERENCE] = {{0}};
    char path[512], title[256];
    for (size_t i = 0; i < results->count; i++) {
        const struct result *r = &results->all[i];
        if (r->kind == REFERENCE) {
            continue; /* which have no file */
        }
        struct plot_series *line = &series[r->kind];
        x[r->kind][line->count] = (double)r->file / 1024;
        y[r->kind][line->count++] = r->noise_free;
    }
    for (int kind = 0; kind < REFERENCE; kind++) {
        series[kind].x = x[kind];
        series[kind].y = y[kind];
        series[kind].dots = kind != TERMS;
        (void)snprintf(series[kind].colour, sizeof series[kind].colour, "%s", colours[kind]);
    }
    (void)snprintf(title, sizeof title, "%s: noise-free error without the centre", s->name);
    (void)snprintf(path, sizeof path, "%s/representation-%s.svg", b->plots, s->name);
    struct plot plot = {.title = title,
                        .x_label = "KiB of the file",
                        .y_label = "error",
                        .x_log = true,
                        .y_log = true,
                        .width = 480,
                        .height = 320,
                        .series = series,
                        .series_count = REFERENCE};
    save(path, &plot);
}

bool sweep(const struct bench *b, const struct sample *s)
{
    bool reached = true;
    static const int terms[] = {4, 8, 12, 20}, clusters[] = {1, 5, 10};
    struct results results = {.count = 0};
    printf("\n### %s: %d x %d points, K %d, %d channel%s, noise off the centre %.4f%s\n\n", s->name,
           s->width, s->height, s->window, s->channels, s->channels > 1 ? "s" : "", judge_noise(s),
           s->exact ? "" : " (by reciprocal pairs)");
    printf("| model | size | bytes | file | error | without the centre | noise-free, without the "
           "centre |\n| --- | --- | --- | --- | --- | --- | --- |\n");
    for (int i = 0; i < 24; i++) {
        bool wanted = (!b->quick && !b->shaped) || (terms[i / 6] == 12 && clusters[i / 2 % 3] == 5);
        if (wanted) {
            add_paper(b, s, terms[i / 6], clusters[i / 2 % 3], (enum factor_weight)(i % 2),
                      &results);
        }
    }
    for (int m = 1; m <= TERMS_MOST; m += b->quick ? 3 : 1) {
        add_terms(b, s, m, &results);
    }
    if (!b->shaped) {
        add_reference(s, 4, &results);
    }
    if (!b->quick && !b->shaped) {
        add_reference(s, 8, &results);
    }
    for (enum kind kind = PAPER; kind <= PAPER_RESPONSE; kind++) {
        reached = print_goal(s, &results, kind) && reached;
    }
    if (b->plots) {
        write_plot(b, s, &results);
    }
    return reached;
}
