/* nacre factor: a scan to a material. */
#include "cmd/error_print.h"
#include "cmd/json_print.h"
#include "cmd/verbs.h"
#include "factor/factorize.h"

#include "nacre/whole_file.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>

struct factor_settings {
    const char *output;
    int method, terms, clusters, iterations, kernel, store, responses, seed;
    double tolerance, epsilon, regularise;
};

static const char *const method_words[] = {"hals", "mu", NULL};           /* enum factor_method */
static const char *const kernel_words[] = {"average", "max", NULL};       /* enum kernels_kind */
static const char *const store_words[] = {"auto", "float", "half", NULL}; /* enum factor_store */

static const char *const responses_words[] = {"auto", "float", "half",
                                              NULL}; /* enum responses_store */

static const struct option_spec factor_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .required = true,
     .offset = offsetof(struct factor_settings, output),
     .sentence = "the material to write"},
    {.name = "method",
     .kind = OPTION_CHOICE,
     .words = method_words,
     .fallback = "hals",
     .offset = offsetof(struct factor_settings, method),
     .sentence =
         "how F and H are found: by extrapolated block coordinate descent, or by the paper's "
         "multiplicative updates, which take many times longer"},
    {.name = "terms",
     .letter = 't',
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 1,
     .maximum = 1000,
     .fallback = "12",
     .offset = offsetof(struct factor_settings, terms),
     .sentence = "terms of the factorization: more follow smoother changes of the material"},
    {.name = "clusters",
     .letter = 'k',
     .kind = OPTION_INT,
     .argument = "K",
     .minimum = 1,
     .maximum = 1000000,
     .fallback = "5",
     .offset = offsetof(struct factor_settings, clusters),
     .sentence = "kernels: about the number of different materials in the sample"},
    {.name = "iterations",
     .letter = 'i',
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 1,
     .maximum = 10000000,
     .fallback = "200",
     .offset = offsetof(struct factor_settings, iterations),
     .sentence = "updates of F and H at most"},
    {.name = "tolerance",
     .kind = OPTION_REAL,
     .argument = "E",
     .minimum = 0,
     .maximum = 1,
     .fallback = "0.003",
     .offset = offsetof(struct factor_settings, tolerance),
     .sentence =
         "stop when an iteration, on average over five, lowers the objective by less than this "
         "share; 0: go on to the last"},
    {.name = "kernel",
     .kind = OPTION_CHOICE,
     .words = kernel_words,
     .fallback = "average",
     .offset = offsetof(struct factor_settings, kernel),
     .sentence = "what a cluster's kernel is: its average or its largest response"},
    {.name = "epsilon",
     .kind = OPTION_REAL,
     .argument = "E",
     .minimum = 1e-12,
     .maximum = 1,
     .fallback = "1e-5",
     .offset = offsetof(struct factor_settings, epsilon),
     .sentence = "added to each kernel, relative to its maximum"},
    {.name = "regularise",
     .kind = OPTION_REAL,
     .argument = "A",
     .minimum = 0,
     .maximum = 0.1,
     .fallback = "0",
     .offset = offsetof(struct factor_settings, regularise),
     .sentence =
         "with --method mu, sparser factors: each update is raised to the power 1 + A (try 0.001)"},
    {.name = "store",
     .kind = OPTION_CHOICE,
     .words = store_words,
     .fallback = "auto",
     .offset = offsetof(struct factor_settings, store),
     .sentence = "how F and H are stored; auto: as half floats if the error stays as it is"},
    {.name = "responses",
     .kind = OPTION_CHOICE,
     .words = responses_words,
     .fallback = "auto",
     .offset = offsetof(struct factor_settings, responses),
     .sentence =
         "how responses are held while factoring: half floats take half the memory; auto: as "
         "the scan has them"},
    {.name = "seed",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = INT_MAX,
     .fallback = "0",
     .offset = offsetof(struct factor_settings, seed),
     .sentence = "the same seed gives the same material on the same device"},
    {0}};

/* Find out before the work whether its result can be written. */
static int check_output(const char *path, struct nacre_error *error)
{
    struct whole_file file = {0};
    int status = whole_file_create(&file, path, error);
    whole_file_discard(&file);
    return status;
}

static void print_text(const struct nacre_material *m, const struct factor_summary *s,
                       const struct opencl *opencl, const char *path)
{
    printf("%-26s %s on %s: %d terms, %d clusters, %d iterations\n", "method", m->method,
           opencl->name, m->terms, m->clusters, m->iterations);
    printf("%-26s %.2f s (reading %.2f s, clustering %.2f s, iterating %.2f s, measuring %.2f s)\n",
           "time",
           s->seconds_reading + s->seconds_clustering + s->seconds_iterating + s->seconds_measuring,
           s->seconds_reading, s->seconds_clustering, s->seconds_iterating, s->seconds_measuring);
    printf("%-26s %.6g\n", "objective", s->objective);
    printf("%-26s %s\n", "stored as", m->pixel == NACRE_HALF ? "half floats" : "floats");
    error_print(&s->error, m, path);
}

static json_t *to_json(const struct nacre_material *m, const struct factor_summary *s,
                       const struct opencl *opencl, const char *path)
{
    json_t *object = error_to_json(&s->error, m, path);
    json_t *rest =
        json_pack("{s:s, s:s, s:s, s:i, s:i, s:i, s:f, s:s, s:f, s:f, s:f, s:f}", "output", path,
                  "method", m->method, "device", opencl->name, "terms", m->terms, "clusters",
                  m->clusters, "iterations", m->iterations, "objective", s->objective, "stored",
                  m->pixel == NACRE_HALF ? "half" : "float", "seconds_reading", s->seconds_reading,
                  "seconds_clustering", s->seconds_clustering, "seconds_iterating",
                  s->seconds_iterating, "seconds_measuring", s->seconds_measuring);
    if (!object || !rest || json_object_update(rest, object) != 0) {
        json_decref(rest);
        rest = NULL;
    }
    json_decref(object);
    return rest;
}

static int print_result(const struct nacre_material *m, const struct factor_summary *summary,
                        const struct opencl *opencl, const char *path, bool json,
                        struct nacre_error *error)
{
    if (json) {
        return json_print(to_json(m, summary, opencl, path), error);
    }
    print_text(m, summary, opencl, path);
    return NACRE_OK;
}

static struct factor_options to_options(const struct factor_settings *s)
{
    return (struct factor_options){.method = (enum factor_method)s->method,
                                   .terms = s->terms,
                                   .clusters = s->clusters,
                                   .iterations = s->iterations,
                                   .kernel = (enum kernels_kind)s->kernel,
                                   .tolerance = s->tolerance,
                                   .epsilon = s->epsilon,
                                   .store = (enum factor_store)s->store,
                                   .responses = (enum responses_store)s->responses,
                                   .seed = s->seed,
                                   .regularise = s->regularise};
}

/* The history tells seconds, which differ from run to run; where outputs are to be reproducible it is left out. */
static void leave_out_times(struct nacre_material *m)
{
    if (getenv("SOURCE_DATE_EPOCH")) {
        free(m->history_objective);
        free(m->history_seconds);
        m->history_objective = m->history_seconds = NULL;
        m->history_count = 0;
    }
}

static int factor_run(const void *settings, const struct invocation *invocation,
                      struct nacre_error *error)
{
    const struct factor_settings *s = settings;
    struct factor_options options = to_options(s);
    struct nacre_scan *scan = NULL;
    struct opencl opencl = {0};
    struct nacre_material material = {0};
    struct factor_summary summary = {0};
    struct progress progress = progress_begin("factoring", invocation->quiet);
    int stopped = NACRE_OK;
    int status = nacre_scan_open(invocation->operands[0], &scan, error);
    if (status == NACRE_OK) {
        status = check_output(s->output, error);
    }
    if (status == NACRE_OK) {
        status = opencl_open(invocation->device, &opencl, error);
    }
    if (status == NACRE_OK) {
        stopped = factorize(scan, &options, &opencl, &progress, &material, &summary, error);
        status = stopped == NACRE_CANCELLED && material.f ? NACRE_OK : stopped;
    }
    progress_end(&progress);
    if (status == NACRE_OK) {
        leave_out_times(&material);
        status = nacre_material_write(s->output, &material, error);
    }
    if (status == NACRE_OK) {
        status = print_result(&material, &summary, &opencl, s->output, invocation->json, error);
    }
    if (status == NACRE_OK && stopped == NACRE_CANCELLED) {
        (void)nacre_fail(error,
                         "stopped on request after %d of %d iterations; %s holds the best so far",
                         material.iterations, s->iterations, s->output);
        status = NACRE_CANCELLED;
    }
    factor_summary_finish(&summary);
    nacre_material_finish(&material);
    opencl_close(&opencl);
    nacre_scan_close(scan);
    return status;
}

const struct verb verb_factor = {
    .name = "factor",
    .operands = "SCAN -o MATERIAL",
    .summary = "factor a scan's responses into a compact material",
    .text = "The model is that of Peers et al. 2006, section 5: R_d(x_i, x_o) ~ (sum over terms of "
            "F(x_i, t) H(t, x_o)) times the kernel g(x_o - x_i) of x_i's cluster. Responses are "
            "clustered by how they fall off with distance, the kernels are the clusters' average "
            "responses, and F and H are found by multiplicative updates on an OpenCL device.\n\n"
            "Entries and responses that were not measured weigh nothing; points without any "
            "measurement take F, H and cluster from their neighbours. Ctrl-C during the iterations "
            "writes the material as it is by then.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = factor_options,
    .settings_size = sizeof(struct factor_settings),
    .run = factor_run,
};
