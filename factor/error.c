/* Measuring how far a material is from the responses it was made of. */
#include "factor/error.h"

#include "nacre/evaluate.h"
#include "nacre/exr_file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Squared sums of one point. */
struct sums {
    size_t measured; /* entries */
    double difference, norm;
};

static struct sums compare(const struct nacre_material *m, int x, int y, const float *measured,
                           const float *factored)
{
    struct sums sums = {0};
    int half = m->window / 2;
    for (int c = 0; c < m->channels; c++) {
        for (int v = 0; v < m->window; v++) {
            for (int u = 0; u < m->window; u++, measured++, factored++) {
                int xo = x + u - half, yo = y + v - half;
                bool inside = xo >= 0 && xo < m->width && yo >= 0 && yo < m->height;
                double value = (double)*measured, difference = value - (double)*factored;
                if (inside && isfinite(value)) {
                    sums.measured++;
                    sums.difference += difference * difference;
                    sums.norm += value * value;
                }
            }
        }
    }
    return sums;
}

/* Sums of everything but the centre, added afresh: a difference of sums would lose its digits. */
static struct sums compare_without_centre(const struct nacre_material *m, int x, int y,
                                          float *measured, const float *factored)
{
    size_t area = (size_t)m->window * (size_t)m->window;
    for (size_t c = 0; c < (size_t)m->channels; c++) {
        measured[c * area + area / 2] = NAN;
    }
    return compare(m, x, y, measured, factored);
}

static float relative(struct sums sums)
{
    return sums.measured && sums.norm > 0 ? (float)sqrt(sums.difference / sums.norm) : NAN;
}

static int measure_row(const struct error_source *source, const struct nacre_material *m, int y,
                       struct error_report *report, size_t *not_measured, struct nacre_error *error)
{
    size_t size = (size_t)m->channels * (size_t)m->window * (size_t)m->window;
    float *measured = malloc(size * sizeof *measured), *factored = malloc(size * sizeof *factored);
    int status = NACRE_OK;
    if (!measured || !factored) {
        status = nacre_fail_memory(error, "a response");
        goto out;
    }
    for (int x = 0; x < m->width && status == NACRE_OK; x++) {
        size_t point = (size_t)y * (size_t)m->width + (size_t)x;
        status = source->read(source->data, x, y, measured, error);
        if (status == NACRE_OK) {
            nacre_material_response(m, x, y, factored);
            struct sums sums = compare(m, x, y, measured, factored);
            report->map[point] = relative(sums);
            *not_measured += sums.measured == 0;
            report->map_without_centre[point] =
                relative(compare_without_centre(m, x, y, measured, factored));
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

static int read_scan(const void *data, int x, int y, float *response, struct nacre_error *error)
{
    return nacre_scan_read(data, x, y, response, error);
}

struct error_source error_source_scan(const struct nacre_scan *scan)
{
    return (struct error_source){scan, read_scan};
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
    if (info->window != m->window || info->channels != m->channels) {
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
