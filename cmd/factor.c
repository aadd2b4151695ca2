/* nacre factor: a scan to a material. */
#include "cmd/factor_print.h"
#include "cmd/verbs.h"
#include "factor/factorize.h"
#include "factor/words.h"

#include "nacre/whole_file.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct factor_settings {
    const char *output, *checkpoint, *from;
    int model, reciprocal, kernels, planes, bits;
    int window, method, weight, terms, clusters, iterations, kernel, store, responses, seed;
    double tolerance, error, within, epsilon, regularise, checkpoint_every;
    bool explain;
};

/* enum factor_method, and what the model has */
static const char *const method_words[] = {"hals", "mu", "auto", NULL};
enum { METHOD_AUTO = FACTOR_METHOD_MU + 1 };
static const char *const weight_words[] = {"kernel", "response", "auto",
                                           NULL}; /* enum factor_weight */
/* enum factor_model, and what the other options say */
static const char *const model_words[] = {"clusters", "terms", "auto", NULL};
enum { MODEL_AUTO = FACTOR_MODEL_TERMS + 1 };
static const char *const reciprocal_words[] = {"auto", "yes", "gains", "no",
                                               NULL}; /* enum terms_reciprocity */
static const char *const kernels_words[] = {"radial", "full", "auto",
                                            NULL}; /* enum factor_kernels */
static const char *const planes_words[] = {"shared", "separate", "auto",
                                           NULL}; /* enum factor_planes */
static const char *const bits_words[] = {"0", "2", "3", "4",  "5",    "6",
                                         "7", "8", "9", "10", "auto", NULL};
static const int bits_meant[] = {0, 2, 3, 4, 5, 6, 7, 8, 9, 10, FACTOR_BITS_AUTO};
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
     .writes = true,
     .sentence = "the material to write"},
    {.name = "model",
     .kind = OPTION_CHOICE,
     .words = model_words,
     .fallback = "auto",
     .offset = offsetof(struct factor_settings, model),
     .sentence =
         "what is fitted: the paper's kernels of clusters, or a kernel for each term; auto: "
         "terms, but clusters where --clusters, --method, --kernel max or --regularise, "
         "which are theirs, is given"},
    {.name = "reciprocal",
     .kind = OPTION_CHOICE,
     .words = reciprocal_words,
     .fallback = "auto",
     .offset = offsetof(struct factor_settings, reciprocal),
     .sentence =
         "with --model terms, whether light goes the same way forth and back, but for gains "
         "at both ends, or not; auto: as the scan's pairs show"},
    {.name = "kernels",
     .kind = OPTION_CHOICE,
     .words = kernels_words,
     .fallback = "auto",
     .offset = offsetof(struct factor_settings, kernels),
     .sentence =
         "with --model terms, whether kernels depend on the distance alone; auto: as fits of "
         "a piece of the scan are better at equal bytes; radial with --within"},
    {.name = "planes",
     .kind = OPTION_CHOICE,
     .words = planes_words,
     .fallback = "auto",
     .offset = offsetof(struct factor_settings, planes),
     .sentence =
         "with --model terms, whether all colour channels share the planes of a term; auto: "
         "as fits of a piece of the scan are better at equal bytes; shared with --within"},
    {.name = "bits",
     .kind = OPTION_CHOICE,
     .words = bits_words,
     .fallback = "auto",
     .offset = offsetof(struct factor_settings, bits),
     .sentence =
         "with --model terms, bits of a plane's values in the file, 0: half floats; auto: 8, "
         "10 or 0, the first whose rounding adds less than a quarter to the error; 8 with "
         "--within"},
    {.name = "method",
     .kind = OPTION_CHOICE,
     .words = method_words,
     .fallback = "auto",
     .offset = offsetof(struct factor_settings, method),
     .sentence =
         "how F and H of --model clusters are found: by extrapolated block coordinate descent "
         "(auto), or by the paper's multiplicative updates, which take many times longer"},
    {.name = "terms",
     .letter = 't',
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 1,
     .maximum = 1000,
     .offset = offsetof(struct factor_settings, terms),
     .sentence =
         "terms of the factorization: more follow smoother changes of the material; default 8, 12 "
         "with --model clusters, or as --error and --within need"},
    {.name = "clusters",
     .letter = 'k',
     .kind = OPTION_INT,
     .argument = "K",
     .minimum = 1,
     .maximum = 1000000,
     .offset = offsetof(struct factor_settings, clusters),
     .sentence =
         "kernels of --model clusters: about the number of different materials in the sample; "
         "default 5, or as --error and --within need"},
    {.name = "iterations",
     .letter = 'i',
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 1,
     .maximum = 10000000,
     .offset = offsetof(struct factor_settings, iterations),
     .sentence =
         "updates of F and H at most, with each choice of terms and clusters; default 1000, "
         "200 with --model clusters, or as --error and --within need"},
    {.name = "error",
     .kind = OPTION_REAL,
     .argument = "E",
     .minimum = 0,
     .maximum = 1,
     .fallback = "1",
     .offset = offsetof(struct factor_settings, error),
     .sentence = "find the smallest material whose mean relative error, as stored, is at most this "
                 "(0.02 or 2%); 1: any"},
    {.name = "within",
     .kind = OPTION_SECONDS,
     .argument = "TIME",
     .minimum = 0.001,
     .maximum = INFINITY,
     .offset = offsetof(struct factor_settings, within),
     .sentence =
         "be done in this time, reading and writing included, with as small an error as can "
         "be had; together with --error, stop trying by then"},
    {.name = "from",
     .kind = OPTION_STRING,
     .argument = "T/K/N,...",
     .offset = offsetof(struct factor_settings, from),
     .sentence = "start from a factorization of T terms and K clusters after N iterations, itself "
                 "started from the one named before it, and so on"},
    {.name = "window",
     .letter = 'w',
     .kind = OPTION_INT,
     .argument = "K",
     .minimum = 1,
     .maximum = 1023,
     .offset = offsetof(struct factor_settings, window),
     .sentence =
         "factor the middle K x K entries of each response, odd, and count the rest as error; "
         "default: all"},
    {.name = "tolerance",
     .kind = OPTION_REAL,
     .argument = "E",
     .minimum = 0,
     .maximum = 1,
     .fallback = "0.003",
     .offset = offsetof(struct factor_settings, tolerance),
     .sentence =
         "stop when an iteration, on average over five, lowers the objective by less than this "
         "share; 0: go on until nothing changes"},
    {.name = "kernel",
     .kind = OPTION_CHOICE,
     .words = kernel_words,
     .fallback = "average",
     .offset = offsetof(struct factor_settings, kernel),
     .sentence = "what a cluster's kernel is: its average or its largest response"},
    {.name = "weight",
     .kind = OPTION_CHOICE,
     .words = weight_words,
     .fallback = "auto",
     .offset = offsetof(struct factor_settings, weight),
     .sentence = "what errors are weighted by: the kernel, as in the paper, or the response's "
                 "norm, for the least relative errors; auto: the response's with --model terms"},
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
    {.name = "checkpoint",
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct factor_settings, checkpoint),
     .sentence =
         "keep the state of the run in this file, and go on from it if it is there; removed "
         "when the material is written"},
    {.name = "checkpoint-every",
     .kind = OPTION_SECONDS,
     .argument = "TIME",
     .minimum = 0,
     .maximum = INFINITY,
     .fallback = "1min",
     .offset = offsetof(struct factor_settings, checkpoint_every),
     .sentence = "time between two checkpoints; Ctrl-C writes one as well"},
    {.name = "explain",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct factor_settings, explain),
     .sentence = "say what is chosen and why, before and while it runs"},
    {.name = "seed",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = INT_MAX,
     .fallback = "0",
     .offset = offsetof(struct factor_settings, seed),
     .sentence = "the same seed gives the same material on the same device"},
    {0}};

static int check_output(const char *path, struct nacre_error *error)
{
    struct whole_file file = {0};
    int status = whole_file_create(&file, path, error);
    whole_file_discard(&file);
    return status;
}

static void print_line(void *data, const char *key, const char *text)
{
    (void)data;
    printf("%-26s %s\n", key, text);
    (void)fflush(stdout);
}

/* For --json: a list, as keys come more than once. A line lost to memory is no reason to stop. */
static void keep_line(void *data, const char *key, const char *text)
{
    (void)json_array_append_new(data, json_pack("{s:s, s:s}", "what", key, "why", text));
}

/* The option that belongs to the paper's model alone, or NULL. */
static const char *option_of_clusters(const struct factor_settings *s)
{
    return s->clusters > 0                ? "--clusters"
           : s->method != METHOD_AUTO     ? "--method"
           : s->kernel != KERNELS_AVERAGE ? "--kernel"
           : s->regularise > 0            ? "--regularise"
                                          : NULL;
}

static enum factor_model model_of(const struct factor_settings *s)
{
    return s->model != MODEL_AUTO  ? (enum factor_model)s->model
           : option_of_clusters(s) ? FACTOR_MODEL_CLUSTERS
                                   : FACTOR_MODEL_TERMS;
}

static void explain_model(const struct factor_settings *s, const struct listener *to)
{
    const char *option = option_of_clusters(s);
    bool shaped = model_of(s) == FACTOR_MODEL_TERMS;
    tell(to, "model", "%s, %s%s", shaped ? "a kernel for each term" : "kernels of clusters",
         s->model != MODEL_AUTO ? "as asked for"
         : shaped               ? "which takes the fewest bytes for its error"
                                : "because of ",
         s->model == MODEL_AUTO && !shaped ? option : "");
}

static struct factor_options to_options(const struct factor_settings *s)
{
    return (struct factor_options){
        .model = model_of(s),
        .reciprocity = (enum terms_reciprocity)s->reciprocal,
        .kernels = (enum factor_kernels)s->kernels,
        .planes = (enum factor_planes)s->planes,
        .bits = bits_meant[s->bits],
        .method = s->method == METHOD_AUTO ? FACTOR_METHOD_HALS : (enum factor_method)s->method,
        .weight = (enum factor_weight)s->weight,
        .terms = s->terms,
        .clusters = s->clusters,
        .iterations = s->iterations,
        .kernel = (enum kernels_kind)s->kernel,
        .tolerance = s->tolerance,
        .error = s->error,
        .seconds = s->within,
        .checkpoint = s->checkpoint,
        .checkpoint_seconds = s->checkpoint_every,
        .window = s->window,
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
        free(m->history_error);
        m->history_objective = m->history_seconds = m->history_error = NULL;
        m->history_count = 0;
    }
}

/* The last word on a material that was written: a wish that was not met is an error, but one that leaves a file. */
static int judge(int stopped, const struct nacre_material *m, const struct factor_summary *summary,
                 const struct factor_settings *s, struct nacre_error *error)
{
    if (stopped == NACRE_CANCELLED) {
        char limit[24] = "";
        if (s->iterations > 0) {
            (void)snprintf(limit, sizeof limit, " of %d", s->iterations);
        }
        (void)nacre_fail(error,
                         "stopped on request after %d%s iterations; %s holds the best so far%s%s",
                         m->iterations, limit, s->output,
                         s->checkpoint ? "; the same command goes on from " : "",
                         s->checkpoint ? s->checkpoint : "");
        return NACRE_CANCELLED;
    }
    if (!summary->error_held) {
        return nacre_fail(
            error,
            "could not reach a mean error of %.4g %%%s: the best was %.4g %% with %s, "
            "which %s holds",
            100 * s->error, strcmp(summary->stopped_by, "time") == 0 ? " in the time given" : "",
            100 * summary->error.whole.mean, size_words(m->terms, m->clusters).text, s->output);
    }
    return NACRE_OK;
}

/* The state of a run that is done is of no more use. */
static int remove_checkpoint(const struct factor_settings *s, struct nacre_error *error)
{
    if (s->checkpoint && unlink(s->checkpoint) != 0 && errno != ENOENT) {
        return nacre_fail_errno(error, errno, "cannot remove %s", s->checkpoint);
    }
    return NACRE_OK;
}

/* Find out before the work whether its results can be written. */
static int check_outputs(const struct factor_settings *s, struct nacre_error *error)
{
    int status = check_output(s->output, error);
    if (status == NACRE_OK && s->checkpoint && strcmp(s->checkpoint, s->output) == 0) {
        status = nacre_fail(error, "--checkpoint and --output both name %s", s->output);
    }
    return status == NACRE_OK && s->checkpoint ? check_output(s->checkpoint, error) : status;
}

/* A whole number above 0 and the character behind it, which *at is moved past; 0 where there is none. */
static int parse_count(const char **at, const char *separators)
{
    char *end = NULL;
    long value = strtol(*at, &end, 10);
    bool sound = end > *at && value >= 1 && value <= INT_MAX && strchr(separators, *end);
    *at = end + (*end != '\0');
    return sound ? (int)value : 0;
}

/* "4/5/10,8/5/10", in order. */
static int parse_stages(const char *text, struct factor_stage stages[FACTOR_STAGES], int *count,
                        struct nacre_error *error)
{
    const char *at = text;
    bool sound = true;
    *count = 0;
    while (at && sound && (*at || *count == 0)) {
        struct factor_stage *stage = &stages[*count];
        stage->terms = parse_count(&at, "/");
        stage->clusters = stage->terms > 0 ? parse_count(&at, "/") : 0;
        stage->iterations = stage->clusters > 0 ? parse_count(&at, ",") : 0;
        (*count)++;
        sound = stage->iterations > 0 && (*count < FACTOR_STAGES || !*at);
    }
    if (!sound) {
        (void)nacre_fail(error,
                         "--from %s: give at most %d stages as TERMS/CLUSTERS/ITERATIONS, with "
                         "commas between them, such as 4/5/10,8/5/10",
                         text, FACTOR_STAGES);
        return OPTIONS_WRONG_USAGE;
    }
    return NACRE_OK;
}

static int factor_run(const void *settings, const struct invocation *invocation,
                      struct nacre_error *error)
{
    const struct factor_settings *s = settings;
    struct factor_options options = to_options(s);
    struct clock clock = clock_monotonic();
    struct nacre_scan *scan = NULL;
    struct opencl opencl = {0};
    struct nacre_material material = {0};
    struct factor_summary summary = {0};
    json_t *explained = s->explain && invocation->json ? json_array() : NULL;
    struct progress progress = progress_begin("factoring", invocation->quiet);
    struct factor_stage stages[FACTOR_STAGES] = {{0}};
    int stopped = NACRE_OK;
    options.stages = stages;
    options.clock = &clock;
    options.begun_ns = clock_now_ns(&clock);
    if (s->explain) {
        options.listener = (struct listener){explained ? keep_line : print_line, explained};
        explain_model(s, &options.listener);
    }
    int status = parse_stages(s->from, stages, &options.stage_count, error);
    if (status == NACRE_OK) {
        status = nacre_scan_open(invocation->operands[0], &scan, error);
    }
    if (status == NACRE_OK) {
        status = check_outputs(s, error);
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
    if (status == NACRE_OK && stopped == NACRE_OK) {
        status = remove_checkpoint(s, error);
    }
    if (status == NACRE_OK) {
        status = factor_print(&material, &summary, &opencl, s->output, invocation->json, explained,
                              error);
    }
    if (status == NACRE_OK) {
        status = judge(stopped, &material, &summary, s, error);
    }
    json_decref(explained);
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
    .text = "The model has a kernel for each term: R_d(x_i, x_o) ~ sum over terms t of F(x_i, t) "
            "g_t(x_o - x_i) H(t, x_o), and at x_i itself a number of its own; H is F where light "
            "goes the same way forth and back. With --model clusters it is that of Peers et al. "
            "2006, section 5: R_d(x_i, x_o) ~ (sum over terms of F(x_i, t) H(t, x_o)) times the "
            "kernel g(x_o - x_i) of x_i's cluster; responses are clustered by how they fall off "
            "with distance, and the kernels are the clusters' average responses. All is found "
            "step by step on an OpenCL device.\n\n"
            "Entries and responses that were not measured weigh nothing; points without any "
            "measurement take their numbers from their neighbours. Ctrl-C during the iterations "
            "writes the best material so far.\n\n"
            "With --error or --within, the terms, clusters and iterations that are not given are "
            "chosen, and what was tried is printed as a table. When the error asked for cannot be "
            "reached, the best material that was found is written and the exit status is 1.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = factor_options,
    .settings_size = sizeof(struct factor_settings),
    .run = factor_run,
};
