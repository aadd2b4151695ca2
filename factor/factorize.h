/* The factorization of a scan from end to end: clusters, kernels, factors, error; and when it stops. */
#ifndef FACTOR_FACTORIZE_H
#define FACTOR_FACTORIZE_H

#include "factor/error.h"
#include "factor/kernels.h"
#include "factor/method.h"
#include "factor/prepared.h"
#include "factor/search.h"
#include "factor/tell.h"
#include "factor/watch.h"

#include "base/clock.h"
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

/* What the objective weighs errors by: W of section 5.3. */
enum factor_weight {
    FACTOR_WEIGHT_KERNEL,   /* the paper's 1 / sqrt(g) */
    FACTOR_WEIGHT_RESPONSE, /* 1 / ||R_i||: relative errors; factor/weight.h */
    FACTOR_WEIGHT_AUTO,     /* response with a kernel per term, else kernel */
};

/* What is fitted. */
enum factor_model {
    FACTOR_MODEL_CLUSTERS, /* the paper's: (sum_t F H) times the kernel of a point's cluster */
    FACTOR_MODEL_TERMS,    /* sum_t F g_t H and the centre: factor/terms_data.h */
};

/* With a kernel per term. Auto ones are chosen for the least error at equal bytes: factor/shape.h. */
enum factor_kernels { FACTOR_KERNELS_RADIAL, FACTOR_KERNELS_FULL, FACTOR_KERNELS_AUTO };
enum factor_planes { FACTOR_PLANES_SHARED, FACTOR_PLANES_SEPARATE, FACTOR_PLANES_AUTO };

/* Bits of planes: 2 to 10, 0 for half floats, or auto: the fewest from the least on that do. */
enum { FACTOR_BITS_AUTO = -1, FACTOR_BITS_LEAST = 8 };

/* Another maker of methods than those that `method` names, as tests have it. */
struct method_maker {
    int (*make)(void *data, const struct problem *problem, struct method **method,
                struct nacre_error *error);
    void *data;
};

/* A factorization with fewer terms that another starts from. */
struct factor_stage {
    int terms, clusters, iterations; /* clusters: 1 with a kernel per term */
};

/* As many as a run may go through. */
enum { FACTOR_STAGES = 16 };

struct factors;

/* Where terms, clusters or iterations are 0, they are chosen: to hold `error` or to fill `seconds`, and without either
 * they are 12, 5 and 200. */
struct factor_options {
    enum factor_model model;
    enum factor_method method;
    enum factor_weight weight;
    int terms, clusters, iterations;
    enum kernels_kind kernel;
    double
        tolerance; /* stop when five iterations lower the objective by less than five times this share; 0: not at all */
    double error;  /* mean relative error to be held by the material as stored; 1: any */
    double seconds; /* that all may take from begun_ns on, writing the material included; 0: any */
    double epsilon; /* relative to each kernel's maximum */
    int window;     /* K, at most the scan's; 0: the scan's */
    enum factor_store store;
    enum responses_store responses;
    int seed;
    double regularise; /* 0: not; see docs/factorization.md */

    /* With a kernel per term. */
    enum terms_reciprocity reciprocity;
    enum factor_kernels kernels;
    enum factor_planes planes; /* shared by the channels, or each channel's own */
    int bits;                  /* of planes in the file */

    const char
        *checkpoint; /* a file to keep the state of the run in and to go on from; NULL: none */
    double checkpoint_seconds; /* between two such files */
    struct listener listener;  /* is told what is chosen and why */
    struct clock *clock;       /* of all time above; NULL: the system's */
    int64_t begun_ns; /* by that clock: when the command began; 0: when factorize is called */
    const struct method_maker *maker; /* NULL: by `method` */

    const struct factor_stage *stages; /* [stage_count]: come first, with fewer terms each */
    int stage_count;
    const struct factors *start;      /* what the last stage left, instead of stages, or NULL */
    struct factor_prepared *prepared; /* shared with other runs on the same responses, or NULL */
    const struct factor_watcher *watcher; /* or NULL */
};

/* hals, 12 terms, 5 clusters, 200 iterations or tolerance 3e-3, average kernels, epsilon 1e-5. */
struct factor_options factor_options_default(void);

/* What there is to tell beside the material. */
struct factor_summary {
    double objective; /* after the last iteration, in the responses' unit */
    double seconds_reading, seconds_clustering, seconds_iterating, seconds_measuring;
    double seconds_step;       /* the last iteration */
    bool error_held;           /* or none was asked for */
    bool continued;            /* from a checkpoint */
    bool half_responses;       /* they were held as half floats */
    char stopped_by[24];       /* "tolerance", "iterations", "error", "time", "request" ... */
    struct search search;      /* what was tried; one entry where nothing was to be chosen */
    struct error_report error; /* of the material as stored */
};

void factor_summary_finish(struct factor_summary *summary);

/* Factor the scan. Fills *material, which the caller finishes, and *summary. When the user cancels during the iterations
 * the material is completed with the best factors so far (its `iterations` tell how many) and NACRE_CANCELLED is
 * returned; cancelled earlier, material->f is NULL. An error that cannot be held still gives the best material found and
 * NACRE_OK; the summary tells. Where `seconds` are too few for one iteration it fails and says what is needed. Without
 * `seconds`, the same scan, options and device give the same bits. */
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
