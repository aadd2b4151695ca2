/* nacre tradeoff: what accuracy costs in seconds and bytes, on one scan. */
#include "study/tradeoff.h"
#include "cmd/json_print.h"
#include "cmd/verbs.h"
#include "factor/layout.h"
#include "study/tradeoff_front.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <unistd.h>

struct tradeoff_settings {
    const char *output;
    double budget;
    int seed;
};

static const struct option_spec tradeoff_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "FOLDER",
     .required = true,
     .offset = offsetof(struct tradeoff_settings, output),
     .sentence = "the folder to write tradeoff.csv, tradeoff.json and tradeoff.html to"},
    {.name = "budget",
     .kind = OPTION_SECONDS,
     .argument = "TIME",
     .minimum = 0.001,
     .maximum = INFINITY,
     .fallback = "5min",
     .offset = offsetof(struct tradeoff_settings, budget),
     .sentence = "time for all of it; what is found in less ends it"},
    {.name = "seed",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = INT_MAX,
     .fallback = "0",
     .offset = offsetof(struct tradeoff_settings, seed),
     .sentence = "of all factorizations"},
    {0}};

static int print_front(const struct tradeoff *t, const struct tradeoff_request *request,
                       enum tradeoff_cost cost, struct nacre_error *error)
{
    int indices[TRADEOFF_POINTS];
    int count = tradeoff_front(t, cost, indices);
    printf("%s\n%9s %9s %10s  %s\n",
           cost == TRADEOFF_SECONDS ? "as exact as can be for the seconds"
                                    : "as exact as can be for the bytes",
           "error", "seconds", "KiB", "command");
    for (int i = 0; i < count; i++) {
        const struct tradeoff_point *p = &t->points[indices[i]];
        char *command = tradeoff_command(t, request, p);
        if (!command) {
            return nacre_fail_memory(error, "the table");
        }
        printf("%7.3f %% %9.3g %10.4g  %s\n", 100 * p->error, p->seconds, p->bytes / 1024, command);
        free(command);
    }
    return NACRE_OK;
}

static int print_result(const struct tradeoff *t, const struct tradeoff_request *request, bool json,
                        struct nacre_error *error)
{
    if (json) {
        return json_print(tradeoff_to_json(t, request), error);
    }
    int status = print_front(t, request, TRADEOFF_SECONDS, error);
    if (status == NACRE_OK) {
        printf("\n");
        status = print_front(t, request, TRADEOFF_BYTES, error);
    }
    if (status == NACRE_OK) {
        printf("\n%d factorization%s, %d points; the page is %s/tradeoff.html\n", t->run_count,
               t->run_count == 1 ? "" : "s", t->point_count, request->folder);
    }
    return status;
}

static int tradeoff_verb(const void *settings, const struct invocation *invocation,
                         struct nacre_error *error)
{
    const struct tradeoff_settings *s = settings;
    char *run_in = getcwd(NULL, 0); /* NULL where it was removed: the page is the same but for it */
    struct tradeoff_request request = {.scan = invocation->operands[0],
                                       .run_in = run_in,
                                       .folder = s->output,
                                       .device = invocation->device,
                                       .budget = s->budget,
                                       .seed = s->seed};
    struct clock clock = clock_monotonic();
    int64_t begun_ns = clock_now_ns(&clock);
    struct nacre_scan *scan = NULL;
    struct opencl opencl = {0};
    struct responses responses = {0};
    struct tradeoff tradeoff = {0};
    struct progress progress = progress_begin("studying", invocation->quiet);
    int stopped = NACRE_OK;
    int status = nacre_scan_open(invocation->operands[0], &scan, error);
    if (status == NACRE_OK) {
        request.source = nacre_scan_info(scan)->source;
        status = tradeoff_prepare_folder(s->output, error);
    }
    if (status == NACRE_OK) {
        status = opencl_open(invocation->device, &opencl, error);
    }
    if (status == NACRE_OK) {
        status = responses_load(&responses, scan, 0, layout_lanes(&opencl), RESPONSES_AUTO,
                                &progress, error);
    }
    if (status == NACRE_OK) {
        request.seconds_reading = (double)(clock_now_ns(&clock) - begun_ns) * 1e-9;
        status = tradeoff_begin(&tradeoff, error);
    }
    if (status == NACRE_OK) {
        stopped = tradeoff_run(&responses, nacre_scan_info(scan)->pitch_mm, &request, &opencl,
                               &progress, &tradeoff, error);
        status = stopped == NACRE_CANCELLED && tradeoff.point_count > 0 ? NACRE_OK : stopped;
    }
    progress_end(&progress);
    if (status == NACRE_OK) {
        status = tradeoff_write(&tradeoff, &request, error);
    }
    if (status == NACRE_OK) {
        status = print_result(&tradeoff, &request, invocation->json, error);
    }
    if (status == NACRE_OK && stopped == NACRE_CANCELLED) {
        (void)nacre_fail(error,
                         "stopped on request after %d factorization%s; %s holds what was found",
                         tradeoff.run_count, tradeoff.run_count == 1 ? "" : "s", s->output);
        status = NACRE_CANCELLED;
    }
    tradeoff_finish(&tradeoff);
    responses_finish(&responses);
    opencl_close(&opencl);
    nacre_scan_close(scan);
    free(run_in);
    return status;
}

const struct verb verb_tradeoff = {
    .name = "tradeoff",
    .operands = "SCAN -o FOLDER",
    .summary = "find out what accuracy costs in seconds and bytes, on a scan",
    .text =
        "Factors the scan with many settings: both models, methods and weights, numbers of terms "
        "and clusters, iterations, precision and epsilon. It begins with cheap ones and goes on "
        "around those that nothing beats; a factorization that falls behind is given up. "
        "Factorizations share one reading of the scan, the features that clusters are found by, "
        "and, with the paper's model, the factors of fewer terms.\n\n"
        "The folder gets a table of all points, as CSV and as JSON, and a page with error against "
        "seconds and error against bytes. With each point stands the command that makes its "
        "material again. Ctrl-C writes what was found so far.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = tradeoff_options,
    .settings_size = sizeof(struct tradeoff_settings),
    .run = tradeoff_verb,
};
