/* The whole command on the three channels of the candle, with clusters and with a kernel per term: seconds, memory against
 * the responses, and whether the first comes within 1 % of the objective that 1000 of the paper's updates reach. */
#include "cases.h"
#include "tests/files.h"
#include "timing.h"

#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

/* What is asked for on two cores. */
#define SECONDS_ASKED   45.0
#define SECONDS_TERMS   60.0
#define MEMORY_ASKED    1.5
#define OBJECTIVE_ASKED 1.01

/* One run of the command. */
struct run {
    struct moment time; /* processor: of the child, user and system */
    double user;
    double peak_bytes;
    json_t *result; /* what --json printed */
};

/* Wait for the child, having read all that it prints. */
static struct run collect(pid_t child, int output)
{
    struct run run = {0};
    struct rusage usage;
    json_error_t why;
    int status = 0;
    FILE *stream = fdopen(output, "r");
    if (!stream) {
        fail("cannot read from the command");
    }
    run.result = json_loadf(stream, 0, &why);
    (void)fclose(stream);
    while (wait4(child, &status, 0, &usage) < 0) {
        if (errno != EINTR) {
            fail("cannot wait for the command");
        }
    }
    if (!WIFEXITED(status) || WEXITSTATUS(status) != EXIT_SUCCESS || !run.result) {
        fail("the command failed");
    }
    run.user = (double)usage.ru_utime.tv_sec + (double)usage.ru_utime.tv_usec * 1e-6;
    run.time.processor =
        run.user + (double)usage.ru_stime.tv_sec + (double)usage.ru_stime.tv_usec * 1e-6;
    run.peak_bytes = (double)usage.ru_maxrss * 1024;
    return run;
}

/* nacre factor SCAN -o MATERIAL with the case's terms and clusters, or by default with a kernel per term. */
static struct run factor(const char *nacre, const struct bench_case *c, bool shaped,
                         const char *scan, const char *material)
{
    char terms[16], clusters[16];
    int ends[2];
    (void)snprintf(terms, sizeof terms, "%d", c->terms);
    (void)snprintf(clusters, sizeof clusters, "%d", c->clusters);
    const char *const arguments[] = {nacre,     "factor",     scan,      "-o",       material,
                                     "--quiet", "--json",     "--model", "clusters", "--terms",
                                     terms,     "--clusters", clusters,  NULL};
    const char *const of_terms[] = {nacre,     "factor", scan,      "-o",    material,
                                    "--quiet", "--json", "--model", "terms", NULL};
    if (pipe2(ends, O_CLOEXEC) != 0) {
        fail("no pipe");
    }
    struct moment start = timing_now();
    pid_t child = fork();
    if (child < 0) {
        fail("cannot start the command");
    }
    if (child == 0) {
        (void)dup2(ends[1], STDOUT_FILENO);
        execv(nacre, (char *const *)(shaped ? of_terms : arguments));
        _exit(127);
    }
    (void)close(ends[1]);
    struct run run = collect(child, ends[0]);
    run.time.wall = timing_since(start).wall;
    return run;
}

static void write_scan(const struct bench_case *c, const char *path)
{
    struct field field = field_new(c->kind, c->width, c->height, c->window, c->channels, CASE_SEED);
    field_write(&field, path);
    field_finish(&field);
}

static double number(const struct run *run, const char *key)
{
    const json_t *value = json_object_get(run->result, key);
    if (!json_is_number(value)) {
        fail("the command's result lacks a number");
    }
    return json_number_value(value);
}

/* Time, stages and memory. */
static void print_costs(const struct bench_case *c, const struct run *run, double asked)
{
    static const char *const stages[] = {"reading", "clustering", "iterating", "measuring"};
    double bytes =
        (double)c->width * c->height * c->window * c->window * c->channels * sizeof(float);
    printf("nacre factor, %s %d x %d, K %d, %d channels (%.0f MB), %.0f terms, %.0f clusters\n",
           c->name, c->width, c->height, c->window, c->channels, bytes * 1e-6, number(run, "terms"),
           number(run, "clusters"));
    printf("  time       %.1f s, asked for %.0f s on two cores; %.1f s of processor time, %.1f s "
           "of it "
           "user time: %.1f s on two idle cores at best\n",
           run->time.wall, asked, run->time.processor, run->user, run->time.processor / 2);
    printf("  stages    ");
    for (size_t i = 0; i < sizeof stages / sizeof *stages; i++) {
        char key[32];
        (void)snprintf(key, sizeof key, "seconds_%s", stages[i]);
        printf(" %s %.1f s%s", stages[i], number(run, key), i < 3 ? "," : "\n");
    }
    printf("  memory     %.0f MB at its peak, %.2f times the responses, asked for %.1f\n",
           run->peak_bytes * 1e-6, run->peak_bytes / bytes, MEMORY_ASKED);
}

static bool print_run(const struct bench_case *c, const struct run *run)
{
    double objective = number(run, "objective");
    print_costs(c, run, SECONDS_ASKED);
    if (c->goal <= 0) {
        printf("  objective  %.6g after %.0f steps; cases.c keeps no goal for it yet\n", objective,
               number(run, "iterations"));
        return true;
    }
    printf("  objective  %.6g after %.0f steps, %.4f times that of %d updates (%.6g), asked for "
           "%.2f\n",
           objective, number(run, "iterations"), objective / c->goal, CASE_UPDATES, c->goal,
           OBJECTIVE_ASKED);
    return objective <= OBJECTIVE_ASKED * c->goal;
}

static void print_terms(const struct bench_case *c, const struct run *run, const char *material)
{
    struct stat file;
    print_costs(c, run, SECONDS_TERMS);
    if (stat(material, &file) != 0) {
        fail("the command left no material");
    }
    printf("  objective  %.6g after %.0f steps; mean error %.4f, file %lld bytes, a %.0fth of the "
           "responses\n",
           number(run, "objective"), number(run, "iterations"),
           json_number_value(json_object_get(json_object_get(run->result, "error"), "mean")),
           (long long)file.st_size,
           (double)c->width * c->height * c->window * c->window * c->channels * sizeof(float) /
               (double)file.st_size);
}

/* Run the command in `folder`: on a small sample first, which leaves the kernels compiled, as they are after the first
 * scan of any user. */
static bool bench(const char *nacre, const char *folder, const char *model)
{
    bool good = true;
    const struct bench_case *c = case_find("candle", 3, 100);
    struct bench_case small = *c;
    char scan[4096], material[4096];
    (void)snprintf(scan, sizeof scan, "%s/scan.exr", folder);
    (void)snprintf(material, sizeof material, "%s/material.exr", folder);
    small.width = small.height = 64;
    for (int shaped = 0; shaped < 2; shaped++) {
        if (model && (strcmp(model, "terms") == 0) != shaped) {
            continue;
        }
        write_scan(&small, scan);
        struct run run = factor(nacre, &small, shaped, scan, material);
        json_decref(run.result);
        write_scan(c, scan);
        run = factor(nacre, c, shaped, scan, material);
        if (shaped) {
            print_terms(c, &run, material);
        } else {
            good = print_run(c, &run);
        }
        json_decref(run.result);
    }
    (void)unlink(scan);
    (void)unlink(material);
    return good;
}

/* Arguments: the program `nacre`; the one model wanted, clusters or terms. The scan, a gigabyte, goes to $TMPDIR or
 * /tmp for the time being. */
int main(int argc, char **argv)
{
    if (argc < 2 || argc > 3) {
        fail("usage: bench_command NACRE [clusters | terms]");
    }
    char *folder = folder_make();
    bool good = bench(argv[1], folder, argc > 2 ? argv[2] : NULL);
    folder_remove(folder);
    return good ? EXIT_SUCCESS : EXIT_FAILURE;
}
