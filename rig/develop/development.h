/* What the steps of a development share, once the calibration is known. */
#ifndef RIG_DEVELOP_DEVELOPMENT_H
#define RIG_DEVELOP_DEVELOPMENT_H

#include "nacre/scan.h"
#include "rig/develop/calibrate.h"
#include "rig/develop/develop.h"
#include "rig/develop/resample.h"
#include "rig/session.h"

struct development {
    const struct session *session;
    const struct calibration *calibration;
    struct resampler *resampler;
    struct nacre_scan_info info;
    struct visit_progress *progress;
    struct develop_report *report;
};

enum {
    NOISE_FRAMES = 4,  /* black frames developed like grids to see their noise */
    MISFIT_FRAMES = 4, /* grids that decide how pixels become points */
};

/* A frame made into light per surface point (visitor's work): state is a struct development. */
int development_resample(const struct development *development, const struct merged *merged,
                         float *reflected, struct nacre_error *error);

/* Choose how pixels become points, make the resampler that does it, and say so in the report (sampling.c). */
int development_choose(struct development *development, enum demosaic wanted,
                       struct nacre_error *error);

/* Measure report->noise on black frames (sampling.c). */
int development_measure_noise(struct development *development, struct nacre_error *error);

/* Develop all grids and write the scan `output` (grids.c). */
int development_write(struct development *development, const struct develop_options *options,
                      const char *output, struct nacre_error *error);

#endif
