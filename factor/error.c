/* Measuring how far a material is from the responses it was made of. */
#include "factor/error.h"

#include "factor/window.h"

#include "nacre/evaluate.h"
#include "nacre/exr_file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Squared sums of one point's measured entries inside the sample. */
struct sums {
    size_t measured;
    double difference, norm;
};

static void add_row(struct sums *sums, const float *measured, const float *factored, int first,
                    int end)
{
    double difference = 0, norm = 0;
    int count = 0;
#pragma omp simd reduction(+ : difference, norm, count)
    for (int u = first; u < end; u++) {
        bool known = fabsf(measured[u]) < INFINITY;
        double value = known ? (double)measured[u] : 0;
        double apart = known ? value - (double)factored[u] : 0;
        difference += apart * apart;
        norm += value * value;
        count += known;
    }
    sums->difference += difference;
    sums->norm += norm;
    sums->measured += (size_t)count;
}

/* All entries of a point, with and without x_o = x_i. The latter are not taken from sums: that would lose digits. */
static void compare(const struct nacre_material *m, int x, int y, const float *measured,
                    const float *factored, struct sums *whole, struct sums *without_centre)
{
    int half = m->window / 2, first = x < half ? half - x : 0;
    int end = x + half >= m->width ? m->width - x + half : m->window;
    *whole = *without_centre = (struct sums){0};
    for (int row = 0; row < m->channels * m->window; row++) {
        int v = row % m->window, yo = y + v - half;
        if (yo >= 0 && yo < m->height) {
            add_row(without_centre, measured, factored, first, v == half ? half : end);
            if (v == half) {
                add_row(without_centre, measured, factored, half + 1, end);
                add_row(whole, measured, factored, half, half + 1);
            }
        }
        measured += m->window;
        factored += m->window;
    }
    whole->difference += without_centre->difference;
    whole->norm += without_centre->norm;
    whole->measured += without_centre->measured;
}

/* What the model has nothing for. */
static void miss_beyond(struct sums *sums, double beyond)
{
    sums->difference += beyond;
    sums->norm += beyond;
}

static float relative(struct sums sums)
{
    return sums.measured && sums.norm > 0 ? (float)sqrt(sums.difference / sums.norm) : NAN;
}

static int measure_row(const struct error_source *source, const struct nacre_material *m, int y,
                       struct error_report *report, size_t *not_measured, struct nacre_error *error)
{
    size_t size = (size_t)m->channels * (size_t)m->window * (size_t)m->window;
    const struct window_cut cut = {.width = m->width,
                                   .height = m->height,
                                   .channels = m->channels,
                                   .from = source->window ? source->window : m->window,
                                   .to = m->window};
    size_t read = (size_t)m->channels * (size_t)cut.from * (size_t)cut.from;
    float *measured = malloc(read * sizeof *measured), *factored = malloc(size * sizeof *factored);
    int status = NACRE_OK;
    if (!measured || !factored) {
        status = nacre_fail_memory(error, "a response");
        goto out;
    }
    for (int x = 0; x < m->width && status == NACRE_OK; x++) {
        size_t point = (size_t)y * (size_t)m->width + (size_t)x;
        status = source->read(source->data, x, y, measured, error);
        if (status == NACRE_OK) {
            double beyond = window_cut(&cut, x, y, measured, measured);
            beyond += source->beyond ? source->beyond[point] : 0;
            nacre_material_response(m, x, y, factored);
            struct sums whole, without_centre;
            compare(m, x, y, measured, factored, &whole, &without_centre);
            miss_beyond(&whole, beyond);
            miss_beyond(&without_centre, beyond);
            report->map[point] = relative(whole);
            report->map_without_centre[point] = relative(without_centre);
            *not_measured += whole.measured == 0;
        }
    }
out:
    free(measured);
    free(factored);
    return status;
}

static struct error_range summarise(const float *map, size_t count)
{
    struct error_range range = {0};
    for (size_t i = 0; i < count; i++) {
        double value = (double)map[i];
        if (isnan(value)) {
            continue;
        }
        range.minimum = range.points == 0 || value < range.minimum ? value : range.minimum;
        range.maximum = range.points == 0 || value > range.maximum ? value : range.maximum;
        range.mean += value;
        range.energy_mean += value * value;
        range.points++;
    }
    if (range.points) {
        range.mean /= (double)range.points;
        range.energy_mean /= (double)range.points;
    }
    return range;
}

int error_measure(const struct error_source *source, const struct nacre_material *m,
                  struct progress *progress, struct error_report *report, struct nacre_error *error)
{
    size_t points = (size_t)m->width * (size_t)m->height, not_measured = 0;
    int status = NACRE_OK, done = 0;
    struct nacre_error first = {0};
    *report = (struct error_report){.points = points,
                                    .map = malloc(points * sizeof(float)),
                                    .map_without_centre = malloc(points * sizeof(float))};
    if (!report->map || !report->map_without_centre) {
        error_report_finish(report);
        return nacre_fail_memory(error, "the error map");
    }
#pragma omp parallel for schedule(dynamic) reduction(+ : not_measured)
    for (int y = 0; y < m->height; y++) {
        struct nacre_error mine = {0};
        int result = NACRE_OK, stopped = 0;
#pragma omp critical(factor_error)
        {
            stopped = status != NACRE_OK;
            if (!stopped && progress) {
                result = progress_step(progress, done++, m->height, "measuring the error", &mine);
            }
        }
        if (!stopped && result == NACRE_OK) {
            result = measure_row(source, m, y, report, &not_measured, &mine);
        }
#pragma omp critical(factor_error)
        if (result != NACRE_OK && status == NACRE_OK) {
            status = result;
            first = mine;
        }
    }
    if (status != NACRE_OK) {
        if (error) {
            *error = first;
        }
        error_report_finish(report);
        return status;
    }
    report->whole = summarise(report->map, points);
    report->without_centre = summarise(report->map_without_centre, points);
    report->not_measured = not_measured;
    report->dark = points - not_measured - report->whole.points;
    return NACRE_OK;
}

int error_rehearse(const struct error_source *source, const struct nacre_material *m, int rows,
                   struct nacre_error *error)
{
    size_t points = (size_t)m->width * (size_t)m->height, not_measured = 0;
    struct error_report report = {.map = malloc(points * sizeof(float)),
                                  .map_without_centre = malloc(points * sizeof(float))};
    int first = (m->height - rows) / 2, failed = 0;
    if (!report.map || !report.map_without_centre) {
        error_report_finish(&report);
        return nacre_fail_memory(error, "the error map");
    }
#pragma omp parallel for schedule(dynamic) reduction(+ : not_measured) reduction(| : failed)
    for (int y = first; y < first + rows; y++) {
        failed |= measure_row(source, m, y, &report, &not_measured, NULL) != NACRE_OK;
    }
    error_report_finish(&report);
    return failed ? nacre_fail(error, "cannot measure the error of a few rows") : NACRE_OK;
}

static int read_scan(const void *data, int x, int y, float *response, struct nacre_error *error)
{
    return nacre_scan_read(data, x, y, response, error);
}

struct error_source error_source_scan(const struct nacre_scan *scan)
{
    return (struct error_source){
        .data = scan, .read = read_scan, .window = nacre_scan_info(scan)->window};
}

int error_check_sizes(const struct nacre_scan *scan, const struct nacre_material *m,
                      struct nacre_error *error)
{
    const struct nacre_scan_info *info = nacre_scan_info(scan);
    if (info->width != m->width || info->height != m->height) {
        return nacre_fail(error,
                          "%s has %d x %d surface points and the material %d x %d; compare a "
                          "material with the scan it was made of",
                          nacre_scan_path(scan), info->width, info->height, m->width, m->height);
    }
    if (info->window < m->window || info->channels != m->channels) {
        return nacre_fail(error,
                          "%s has a window of %d and %d channels, the material %d and %d; compare "
                          "a material with the scan it was made of",
                          nacre_scan_path(scan), info->window, info->channels, m->window,
                          m->channels);
    }
    return NACRE_OK;
}

int error_map_write(const char *path, const struct error_report *report, int width, int height,
                    struct nacre_error *error)
{
    size_t bytes = (size_t)width * (size_t)height * sizeof(float);
    struct exr_file file = {0};
    struct exr_part *part = exr_file_add_part(&file, "", width, height);
    struct exr_plane *plane = part ? exr_part_add_plane(part, "error", NACRE_FLOAT) : NULL;
    int status = NACRE_FAILED;
    if (plane) {
        memcpy(plane->values, report->map, bytes);
        plane = exr_part_add_plane(part, "without_centre", NACRE_FLOAT);
    }
    if (plane) {
        memcpy(plane->values, report->map_without_centre, bytes);
        status = exr_file_write(path, &file, EXR_ZIP, error);
    } else {
        status = nacre_fail_memory(error, "the error map");
    }
    exr_file_finish(&file);
    return status;
}

double error_measured_bytes(const struct nacre_material *m)
{
    return (double)m->width * m->height * m->window * m->window * m->channels * 4;
}

void error_report_finish(struct error_report *report)
{
    free(report->map);
    free(report->map_without_centre);
    *report = (struct error_report){0};
}
