/* What accuracy costs in time and in bytes: many factorizations of one scan, each point of which can be repeated. */
#ifndef STUDY_TRADEOFF_H
#define STUDY_TRADEOFF_H

#include "factor/factorize.h"

enum { TRADEOFF_RUNS = 160, TRADEOFF_POINTS = 2048, TRADEOFF_WINDOWS = 4 };

/* One factorization, of which each look is a point. */
struct tradeoff_setting {
    enum factor_model model;
    enum factor_method method;
    enum factor_weight weight; /* resolved: not auto */
    int terms, clusters;       /* clusters: 0 with a kernel per term */
    int window;                /* K */
    double epsilon;
    int parent; /* the run that it starts from, with fewer terms; -1: from random numbers */
};

struct tradeoff_point {
    int run, iterations;
    enum factor_store store; /* of F and H: half or float */
    int bits;                /* of planes with a kernel per term, or 0 */
    double error, error_minimum, error_maximum, error_without_centre; /* relative, as stored */
    double bytes;   /* of the material, as the paper's Table 1 counts them */
    double seconds; /* from reading the scan to the measured material, its stages included */
    bool quickest;  /* no other point has as small an error as soon, ... */
    bool smallest;  /* ... or in as few bytes */
};

struct tradeoff_run {
    struct tradeoff_setting setting;
    double predicted, seconds; /* that it took of the budget */
    double best_error;         /* of its points */
    char ended[16];            /* "tolerance", "dominated", "budget", "iterations", "failed" */
    bool failed;
    struct nacre_error why; /* it failed */
    /* What other runs may start from. */
    int kept_iterations;
    double kept_seconds;  /* until then, as points count them */
    struct factors *kept; /* or NULL */
    int depth;            /* stages before it */
};

/* A window that factorizations may have. */
struct tradeoff_window {
    int window;
    double left_out; /* the mean relative error of having nothing beyond it */
};

/* What is known so far, from which alone the next setting follows. */
struct tradeoff {
    int width, height, channels, window;
    double measured_bytes;
    size_t measured_points;
    struct tradeoff_window windows[TRADEOFF_WINDOWS]; /* falling; the first is the scan's */
    int window_count;
    double seconds_reading;
    struct tradeoff_run runs[TRADEOFF_RUNS];
    int run_count;
    struct tradeoff_point *points; /* [TRADEOFF_POINTS] */
    int point_count;
};

struct tradeoff_request {
    const char *scan, *folder; /* paths */
    const char *run_in;        /* the folder that paths are taken from, or NULL */
    const char *device;        /* as given with --device, or NULL */
    const char *source;        /* of the scan */
    double budget;             /* seconds for all of it */
    int seed;
    struct clock *clock;              /* NULL: the system's */
    const struct method_maker *maker; /* as in factor_options */
    double seconds_reading;           /* where responses are loaded already */
};

int tradeoff_begin(struct tradeoff *tradeoff, struct nacre_error *error);
void tradeoff_finish(struct tradeoff *tradeoff); /* a zeroed one is allowed */

/* Run factorizations until the budget is spent or nothing promising is left, and mark the fronts. NACRE_CANCELLED leaves
 * what was found before. tradeoff_finish in any case. */
int tradeoff_run(const struct responses *responses, double pitch_mm,
                 const struct tradeoff_request *request, const struct opencl *opencl,
                 struct progress *progress, struct tradeoff *tradeoff, struct nacre_error *error);

/* The stages that a run was started from, the first first; returns how many. */
int tradeoff_stages(const struct tradeoff *tradeoff, int run,
                    struct factor_stage stages[FACTOR_STAGES]);

/* The command that makes the material of a point: one line, heap; NULL when memory runs out. */
char *tradeoff_command(const struct tradeoff *tradeoff, const struct tradeoff_request *request,
                       const struct tradeoff_point *point);

/* Make the folder where there is none, and find out whether files can be written to it. */
int tradeoff_prepare_folder(const char *folder, struct nacre_error *error);

/* tradeoff.csv, tradeoff.json and tradeoff.html in the folder: all three or none. */
int tradeoff_write(const struct tradeoff *tradeoff, const struct tradeoff_request *request,
                   struct nacre_error *error);

/* The same object as tradeoff.json, NULL when memory runs out. */
struct json_t;
struct json_t *tradeoff_to_json(const struct tradeoff *tradeoff,
                                const struct tradeoff_request *request);

#endif
