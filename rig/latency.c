/* Measuring projector latency and camera delay from brightness. */
#include "rig/latency.h"

#include "rig/bayer.h"
#include "rig/frame_compare.h"

#include <inttypes.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const int64_t delivery_ns = 2000000000;
/* No projector takes longer than this to show a pattern. */
static const int64_t settled_ns = 500000000;
/* Less of full scale between black and white is not seen safely in a mean over all pixels. */
static const double least_contrast = 0.01;
/* Brighter light is exposed no longer. */
static const double enough_contrast = 0.2;
/* Frames that saw less or more of a change than this tell only on which side of it they lie. */
static const double least_share = 0.08, most_share = 0.92;
enum { COLOURS = 3, MOST_LOST = 5 };
static const int turns[] = {1, 2, 4, 8};
enum { TURNS = sizeof turns / sizeof *turns };

struct meter {
    const struct devices *devices;
    struct latency_report *report;
    uint8_t *levels[2]; /* black, white */
    int64_t exposure_ns;
    double mean[2][COLOURS]; /* of the raw values under black and white */
    double *light_ms, *camera_ms;
    size_t light_count, camera_count;
    bool unknown;              /* which of the two is on the glass */
    double below_ms, above_ms; /* the change lies between, by frames that saw none or all of it */
};

/* When a frame was exposed, and what it saw. */
struct glimpse {
    int64_t flip_ns, begin_ns, trigger_ns;
    double mean[COLOURS];
    double saturated;
};

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a;
    double y = *(const double *)b;
    return (x > y) - (x < y);
}

struct latency_figure latency_figure(double *values, size_t count)
{
    struct latency_figure figure = {.count = count};
    if (count == 0) {
        return figure;
    }
    qsort(values, count, sizeof *values, compare_doubles);
    figure.median_ms =
        count % 2 ? values[count / 2] : (values[count / 2 - 1] + values[count / 2]) / 2;
    figure.spread_ms = (values[count - 1 - count / 4] - values[count / 4]) / 2;
    figure.least_ms = values[0];
    figure.most_ms = values[count - 1];
    return figure;
}

static void average(const struct camera *camera, const uint16_t *raw, double mean[COLOURS])
{
    double sums[COLOURS] = {0};
    double counts[COLOURS] = {0};
    for (int y = 0; y < camera->height; y++) {
        for (int x = 0; x < camera->width; x++) {
            int colour = bayer_channel(camera->bayer, x, y);
            sums[colour] += *raw++;
            counts[colour]++;
        }
    }
    for (int c = 0; c < COLOURS; c++) {
        mean[c] = counts[c] > 0 ? sums[c] / counts[c] : 0;
    }
}

/* Expose what is shown or about to be, at `at_ns` or as soon after as can be. */
static int expose(struct meter *meter, int64_t at_ns, struct glimpse *glimpse,
                  struct nacre_error *error)
{
    struct camera *camera = meter->devices->camera;
    struct trigger *trigger = meter->devices->trigger;
    struct camera_frame frame;
    int status = camera->ops->arm(camera, meter->exposure_ns, error);
    if (status != NACRE_OK) {
        return status;
    }
    clock_sleep_until_ns(meter->devices->clock, at_ns);
    status = trigger->ops->fire(trigger, meter->exposure_ns, &glimpse->trigger_ns, error);
    if (status == NACRE_OK) {
        status = camera->ops->take(camera, meter->exposure_ns + delivery_ns, &frame, error);
    }
    if (status != NACRE_OK) {
        return status;
    }
    glimpse->begin_ns = camera->free_running ? frame.frame_ns : glimpse->trigger_ns;
    average(camera, frame.raw, glimpse->mean);
    glimpse->saturated = frame_saturation(frame.raw, (size_t)camera->width * (size_t)camera->height,
                                          (1 << camera->bits) - 1);
    if (!camera->free_running && meter->camera_ms) {
        meter->camera_ms[meter->camera_count++] =
            (double)(frame.frame_ns - glimpse->trigger_ns) * 1e-6;
    }
    return NACRE_OK;
}

static int show(struct meter *meter, int white, struct glimpse *glimpse, struct nacre_error *error)
{
    struct projector *projector = meter->devices->projector;
    int status = projector->ops->show(projector, meter->levels[white], &glimpse->flip_ns, error);
    meter->unknown = status != NACRE_OK;
    return status;
}

/* Show again what the last flip was to bring, where it failed: a flip to what is there already would seem to take no time. */
static int settle(struct meter *meter, int white, struct nacre_error *error)
{
    struct glimpse glimpse = {0};
    int status = meter->unknown ? show(meter, white, &glimpse, error) : NACRE_OK;
    if (status == NACRE_OK && glimpse.flip_ns) {
        clock_sleep_until_ns(meter->devices->clock, glimpse.flip_ns + settled_ns);
    }
    return status;
}

/* Black and white long after they were shown. */
static int look_at(struct meter *meter, int white, double *saturated, struct nacre_error *error)
{
    struct glimpse glimpse = {0};
    int status = show(meter, white, &glimpse, error);
    if (status == NACRE_OK) {
        status = expose(meter, glimpse.flip_ns + settled_ns, &glimpse, error);
    }
    memcpy(meter->mean[white], glimpse.mean, sizeof glimpse.mean);
    *saturated = glimpse.saturated;
    return status;
}

static double contrast_of(const struct meter *meter)
{
    double sum = 0;
    for (int c = 0; c < COLOURS; c++) {
        sum += meter->mean[1][c] - meter->mean[0][c];
    }
    int colours = meter->devices->camera->bayer == BAYER_MONO ? 1 : COLOURS;
    return sum / colours / ((1 << meter->devices->camera->bits) - 1);
}

/* The shortest exposure that tells black from white well; the shorter the sharper. */
static int find_exposure(struct meter *meter, struct nacre_error *error)
{
    struct latency_report *report = meter->report;
    for (int i = 0; i < TURNS; i++) {
        double unused = 0;
        meter->exposure_ns = meter->devices->projector->period_ns * turns[i];
        int status = look_at(meter, 0, &unused, error);
        if (status == NACRE_OK) {
            status = look_at(meter, 1, &report->saturated, error);
        }
        if (status != NACRE_OK) {
            return status;
        }
        report->contrast = contrast_of(meter);
        report->exposure_ms = (double)meter->exposure_ns * 1e-6;
        if (report->contrast >= enough_contrast || report->saturated > 0) {
            break;
        }
    }
    return report->contrast >= least_contrast
               ? NACRE_OK
               : nacre_fail(error,
                            "the camera does not see the projector: white is brighter than black "
                            "by %.2f %% of full scale at %g ms; is the lens cap off, does the lamp "
                            "burn, does the projector shine on what the camera looks at?",
                            100 * report->contrast, report->exposure_ms);
}

/* Which share of the exposure saw the new pattern; of the wheel's colours each counts alike. */
static double share_of(const struct meter *meter, const struct glimpse *glimpse, int white)
{
    double sum = 0;
    int counted = 0;
    double least = contrast_of(meter) * ((1 << meter->devices->camera->bits) - 1) / 10;
    for (int c = 0; c < COLOURS; c++) {
        double range = meter->mean[1][c] - meter->mean[0][c];
        if (range > least) {
            sum += (glimpse->mean[c] - meter->mean[0][c]) / range;
            counted++;
        }
    }
    double lit = counted ? sum / counted : 0;
    return white ? lit : 1 - lit;
}

/* What a frame says of the time between flip and change of light. */
static double learn(struct meter *meter, const struct glimpse *glimpse, int white)
{
    double share = share_of(meter, glimpse, white);
    double begin_ms = (double)(glimpse->begin_ns - glimpse->flip_ns) * 1e-6;
    double exposure_ms = (double)meter->exposure_ns * 1e-6;
    if (share < least_share) {
        meter->below_ms = fmax(meter->below_ms, begin_ms + exposure_ms * (1 - least_share));
    } else if (share > most_share) {
        meter->above_ms = fmin(meter->above_ms, begin_ms + exposure_ms * (1 - most_share));
    } else {
        meter->light_ms[meter->light_count++] = begin_ms + exposure_ms * (1 - share);
    }
    return share;
}

/* Where to look next: spread over the part of an exposure around what is known. */
static int64_t next_delay(const struct meter *meter, int i)
{
    double exposure_ms = (double)meter->exposure_ns * 1e-6;
    double about = meter->light_count > 0      ? meter->light_ms[meter->light_count - 1]
                   : isfinite(meter->above_ms) ? (meter->below_ms + meter->above_ms) / 2
                                               : meter->below_ms + exposure_ms / 2;
    /* The golden ratio spreads any number of places evenly. */
    double place = fmod(0.5 + i * 0.6180339887, 1);
    double delay_ms = about - exposure_ms * (0.2 + 0.6 * place);
    return delay_ms > 0 ? llround(delay_ms * 1e6) : 0;
}

static int flip_once(struct meter *meter, int i, struct nacre_error *error)
{
    struct glimpse glimpse = {0};
    int white = (i + 1) % 2; /* white is on the glass when it begins */
    int64_t delay_ns = next_delay(meter, i);
    int status = settle(meter, white, error);
    white = !white;
    if (status == NACRE_OK) {
        status = show(meter, white, &glimpse, error);
    }
    if (status == NACRE_OK) {
        status = expose(meter, glimpse.flip_ns + delay_ns, &glimpse, error);
    }
    if (status == NACRE_OK && learn(meter, &glimpse, white) < most_share) {
        struct clock *clock = meter->devices->clock;
        clock_sleep_until_ns(clock, clock_now_ns(clock) + meter->exposure_ns);
    }
    /* The old pattern must be gone before the next is shown. */
    clock_sleep_until_ns(meter->devices->clock, glimpse.flip_ns + settled_ns);
    return status;
}

static int flip(struct meter *meter, int flips, struct progress *progress,
                struct nacre_error *error)
{
    for (int i = 0; i < flips; i++) {
        int status = progress_step(progress, i, flips, NULL, error);
        if (status == NACRE_OK) {
            status = flip_once(meter, i, error);
        }
        if (status == NACRE_FAILED && ++meter->report->lost <= MOST_LOST) {
            status = NACRE_OK;
        }
        if (status != NACRE_OK) {
            return status;
        }
    }
    return NACRE_OK;
}

static int sum_up(struct meter *meter, struct nacre_error *error)
{
    struct latency_report *report = meter->report;
    report->camera = latency_figure(meter->camera_ms, meter->camera_count);
    report->light = latency_figure(meter->light_ms, meter->light_count);
    if (report->light.count > 0) {
        return NACRE_OK;
    }
    if (!isfinite(meter->above_ms)) {
        return nacre_fail(error,
                          "the light did not change within %.0f ms of a flip, but did later; look "
                          "for a setting of the projector that delays or mixes pictures",
                          meter->below_ms);
    }
    /* Exposures that are locked to the wheel may all see nothing or all. */
    double low_ms = fmin(meter->below_ms, meter->above_ms);
    report->light = (struct latency_figure){.count = 2,
                                            .median_ms = (low_ms + meter->above_ms) / 2,
                                            .spread_ms = (meter->above_ms - low_ms) / 2,
                                            .least_ms = low_ms,
                                            .most_ms = meter->above_ms};
    return NACRE_OK;
}

int latency_measure(const struct devices *devices, int flips, struct progress *progress,
                    struct latency_report *report, struct nacre_error *error)
{
    const struct projector *projector = devices->projector;
    size_t points = (size_t)projector->width * (size_t)projector->height;
    struct meter meter = {.devices = devices, .report = report, .above_ms = INFINITY};
    *report = (struct latency_report){0};
    meter.levels[0] = calloc(points, 2);
    double *values = calloc((size_t)flips, 2 * sizeof *values);
    int status = NACRE_OK;
    if (!meter.levels[0] || !values) {
        status = nacre_fail_memory(error, "patterns");
        goto out;
    }
    meter.levels[1] = meter.levels[0] + points;
    memset(meter.levels[1], 255, points);
    status = find_exposure(&meter, error);
    if (status != NACRE_OK) {
        goto out;
    }
    meter.light_ms = values;
    meter.camera_ms = values + flips;
    status = flip(&meter, flips, progress, error);
    if (status == NACRE_OK) {
        status = sum_up(&meter, error);
    }
out:
    free(meter.levels[0]);
    free(values);
    return status;
}
