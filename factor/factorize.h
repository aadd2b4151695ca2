/* The factorization of a scan from end to end: clusters, kernels, factors, error. */
#ifndef FACTOR_FACTORIZE_H
#define FACTOR_FACTORIZE_H

#include "factor/error.h"
#include "factor/kernels.h"

#include "base/opencl.h"
#include "base/progress.h"
#include "nacre/material.h"

enum factor_store {
    FACTOR_STORE_AUTO, /* half floats, unless they raise the mean error by more than a hundredth of itself */
    FACTOR_STORE_FLOAT,
    FACTOR_STORE_HALF,
};

/* How the factors are found. */
enum factor_method {
    FACTOR_METHOD_HALS, /* factor/hals.h */
    FACTOR_METHOD_MU,   /* the paper's: factor/update.h */
};

struct factor_options {
    enum factor_method method;
    int terms, clusters, iterations;
    enum kernels_kind kernel;
    double
        tolerance; /* stop when five iterations lower the objective by less than five times this share; 0: never */
    double epsilon; /* relative to each kernel's maximum */
    enum factor_store store;
    enum responses_store responses;
    int seed;
    double regularise; /* 0: not; see docs/factorization.md */
};

/* hals, 12 terms, 5 clusters, 200 iterations or tolerance 3e-3, average kernels, epsilon 1e-5. */
struct factor_options factor_options_default(void);

/* What there is to tell beside the material. */
struct factor_summary {
    double objective; /* after the last iteration, in the responses' unit */
    double seconds_reading, seconds_clustering, seconds_iterating, seconds_measuring;
    struct error_report error; /* of the material as stored */
};

void factor_summary_finish(struct factor_summary *summary);

/* Factor the scan. Fills *material, which the caller finishes, and *summary. When the user cancels during the iterations
 * the material is completed with the factors so far (its `iterations` tell how many) and NACRE_CANCELLED is returned;
 * cancelled earlier, material->f is NULL. The same scan, options and device give the same bits. */
int factorize(const struct nacre_scan *scan, const struct factor_options *options,
              const struct opencl *opencl, struct progress *progress,
              struct nacre_material *material, struct factor_summary *summary,
              struct nacre_error *error);

/* The same for responses that are loaded already, with layout_lanes of the device. */
int factorize_responses(const struct responses *responses, double pitch_mm,
                        const struct factor_options *options, const struct opencl *opencl,
                        struct progress *progress, struct nacre_material *material,
                        struct factor_summary *summary, struct nacre_error *error);

#endif
