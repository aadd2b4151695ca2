/* The relative error of a material against measured responses, for each surface point. */
#ifndef FACTOR_ERROR_H
#define FACTOR_ERROR_H

#include "nacre/material.h"
#include "nacre/scan.h"

#include "base/progress.h"

/* Least, mean and greatest over the points that have an error. */
struct error_range {
    size_t points;
    double minimum, mean, maximum;
    double energy_mean; /* mean of the errors' squares, the energy ratio */
};

struct error_report {
    size_t points;       /* of the sample */
    size_t not_measured; /* counted apart: nothing measured */
    size_t dark;         /* counted apart: measured as exactly 0 */
    struct error_range whole, without_centre;
    float *map;                /* [height][width]; NaN for points counted apart */
    float *map_without_centre; /* the same without the entries x_o = x_i */
};

/* Where measured responses come from: response[channels][K][K], NaN where not measured. Called by several threads. Where
 * the material's window is smaller, it has nothing beyond it, and its error counts what was measured there. */
struct error_source {
    const void *data;
    int (*read)(const void *data, int x, int y, float *response, struct nacre_error *error);
    int window; /* K of what is read; 0: as the material's */
    const double
        *beyond; /* [height][width]: squares of what was measured beyond that; NULL: nothing */
};

struct error_source error_source_scan(const struct nacre_scan *scan);

/* ||measured - factored|| / ||measured|| over the measured entries of each point's window inside the sample, all
 * channels, in double precision. Without `progress` it does not stop when the user asks to. error_report_finish the
 * report. */
int error_measure(const struct error_source *source, const struct nacre_material *material,
                  struct progress *progress, struct error_report *report,
                  struct nacre_error *error);

/* Measure `rows` rows of points from the middle of the sample and forget the result, to learn what the whole takes. */
int error_rehearse(const struct error_source *source, const struct nacre_material *material,
                   int rows, struct nacre_error *error);

/* Whether a material and a scan are of the same size, but for a smaller window; the text names what differs. */
int error_check_sizes(const struct nacre_scan *scan, const struct nacre_material *material,
                      struct nacre_error *error);

/* Write the maps as a file of two channels, `error` and `without_centre`. */
int error_map_write(const char *path, const struct error_report *report, int width, int height,
                    struct nacre_error *error);

/* Bytes of the responses as the paper's Table 1 counts them: points x K x K x channels x 4. */
double error_measured_bytes(const struct nacre_material *material);

void error_report_finish(struct error_report *report);

#endif
