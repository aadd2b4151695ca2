/* Reading and simulating samples. */
#include "sample.h"

#include "../timing.h"

#include "factor/cross.h"
#include "factor/random.h"
#include "tests/files.h"

#include <math.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

/* Of a response's norm, on average over the points. */
static const double noise_share = 0.006;

enum { NOISE_SEED = 20 };

size_t sample_response_size(const struct sample *s)
{
    return (size_t)s->channels * (size_t)s->window * (size_t)s->window;
}

size_t sample_size(const struct sample *s)
{
    return (size_t)s->width * (size_t)s->height * sample_response_size(s);
}

/* All responses of a working layout, NaN where not measured or outside the sample. */
static float *read_all(const struct sample *s, const struct responses *responses)
{
    float *values = allocate(sample_size(s) * sizeof *values);
    for (int i = 0; i < s->width * s->height; i++) {
        responses_read(responses, i % s->width, i / s->width,
                       values + (size_t)i * sample_response_size(s));
    }
    return values;
}

static void set_name(struct sample *s, const char *path)
{
    const char *slash = strrchr(path, '/');
    (void)snprintf(s->name, sizeof s->name, "%s", slash ? slash + 1 : path);
    char *dot = strrchr(s->name, '.');
    if (dot) {
        *dot = '\0';
    }
}

static struct nacre_scan_info info_of(const struct sample *s)
{
    return (struct nacre_scan_info){.width = s->width,
                                    .height = s->height,
                                    .window = s->window,
                                    .channels = s->channels,
                                    .pixel = NACRE_FLOAT,
                                    .pitch_mm = s->pitch_mm};
}

/* The middle points' responses as the file has them, [height][width][channels][K][K]. */
static float *load(const char *path, int limit, struct sample *s)
{
    struct nacre_error error = {0};
    struct nacre_scan *scan = NULL;
    if (nacre_scan_open(path, &scan, &error) != NACRE_OK) {
        fail(error.text);
    }
    const struct nacre_scan_info *info = nacre_scan_info(scan);
    s->width = info->width < limit ? info->width : limit;
    s->height = info->height < limit ? info->height : limit;
    s->channels = info->channels;
    s->window = info->window;
    s->pitch_mm = info->pitch_mm;
    float *values = allocate(sample_size(s) * sizeof *values);
    for (int i = 0; i < s->width * s->height; i++) {
        if (nacre_scan_read(scan, (info->width - s->width) / 2 + i % s->width,
                            (info->height - s->height) / 2 + i / s->width,
                            values + (size_t)i * sample_response_size(s), &error) != NACRE_OK) {
            fail(error.text);
        }
    }
    nacre_scan_close(scan);
    return values;
}

/* Put the values into the working layout, and read them back as it holds them. */
static void place(struct sample *s, const float *values, int lanes)
{
    struct nacre_error error = {0};
    struct nacre_scan_info info = info_of(s);
    if (responses_begin(&s->responses, &info, lanes, false, &error) != NACRE_OK) {
        fail(error.text);
    }
    for (int i = 0; i < s->width * s->height; i++) {
        responses_put(&s->responses, i % s->width, i / s->width,
                      values + (size_t)i * sample_response_size(s));
    }
    responses_scale(&s->responses);
    s->measured = read_all(s, &s->responses);
}

void sample_read(const char *path, int lanes, int limit, struct sample *s)
{
    struct nacre_error error = {0};
    *s = (struct sample){0};
    set_name(s, path);
    float *values = load(path, limit, s);
    place(s, values, lanes);
    free(values);
    if (cross_halve(&s->responses, &s->kept, &error) != NACRE_OK) {
        fail(error.text);
    }
    s->kept_measured = read_all(s, &s->kept);
}

/* Keep the first channel alone where the others are the same. */
static void drop_copies(struct sample *s, float *values)
{
    size_t area = (size_t)s->window * (size_t)s->window, size = sample_response_size(s);
    size_t points = (size_t)s->width * (size_t)s->height;
    for (size_t i = 0; i < points * size; i++) {
        if (values[i] != values[i / size * size + i % area]) {
            return;
        }
    }
    for (size_t i = 0; i < points; i++) {
        memmove(values + i * area, values + i * size, area * sizeof *values);
    }
    s->channels = 1;
}

/* A normal number for entry i. */
static double normal(uint64_t i)
{
    double radius = sqrt(-2 * log(1 - random_uniform(NOISE_SEED, 2 * i)));
    return radius * cos(2 * M_PI * random_uniform(NOISE_SEED, 2 * i + 1));
}

/* Add noise whose variance goes with the value. With variance a R an entry, its norm over that of the response is
 * sqrt(a sum(R) / sum(R^2)). */
static float *add_noise(const struct sample *s)
{
    size_t points = (size_t)s->width * (size_t)s->height, size = sample_response_size(s);
    float *noisy = allocate(points * size * sizeof *noisy);
    double mean = 0;
    for (size_t i = 0; i < points; i++) {
        double sum = 0, square = 0;
        for (size_t k = 0; k < size; k++) {
            double value = (double)s->exact[i * size + k];
            sum += value;
            square += value * value;
        }
        mean += square > 0 ? sqrt(sum / square) / (double)points : 0;
    }
    double a = noise_share / mean;
    for (size_t i = 0; i < points * size; i++) {
        double value = (double)s->exact[i];
        noisy[i] = (float)(value + a * sqrt(fmax(0, value)) * normal(i));
    }
    return noisy;
}

/* Run the program; what it prints is not a result here. */
static void run(const char *nacre, const char *path, char *scan)
{
    char verb[] = "simulate", quiet[] = "--quiet", output[] = "-o";
    char *arguments[] = {strdup(nacre), verb, quiet, strdup(path), output, scan, NULL};
    posix_spawn_file_actions_t actions;
    pid_t child;
    int status = 0;
    if (posix_spawn_file_actions_init(&actions) != 0 ||
        posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO) != 0 ||
        posix_spawn(&child, nacre, &actions, NULL, arguments, environ) != 0 ||
        waitpid(child, &status, 0) != child || !WIFEXITED(status) || WEXITSTATUS(status) != 0) {
        fail("nacre simulate failed");
    }
    (void)posix_spawn_file_actions_destroy(&actions);
    free(arguments[0]);
    free(arguments[3]);
}

void sample_simulate(const char *nacre, const char *path, int lanes, int limit, struct sample *s)
{
    char *folder = folder_make(), *scan = path_join(folder, "scan.exr");
    *s = (struct sample){0};
    run(nacre, path, scan);
    set_name(s, path);
    s->exact = load(scan, limit, s);
    free(scan);
    folder_remove(folder);
    drop_copies(s, s->exact);
    float *noisy = add_noise(s);
    place(s, noisy, lanes);
    free(noisy);
}

void sample_finish(struct sample *s)
{
    responses_finish(&s->responses);
    responses_finish(&s->kept);
    free(s->measured);
    free(s->kept_measured);
    free(s->exact);
    *s = (struct sample){0};
}
