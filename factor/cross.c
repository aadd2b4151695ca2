/* Fitting one of each reciprocal pair and judging by the other. */
#include "factor/cross.h"

#include "factor/random.h"

#include "nacre/evaluate.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

/* The lots of pairs. */
enum { SEED = 11 };

static size_t area_of(const struct responses *r)
{
    return (size_t)r->window * (size_t)r->window;
}

/* The counterpart of entry (u, v) of (x, y); NaN where it was not measured or there is none. */
static float counterpart(const struct responses *r, int channel, int x, int y, int u, int v)
{
    int half = r->window / 2, end = r->window - 1, xo = x + u - half, yo = y + v - half;
    return xo >= 0 && xo < r->width && yo >= 0 && yo < r->height
               ? responses_value(r, channel, xo, yo, end - u, end - v)
               : (float)NAN;
}

/* Whether of this entry and its counterpart this one is fitted: both ends draw the same lot. */
static bool is_kept(const struct responses *r, int x, int y, int u, int v)
{
    int half = r->window / 2, dx = u - half, dy = v - half;
    bool forth = dy > 0 || (dy == 0 && dx > 0);
    uint64_t own = (uint64_t)y * (uint64_t)r->width + (uint64_t)x;
    uint64_t other = (uint64_t)(y + dy) * (uint64_t)r->width + (uint64_t)(x + dx);
    uint64_t pair = (forth ? own : other) * (uint64_t)area_of(r) +
                    (uint64_t)((dy * r->window + dx) * (forth ? 1 : -1));
    return forth == (random_uniform(SEED, pair) < 0.5);
}

/* One response, [channels][K][K], without what is to judge. */
static void halve_response(const struct responses *r, int x, int y, float *response)
{
    responses_read(r, x, y, response);
    for (size_t i = 0; i < area_of(r) * (size_t)r->channels; i++) {
        int c = (int)(i / area_of(r)), at = (int)(i % area_of(r));
        int u = at % r->window, v = at / r->window;
        bool centre = u == r->window / 2 && v == r->window / 2;
        if (!centre && !isnan(counterpart(r, c, x, y, u, v)) && !is_kept(r, x, y, u, v)) {
            response[i] = NAN;
        }
    }
}

/* Divide the gain at both ends, [height][width], out of a response. */
static void level_response(const struct responses *r, const float *gain, int x, int y,
                           float *response)
{
    int half = r->window / 2;
    for (size_t i = 0; i < area_of(r) * (size_t)r->channels; i++) {
        int at = (int)(i % area_of(r));
        int xo = x + at % r->window - half, yo = y + at / r->window - half;
        if (xo >= 0 && xo < r->width && yo >= 0 && yo < r->height) {
            response[i] *= gain[yo * r->width + xo] / gain[y * r->width + x];
        }
    }
}

/* A copy as floats: with a gain, of the responses without it; else of those that are fitted. */
static int copy_responses(const struct responses *r, const float *gain, struct responses *kept,
                          struct nacre_error *error)
{
    const struct nacre_scan_info info = {.width = r->width,
                                         .height = r->height,
                                         .window = r->window,
                                         .channels = r->channels,
                                         .pixel = NACRE_FLOAT,
                                         .pitch_mm = 1};
    size_t needed = responses_bytes(&info, r->lanes, false), available = responses_free_bytes();
    bool failed = false;
    *kept = (struct responses){0};
    if (needed > available) {
        return nacre_fail(error,
                          "judging by reciprocal pairs takes %.1f GiB of memory more and %.1f GiB "
                          "are free; close other programs",
                          (double)needed * 0x1p-30, (double)available * 0x1p-30);
    }
    int status = responses_begin(kept, &info, r->lanes, false, error);
    if (status != NACRE_OK) {
        return status;
    }
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < r->height; y++) {
        float *response = malloc(area_of(r) * (size_t)r->channels * sizeof *response);
        for (int x = 0; x < r->width && response; x++) {
            if (gain) {
                responses_read(r, x, y, response);
                level_response(r, gain, x, y, response);
            } else {
                halve_response(r, x, y, response);
            }
            responses_put(kept, x, y, response);
        }
        if (!response) {
#pragma omp critical(factor_cross)
            failed = true;
        }
        free(response);
    }
    if (failed) {
        responses_finish(kept);
        return nacre_fail_memory(error, "a response");
    }
    responses_scale(kept);
    return NACRE_OK;
}

int cross_halve(const struct responses *r, struct responses *kept, struct nacre_error *error)
{
    return copy_responses(r, NULL, kept, error);
}

/* With R = S + n forth and R' = S + n' back, n and n' apart: (R' - M)^2 is on average (S - M)^2 + n^2, (R - R')^2 / 2 is
 * n^2, and R R' is S^2. */
struct sums {
    size_t pairs;
    double miss, noise, energy;
};

static void judge_point(const struct responses *r, int x, int y, const float *factored,
                        struct sums *sums)
{
    for (size_t i = 0; i < area_of(r) * (size_t)r->channels; i++) {
        int c = (int)(i / area_of(r)), at = (int)(i % area_of(r));
        int u = at % r->window, v = at / r->window;
        double back = (double)counterpart(r, c, x, y, u, v);
        if (isnan(back) || (u == r->window / 2 && v == r->window / 2) || !is_kept(r, x, y, u, v)) {
            continue;
        }
        double forth = (double)responses_value(r, c, x, y, u, v);
        double miss = ldexp(back, r->exponent[c]) - (double)factored[i];
        if (!isnan(forth)) {
            sums->pairs++;
            sums->miss += miss * miss;
            sums->noise += ldexp((forth - back) * (forth - back) / 2, 2 * r->exponent[c]);
            sums->energy += ldexp(forth * back, 2 * r->exponent[c]);
        }
    }
}

int cross_judge(const struct responses *r, const struct nacre_material *m,
                struct cross_report *report, struct nacre_error *error)
{
    struct sums *rows = calloc((size_t)r->height + 1, sizeof *rows), sum = {0};
    float *factored =
        malloc(((size_t)r->height * area_of(r) * (size_t)r->channels + 1) * sizeof *factored);
    *report = (struct cross_report){0};
    if (!rows || !factored) {
        free(rows);
        free(factored);
        return nacre_fail_memory(error, "the pairs");
    }
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < r->height; y++) {
        float *own = factored + (size_t)y * area_of(r) * (size_t)r->channels;
        for (int x = 0; x < r->width; x++) {
            nacre_material_response(m, x, y, own);
            judge_point(r, x, y, own, &rows[y]);
        }
    }
    for (int y = 0; y < r->height; y++) {
        sum.pairs += rows[y].pairs;
        sum.miss += rows[y].miss;
        sum.noise += rows[y].noise;
        sum.energy += rows[y].energy;
    }
    free(rows);
    free(factored);
    if (sum.energy > 0) {
        report->pairs = sum.pairs;
        report->error = sqrt(fmax(0, sum.miss - sum.noise) / sum.energy);
        report->noise = sqrt(sum.noise / sum.energy);
    }
    return NACRE_OK;
}

/* Pairs are reciprocal. */
static int measure_level(const struct responses *r, double pitch_mm,
                         const struct factor_options *options, const struct opencl *opencl,
                         struct progress *progress, struct cross_report *report,
                         struct nacre_error *error)
{
    struct responses kept;
    struct nacre_material material = {0};
    struct factor_summary summary = {0};
    int status = cross_halve(r, &kept, error);
    if (status != NACRE_OK) {
        return status;
    }
    status =
        factorize_responses(&kept, pitch_mm, options, opencl, progress, &material, &summary, error);
    if (status == NACRE_OK) {
        status = cross_judge(r, &material, report, error);
    }
    factor_summary_finish(&summary);
    nacre_material_finish(&material);
    responses_finish(&kept);
    return status;
}

int cross_measure(const struct responses *r, const float *gain, double pitch_mm,
                  const struct factor_options *options, const struct opencl *opencl,
                  struct progress *progress, struct cross_report *report, struct nacre_error *error)
{
    struct responses level = {0};
    int status = gain ? copy_responses(r, gain, &level, error) : NACRE_OK;
    *report = (struct cross_report){0};
    if (status == NACRE_OK) {
        status =
            measure_level(gain ? &level : r, pitch_mm, options, opencl, progress, report, error);
    }
    responses_finish(&level);
    return status;
}
